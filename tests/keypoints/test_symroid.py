"""SymRoID: its regions step by step, against slow twins and shapes whose regions are known."""

import dataclasses
from math import atan2, cos, exp, hypot

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import ndimage

from saccade import SymRoid, SymRoidConfig
from saccade.keypoints.symroid import (
    Level,
    bounding_boxes,
    grow_regions,
    resampled,
    strongest_pair_radius,
    symmetry_levels,
)
from saccade.scale.pair_sums import gradients_of, isotropic_sums, pair_kernel
from support import oracles_symmetry as oracles
from support.symmetric_images import discs, texture

SOURCE = SymRoidConfig.kootstra2010()


def hills(seed, shape=(30, 40)):
    return ndimage.gaussian_filter(np.random.default_rng(seed).random(shape), 2).astype(np.float32)


@settings(max_examples=10)
@given(st.integers(0, 1000), st.sampled_from([0.5, 0.9]), st.sampled_from([0.8, 0.95]))
@example(180, 0.9, 0.95)  # a part without a seed touches one that has one
def test_regions_of_the_source_in_a_plain_second_reading(seed, growth, threshold):
    """Grown from every seed along the axes; what touches is one region."""
    symmetry = hills(seed)
    config = dataclasses.replace(SOURCE, growth_threshold=growth, seed_threshold=threshold)
    labels, peaks = grow_regions(symmetry, config)
    highest = symmetry.max()
    seeds = (symmetry == ndimage.maximum_filter(symmetry, 3)) & (symmetry >= threshold * highest)
    grown = ndimage.label(symmetry >= growth * highest)[0]
    kept = np.isin(grown, np.unique(grown[seeds])) & (grown > 0)
    expected, count = ndimage.label(kept, np.ones((3, 3)))
    assert len(peaks) == count == labels.max()
    both = np.unique(np.stack([labels.ravel(), expected.ravel()]), axis=1)
    assert both.shape[1] == len(np.unique(expected))  # each is one of the others
    np.testing.assert_allclose(peaks, [symmetry[labels == n].max() for n in range(1, count + 1)])


@pytest.mark.kernel
def test_the_strongest_pair_in_a_plain_second_reading():
    image = np.random.default_rng(2).random((24, 30)).astype(np.float32)
    gradients = gradients_of(image, 60.0)
    pairs = pair_kernel(1, 4, 6.0)
    level = Level(2.0, gradients, isotropic_sums([gradients], pairs))
    cells = np.array([(7, 9), (15, 12), (2, 2), (28, 20), (0, 0)])
    radius = strongest_pair_radius([level], pairs, 2 * (cells + 0.5) - 0.5)
    theta = np.arctan2(gradients.sine, gradients.cosine)
    for (x, y), found in zip(cells, radius, strict=True):
        best = (0.0, 0.0)
        for dx, dy in oracles.half_ring(1, 4):
            i, j, alpha = (y + dy, x + dx), (y - dy, x - dx), atan2(dy, dx)
            inside = all(1 <= r < 23 and 1 <= c < 29 for r, c in (i, j))
            if inside:
                a, b = theta[i] - alpha, theta[j] - alpha
                term = (1 - cos(a + b)) * (1 - cos(a - b)) * exp(-((dx**2 + dy**2) / 18))
                term *= gradients.strength[i] * gradients.strength[j]
                best = max(best, (term, 2 * hypot(dx, dy)))
        assert found == pytest.approx(best[1], abs=1e-6)


def test_the_box_is_that_of_the_discs():
    """Two cells of a region, each with the disc of its strongest pair."""
    image = discs((20, 20, 6, 1.0), (40, 20, 6, 1.0), shape=(40, 60))
    config = SymRoidConfig(levels=(0,), inner=1, outer=9, sigma=8.0, gain=60.0)
    pairs = pair_kernel(1, 9, 8.0)
    levels = symmetry_levels(image, config, pairs)
    labels = np.zeros((40, 60), np.int64)
    labels[20, 20] = labels[20, 40] = 1
    (xy,), ((left, top, right, bottom),) = bounding_boxes(labels, levels, pairs, (40, 60))
    np.testing.assert_allclose(xy, (30, 20))
    radius = 20 - top
    assert radius == pytest.approx(6, abs=1)
    np.testing.assert_allclose((left, right, bottom), (20 - radius, 40 + radius, 20 + radius))


@pytest.mark.parametrize("config", [SymRoidConfig(), SOURCE])
@pytest.mark.parametrize("radius", [10, 16])
def test_a_disc_is_a_region_about_its_center(config, radius):
    image = discs((120, 80, radius, 0.95), shape=(240, 320), ground=0.2)
    regions = SymRoid(config)(image)
    assert np.hypot(*(regions.xy[0] - (120, 80))) < (2 if config is not SOURCE else 5)
    left, top, right, bottom = regions.boxes[0]
    assert left < 120 < right
    assert top < 80 < bottom
    assert repr(regions) == f"Regions({len(regions)} regions)"
    assert regions.descriptors.shape == (len(regions), 128)


@pytest.mark.parametrize("config", [SymRoidConfig(max_keypoints=None), SOURCE])
def test_regions_are_strong_first_and_no_more_than_asked_for(config):
    image = texture(3, (240, 320))
    every = SymRoid(config)(image)
    few = SymRoid(dataclasses.replace(config, max_keypoints=3))(image)
    assert len(every) > len(few) == 3
    assert (np.diff(every.keypoints.response) <= 0).all()
    np.testing.assert_array_equal(few.boxes, every.boxes[:3])
    np.testing.assert_array_equal(few.descriptors, every.descriptors[:3])
    width, height = (few.boxes[:, 2:] - few.boxes[:, :2]).T
    if config.frame == "box":
        np.testing.assert_allclose(few.keypoints.size, np.sqrt(width * height), rtol=1e-5)


def test_a_frame_turns_and_grows_with_the_image():
    """Regions of an image turned by 90 degrees and doubled are the same, turned and doubled."""
    image = texture(5, (200, 260))
    changed = cv2.resize(np.ascontiguousarray(image.T[:, ::-1]), None, fx=2, fy=2)
    here = SymRoid(SymRoidConfig(max_keypoints=10))(image).keypoints
    there = SymRoid(SymRoidConfig(max_keypoints=None, seed_threshold=1e-3))(changed).keypoints
    expected = 2 * np.stack([199 - here.xy[:, 1], here.xy[:, 0]], axis=1) + 0.5
    gap = np.hypot(*(expected[:, None] - there.xy[None]).transpose(2, 0, 1))
    turn = here.angle[:, None] + np.pi / 2 - there.angle[None]
    growth = np.log2(there.size[None] / here.size[:, None])
    same = (gap < 1) & (np.abs(growth - 1) < 0.2) & (np.cos(turn) > 0.98)
    assert same.any(axis=1).mean() > 0.8


def test_no_region_is_within_a_stronger_one():
    points = SymRoid(SymRoidConfig(max_keypoints=None))(texture(6, (240, 320))).keypoints
    assert len(points) > 50
    gap = np.hypot(*(points.xy[:, None] - points.xy[None]).transpose(2, 0, 1))
    reach = np.maximum(points.size[:, None], points.size[None])
    assert ((gap == 0) | (gap > 0.999 * reach)).all()


@pytest.mark.parametrize(("upright", "least"), [(True, 0.9), (False, 0.7)])
def test_regions_are_found_and_told_apart_under_other_light(upright, least):
    """A direction is one more thing that may be taken for another."""
    image = texture(4, (240, 320))
    config = SymRoidConfig(upright=upright)
    here = SymRoid(config)(image)
    dark = SymRoid(dataclasses.replace(config, max_keypoints=None))(0.6 * image)
    places = np.hypot(*(here.xy[:, None] - dark.xy[None]).transpose(2, 0, 1))
    assert (places.min(axis=1) < 3).all()
    distance = np.linalg.norm(
        here.descriptors[:, None].astype(float) - dark.descriptors[None].astype(float), axis=2
    )
    right = places[np.arange(len(here)), distance.argmin(axis=1)] < 3
    assert right.mean() > least


def test_a_box_is_brought_to_a_square():
    image = np.tile(np.linspace(0, 1, 200, dtype=np.float32), (100, 1))
    patch = resampled(image, np.array([80, 40, 120, 50], np.float32))
    assert patch.shape == (60, 60)
    assert (np.diff(patch[30]) > 0).all()
    middle = patch[:, 29:31].mean() * 199
    assert middle == pytest.approx(100, abs=1)
    assert np.ptp(patch[:, 30]) < 1e-6
    corner = resampled(image, np.array([-0.5, -0.5, 4, 4], np.float32))
    assert np.isfinite(corner).all()
