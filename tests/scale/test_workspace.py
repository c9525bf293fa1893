"""Threads that share the work on a plane."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from saccade.scale.scale_space import MIN_SHARED, blurred, gaussian_kernel
from saccade.scale.workspace import Workspace


@pytest.fixture
def workspace():
    """A function of a number of threads."""
    with ThreadPoolExecutor(8) as executor:
        yield lambda threads: Workspace(executor, threads)


@pytest.mark.parametrize("threads", [2, 3, 7])
@pytest.mark.parametrize("sigma", [1.2, 9.0])
def test_shares_of_a_blur_are_opencvs_blur_of_the_whole(rng, workspace, threads, sigma):
    plane = rng.random((1031, 1100), np.float32)
    assert plane.size >= MIN_SHARED
    kernel = gaussian_kernel(sigma, 4.0, corrected=False)
    whole = cv2.sepFilter2D(plane, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT_101)
    np.testing.assert_array_equal(blurred(plane, sigma, 4.0, workspace=workspace(threads)), whole)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_each_item_is_in_one_block(workspace, threads):
    done = []
    workspace(threads).run_in_blocks(lambda block: done.append((block.start, block.stop)), 103, 10)
    assert sorted(done) == [(start, min(start + 10, 103)) for start in range(0, 103, 10)]


@pytest.mark.parametrize("failing", [0, 50, 100])
def test_an_error_in_any_thread_is_raised(workspace, failing):
    def work(block):
        if block.start == failing:
            raise ValueError(failing)

    with pytest.raises(ValueError, match=str(failing)):
        workspace(3).run_in_blocks(work, 103, 10)
