import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracles_keypoints as oracles
from saccade.keypoints.descriptor import (
    Frames,
    describe_frames,
    fill_descriptors,
    fill_gradients,
    fill_orientation_bins,
    orientations,
    quantize,
    unit_rows,
)

planes = st.integers(0, 2**32 - 1).map(
    lambda seed: np.random.default_rng(seed).random((2, 19, 23), np.float32)
)
places = st.tuples(st.floats(2, 20), st.floats(2, 16))
scales = st.floats(0.6, 1.5)
angles = st.floats(-np.pi, np.pi)


def frame(x, y, sigma, plane=1):
    return Frames(np.array([plane]), np.array([[x, y]], np.float32), np.array([sigma], np.float32))


def ramp(angle, shape=(41, 41)):
    row, column = np.indices(shape)
    return (np.cos(angle) * column + np.sin(angle) * row).astype(np.float32)[None]


def away_from_ties(values, tie):
    """Rounding may put what lies on an edge on either side of it."""
    return np.abs(np.asarray(values) % 1 - tie).min() > 1e-3


@pytest.mark.kernel
@given(planes, st.integers(1, 17))
@settings(max_examples=20)
def test_gradients_are_numpys(octave, row):
    magnitude, direction = np.zeros(23, np.float32), np.zeros(23, np.float32)
    fill_gradients(octave[0], row, 1, 22, magnitude, direction)
    expected_magnitude, expected_direction = oracles.gradients(octave[0].astype(float))
    np.testing.assert_allclose(magnitude[1:22], expected_magnitude[row, 1:22], atol=1e-6)
    np.testing.assert_allclose(direction[1:22], expected_direction[row, 1:22], atol=5e-6)


@pytest.mark.kernel
@pytest.mark.parametrize("quarter", range(4))
def test_gradients_along_the_axes(quarter):
    magnitude, direction = np.ones(3, np.float32), np.ones(3, np.float32)
    plane = np.rot90(np.tile(np.arange(3, dtype=np.float32), (3, 1)), -quarter).copy()
    fill_gradients(plane, 1, 1, 2, magnitude, direction)
    assert magnitude[1] == 2
    np.testing.assert_allclose(np.exp(1j * direction[1]), 1j**quarter, atol=1e-6)
    fill_gradients(np.zeros_like(plane), 1, 1, 2, magnitude, direction)
    assert magnitude[1] == direction[1] == 0


@pytest.mark.kernel
@given(planes, places, scales, st.booleans(), st.booleans())
@settings(max_examples=25)
def test_orientation_bins_meet_their_twin(octave, place, sigma, linear, subpixel):
    points = frame(*place, sigma)
    x, y = points.xy[0].astype(float)
    scale = float(points.sigma[0])
    edges = [x, y, 4.5 * scale] if not subpixel else [x - 4.5 * scale, x + 4.5 * scale]
    if not away_from_ties(edges, 0.5 if not subpixel else 0):
        return
    bins = np.zeros((1, 36), np.float32)
    fill_orientation_bins(octave, *points, linear, subpixel, bins)
    expected = oracles.orientation_bins(
        octave[1].astype(float), x, y, scale, linear=linear, subpixel=subpixel
    )
    assert bins.sum() == pytest.approx(expected.sum(), rel=1e-4)
    if linear or away_from_ties(oracles.gradients(octave[1].astype(float))[1] * 18 / np.pi, 0.5):
        np.testing.assert_allclose(bins[0], expected, atol=2e-4 * expected.sum())


@pytest.mark.kernel
@given(planes, places, scales, angles, st.booleans(), st.sampled_from([0.5, 1.5]))
@settings(max_examples=25)
def test_descriptor_meets_its_twin(octave, place, sigma, angle, subpixel, window_sigma):
    points = frame(*place, sigma)
    x, y = points.xy[0].astype(float)
    if not subpixel and not away_from_ties([x, y], 0.5):
        return
    out = np.full((1, 128), np.nan, np.float32)
    angle = np.float32(angle)
    fill_descriptors(octave, *points, np.array([angle]), window_sigma, subpixel, out)
    expected = oracles.descriptor(
        octave[1].astype(float),
        x,
        y,
        float(points.sigma[0]),
        float(angle),
        window_sigma=window_sigma,
        subpixel=subpixel,
    )
    np.testing.assert_allclose(out[0], expected, atol=2e-4 * expected.max())


@pytest.mark.parametrize(("smoothing", "tolerance"), [(0, 1.7), (2, 0.7), (8, 0.2)])
@pytest.mark.parametrize("degrees", [0, 5, 33, 90, 135, 179.5, -45, -178])
def test_a_ramp_points_where_it_rises(degrees, smoothing, tolerance):
    angle = np.radians(degrees)
    index, found, height = orientations(
        ramp(angle), frame(20, 20, 2, plane=0), linear=True, smoothing=smoothing, subpixel=True
    )
    np.testing.assert_array_equal(index, [0])
    np.testing.assert_allclose(found, [angle], atol=np.radians(tolerance))
    np.testing.assert_allclose(height, 1)


def test_half_a_turn_is_plus_pi():
    falling = -np.tile(np.arange(41, dtype=np.float32), (41, 1))[None]
    _, angle, _ = orientations(
        falling, frame(20, 20, 2, plane=0), linear=True, smoothing=0, subpixel=True
    )
    np.testing.assert_array_equal(angle, [np.float32(np.pi)])


def test_a_roof_has_two_orientations():
    _, column = np.indices((61, 61))
    roof = np.abs(column - 30).astype(np.float32)[None]
    index, angle, height = orientations(
        roof, frame(30, 30, 2, plane=0), linear=True, smoothing=2, subpixel=True
    )
    np.testing.assert_array_equal(index, [0, 0])
    np.testing.assert_allclose(np.sort(np.abs(angle)), [0, np.pi], atol=1e-3)
    np.testing.assert_allclose(height, 1, rtol=1e-3)


def test_a_flat_place_has_no_orientation():
    index, angle, height = orientations(
        np.full((1, 20, 20), 0.3, np.float32),
        frame(10, 10, 1, plane=0),
        linear=True,
        smoothing=2,
        subpixel=True,
    )
    assert len(index) == len(angle) == len(height) == 0


@pytest.mark.parametrize("root", [False, True])
def test_a_flat_place_has_an_empty_descriptor(root):
    found = describe_frames(
        np.full((1, 30, 30), 0.3, np.float32),
        frame(10, 10, 1, plane=0),
        np.zeros(1, np.float32),
        window_sigma=0.5,
        subpixel=True,
        root=root,
    )
    assert found.shape == (1, 128)
    assert found.dtype == np.uint8
    assert not found.any()


def test_a_ramp_along_the_angle_fills_the_first_direction():
    angle = np.radians(25)
    found = describe_frames(
        ramp(angle, (81, 81)),
        frame(40, 40, 2, plane=0),
        np.array([angle], np.float32),
        window_sigma=0.5,
        subpixel=True,
        root=False,
    ).reshape(4, 4, 8)
    assert (found[:, :, 0] > 60).all()
    assert found[:, :, 1:].max() <= 2


def test_entries_are_cut_and_quantized_as_the_field_does(rng):
    raw = rng.exponential(size=(50, 128)).astype(np.float32) ** 3
    unit = unit_rows(np.minimum(unit_rows(raw), np.float32(0.2)))
    np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1, rtol=1e-6)
    found = quantize(unit, root=False).astype(float)
    assert np.abs(found - np.minimum(512 * unit, 255)).max() <= 0.5 + 1e-4
    spike = np.zeros((1, 128), np.float32)
    spike[0, 3] = 1
    assert quantize(spike, root=False).max() == 255


def test_root_descriptors_have_the_hellinger_kernel(rng):
    """The inner product of root descriptors is the sum of sqrt(p q) of the distributions."""
    unit = unit_rows(rng.random((2, 128), np.float32))
    p, q = unit / unit.sum(axis=1, keepdims=True)
    a, b = quantize(unit, root=True).astype(float) / 512
    assert a @ b == pytest.approx(np.sqrt(p * q).sum(), abs=2e-3)
