import cv2
import numpy as np
import pytest
from scipy import ndimage

from saccade.scale.scale_space import (
    blurred,
    gaussian_kernel,
    gaussian_scale_space,
    interpolated,
)
from saccade.scale.scale_space_config import ScaleSpaceConfig
from saccade.scale.workspace import WorkspacePool


def lowe(**changes):
    settings = {"extra_intervals": 0, "base_sigma": 1.6, "density": 1.0, "camera_sigma": 0.5}
    return ScaleSpaceConfig(**(settings | {"kernel_radius": 4.0} | changes))


def blob(shape, x, y, sigma):
    row, column = np.indices(shape)
    return np.exp(-((column - x) ** 2 + (row - y) ** 2) / (2 * sigma**2)).astype(np.float32)


@pytest.mark.parametrize("sigma", [0.8, 1.6, 3.2])
def test_blur_is_scipys(rng, sigma):
    plane = rng.random((40, 51), np.float32)
    ours = blurred(plane, sigma, 4.0)
    radius = (round(8 * sigma + 1) | 1) // 2
    theirs = ndimage.gaussian_filter(plane.astype(float), sigma, mode="mirror", radius=radius)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


@pytest.mark.parametrize("shape", [(151, 171), (150, 172), (163, 158)])
@pytest.mark.parametrize("first_octave", [-1, 0])
@pytest.mark.parametrize(("density", "extra"), [(1.0, 0), (0.5, 0), (0.5, 2)])
def test_every_plane_of_a_blob_is_a_blob(shape, first_octave, density, extra):
    """A Gaussian under a Gaussian is a Gaussian, wherever and however densely it is sampled."""
    x, y, sigma = 80.3, 71.8, 5.0
    # Half the doubled samples are means of two pixels, of variance 1/4.
    doubling = 0.125 if first_octave < 0 and density == 1 else 0
    config = lowe(first_octave=first_octave, density=density, extra_intervals=extra)
    space = gaussian_scale_space(blob(shape, x, y, sigma), config)
    assert len(space.octaves) >= 4
    for number, octave in enumerate(space.octaves[: 3 if density == 1 else 2]):
        assert len(octave) == 6 + extra * (number == 0)
        origin, spacing = space.origin[number], space.spacing[number]
        row, column = np.indices(octave.shape[1:])
        px, py = origin[0] + column * spacing, origin[1] + row * spacing
        for i, plane in enumerate(octave):
            blur = 1.6 * 2 ** ((i + extra * (number > 0)) / 3) * spacing * density
            variance = sigma**2 + blur**2 - 0.5**2 + doubling
            expected = np.exp(-((px - x) ** 2 + (py - y) ** 2) / (2 * variance))
            np.testing.assert_allclose(plane, sigma**2 / variance * expected, atol=0.002)


@pytest.mark.parametrize("shape", [(64, 64), (65, 96), (101, 70), (83, 57)])
@pytest.mark.parametrize("first_octave", [-1, 0])
def test_a_mirrored_image_has_the_mirrored_scale_space(rng, shape, first_octave):
    image = rng.random(shape, np.float32)
    config = lowe(first_octave=first_octave)
    space = gaussian_scale_space(image, config)
    mirrored = gaussian_scale_space(image[:, ::-1].copy(), config)
    turned = gaussian_scale_space(np.rot90(image).copy(), config)
    assert len(space.octaves) >= 3
    for a, b, c in zip(space.octaves, mirrored.octaves, turned.octaves, strict=True):
        np.testing.assert_allclose(b[:, :, ::-1], a, atol=1e-5)
        np.testing.assert_allclose(np.rot90(c, -1, axes=(1, 2)), a, atol=1e-5)


@pytest.mark.parametrize("start", [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0), (0.5, 0.5)])
def test_interpolation_is_exact_for_polynomials_of_degree_five(rng, start):
    factors = rng.normal(size=(2, 6)) / np.array([1, 10, 100, 1e3, 1e4, 1e5])

    def surface(x, y):
        return np.outer(np.polyval(factors[1][::-1], y), np.polyval(factors[0][::-1], x))

    coarse = surface(start[0] + 2.0 * np.arange(14), start[1] + 2.0 * np.arange(12))
    fine = interpolated(coarse.astype(np.float32), np.array(start), (24, 28))
    inner = np.s_[8:-8, 8:-8]
    expected = surface(np.arange(28.0), np.arange(24.0))[inner]
    np.testing.assert_allclose(fine[inner], expected, atol=2e-6 * np.abs(coarse).max())


def test_shifted_grid_is_opencvs(rng):
    space = gaussian_scale_space(rng.random((33, 50), np.float32), lowe(grid="shifted"))
    assert [octave.shape[1:] for octave in space.octaves] == [
        (66, 100),
        (33, 50),
        (16, 25),
        (8, 12),
    ]
    assert not space.origin.any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (3, 3), (4, 5)])
def test_no_room_no_octaves(shape):
    space = gaussian_scale_space(np.zeros(shape, np.float32), lowe())
    assert space.octaves == ()
    assert space.origin.shape == (0, 2)


@pytest.mark.parametrize("sigma", [0.3, 0.59, 0.79, 0.81, 1.3, 2.6])
@pytest.mark.parametrize("radius", [3.0, 4.0])
def test_a_corrected_kernel_has_the_variance_of_the_gaussian(sigma, radius):
    kernel = gaussian_kernel(sigma, radius, corrected=True)
    taps = np.arange(len(kernel)) - len(kernel) // 2
    np.testing.assert_allclose(kernel.sum(), 1, rtol=1e-6)
    np.testing.assert_allclose(kernel @ taps**2, sigma**2, rtol=1e-5)


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_bit(rng, threads):
    plane = rng.random((300, 211), np.float32)
    for sigma in (0.6, 1.5, 2.4):
        alone = blurred(plane, sigma, 3.0)
        with WorkspacePool(threads).workspace() as workspace:
            np.testing.assert_array_equal(blurred(plane, sigma, 3.0, workspace=workspace), alone)


def test_opencv_starts_no_threads_of_its_own_in_a_workspace():
    """Contexts overlap, and the last one restores the number of threads."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(3)
    try:
        first, second = (WorkspacePool(1).workspace() for _ in range(2))
        first.__enter__()
        with second:
            assert cv2.getNumThreads() == 1
            first.__exit__(None, None, None)
            assert cv2.getNumThreads() == 1
        assert cv2.getNumThreads() == 3
    finally:
        cv2.setNumThreads(before)
