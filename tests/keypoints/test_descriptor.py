import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.keypoints import DescriptorConfig
from saccade.keypoints._gradient_kernels import (
    fill_descriptors,
    fill_orientation_histograms,
    gather_gradients,
    normalize,
)
from saccade.keypoints.descriptor import (
    describe_points,
    histogram_peaks,
    max_samples,
    orientation_histograms,
    quantized,
    smoothed,
)
from saccade.keypoints.scale_space_points import Points
from support import oracles_keypoints as oracles

planes = st.integers(0, 2**32 - 1).map(
    lambda seed: np.random.default_rng(seed).random((2, 19, 23), np.float32)
)
places = st.tuples(st.floats(2, 20), st.floats(2, 16))
scales = st.floats(0.6, 1.5)
angles = st.floats(-np.pi, np.pi)


def point(x, y, sigma, plane=0, angle=0.0):
    single = np.array([[x, y, sigma, angle, 1]], np.float32)
    zero = np.zeros(1, np.int64)
    return Points(zero, zero + plane, single[:, :2], *single[:, 2:].T)


def dense(**settings):
    return DescriptorConfig(orientation_spacing=None, descriptor_spacing=None, **settings)


def orientations(octave, points, **settings):
    """Index, angle and relative height of the peaks."""
    config = dense(**settings)
    histograms = orientation_histograms(octave, points, config)
    return histogram_peaks(smoothed(histograms, config.smoothing), every_bin=False)


def ramp(angle, shape=(41, 41)):
    row, column = np.indices(shape)
    return (np.cos(angle) * column + np.sin(angle) * row).astype(np.float32)[None]


def away_from_ties(values, tie):
    """Rounding may put what lies on an edge on either side of it."""
    return np.abs(np.asarray(values) % 1 - tie).min() > 1e-3


@pytest.mark.kernel
@given(planes, places, scales, st.booleans(), st.booleans(), st.sampled_from([0.0, 1.4, 2.5]))
@settings(max_examples=40)
def test_orientation_bins_meet_their_twin(octave, place, sigma, linear, subpixel, spacing):
    points = point(*place, sigma, plane=1)
    x, y = points.xy[0].astype(float)
    scale = float(points.sigma[0])
    edges = [x, y, 4.5 * scale] if not subpixel else [x - 4.5 * scale, x + 4.5 * scale]
    edges += [y - 4.5 * scale, y + 4.5 * scale]
    if not away_from_ties(edges, 0.5 if not subpixel else 0):
        return
    if not away_from_ties([x, y, spacing * scale], 0.5):
        return
    bins = np.zeros((1, 36), np.float32)
    fill_orientation_histograms(octave, *points[1:4], spacing, linear, subpixel, 500, bins)
    expected = oracles.orientation_bins(
        octave[1].astype(float), x, y, scale, linear=linear, subpixel=subpixel, spacing=spacing
    )
    assert bins.sum() == pytest.approx(expected.sum(), rel=1e-4)
    if linear or away_from_ties(oracles.gradients(octave[1].astype(float))[1] * 18 / np.pi, 0.5):
        np.testing.assert_allclose(bins[0], expected, atol=2e-4 * expected.sum())


@pytest.mark.kernel
@given(
    planes,
    places,
    scales,
    angles,
    st.booleans(),
    st.sampled_from([0.5, 1.5]),
    st.sampled_from([0.0, 1.4, 2.5]),
)
@settings(max_examples=40)
def test_descriptor_meets_its_twin(octave, place, sigma, angle, subpixel, window_sigma, spacing):
    points = point(*place, sigma, plane=1)
    x, y = points.xy[0].astype(float)
    scale = float(points.sigma[0])
    if not away_from_ties([x, y, spacing * scale], 0.5):
        return
    out = np.full((1, 128), np.nan, np.float32)
    angle = np.float32(angle)
    angles = np.array([angle])
    fill_descriptors(octave, *points[1:4], angles, window_sigma, spacing, subpixel, 900, out)
    expected = oracles.descriptor(
        octave[1].astype(float),
        x,
        y,
        scale,
        float(angle),
        window_sigma=window_sigma,
        subpixel=subpixel,
        spacing=spacing,
    )
    np.testing.assert_allclose(out[0], expected, atol=2e-4 * expected.max())


@pytest.mark.parametrize("spacing", [0.0, 0.7, 1.0, 1.5])
@pytest.mark.parametrize("sigma", [0.4, 0.9, 1.49, 1.51, 2.6, 9.0])
def test_there_is_room_for_all_samples(sigma, spacing):
    sigmas = np.array([0.3, sigma], np.float32)
    room = max_samples(sigmas, 15.0, spacing)
    out, plane = np.empty((4, room), np.float32), np.zeros((401, 401), np.float32)
    for scale, angle, place in itertools.product(sigmas, (0.0, 0.1, np.pi / 4), (200.0, 200.4)):
        stride = max(int(spacing * scale + 0.5), 1)
        along, across = np.cos(angle) / scale, np.sin(angle) / scale
        assert gather_gradients(plane, place, place, along, across, 7.5, stride, out) <= room


@pytest.mark.parametrize(("smoothing", "tolerance"), [(0, 1.7), (2, 0.7), (8, 0.2)])
@pytest.mark.parametrize("degrees", [0, 5, 33, 90, 135, 179.5, -45, -178])
def test_a_ramp_points_where_it_rises(degrees, smoothing, tolerance):
    angle = np.radians(degrees)
    index, found, height = orientations(ramp(angle), point(20, 20, 2), smoothing=smoothing)
    np.testing.assert_array_equal(index, [0])
    np.testing.assert_allclose(found, [angle], atol=np.radians(tolerance))
    np.testing.assert_allclose(height, 1)


def test_half_a_turn_is_plus_pi():
    falling = -np.tile(np.arange(41, dtype=np.float32), (41, 1))[None]
    _, angle, _ = orientations(falling, point(20, 20, 2), smoothing=0)
    np.testing.assert_array_equal(angle, [np.float32(np.pi)])


def test_a_roof_has_two_orientations():
    _, column = np.indices((61, 61))
    roof = np.abs(column - 30).astype(np.float32)[None]
    index, angle, height = orientations(roof, point(30, 30, 2), smoothing=2)
    np.testing.assert_array_equal(index, [0, 0])
    np.testing.assert_allclose(np.sort(np.abs(angle)), [0, np.pi], atol=1e-3)
    np.testing.assert_allclose(height, 1, rtol=1e-3)


def as_bytes(raw, *, root):
    vectors = raw.copy()
    normalize(vectors, root)
    return quantized(vectors)


@pytest.mark.kernel
@pytest.mark.parametrize("root", [False, True])
def test_entries_are_cut_and_quantized_as_the_field_does(rng, root):
    raw = rng.exponential(size=(50, 128)).astype(np.float32) ** 3
    found = as_bytes(raw, root=root).astype(float)
    assert np.abs(found - oracles.quantized(raw, root=root)).max() <= 0.5 + 1e-3
    spike = np.zeros((1, 128), np.float32)
    spike[0, 3] = 1
    assert as_bytes(spike, root=root).max() == 255
    assert not as_bytes(np.zeros((1, 128), np.float32), root=root).any()


@pytest.mark.parametrize("kind", ["sift", "root"])
def test_floats_are_of_unit_length_and_round_to_the_bytes(rng, kind):
    plane = rng.random((1, 60, 60), np.float32)
    index = np.zeros(4, np.int64)
    points = point(30.2, 30.2, 2.5).take(index)._replace(angle=np.array([0.1, 1, 2, 3], np.float32))
    bytes_, floats = (
        describe_points(
            [plane], points, dense(window_sigma=0.5, descriptor=kind, descriptor_dtype=dtype)
        )
        for dtype in ("uint8", "float32")
    )
    assert floats.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(floats, axis=1), 1, rtol=1e-6)
    np.testing.assert_array_less(np.abs(bytes_ - np.minimum(512 * floats, 255)), 0.5 + 1e-4)
