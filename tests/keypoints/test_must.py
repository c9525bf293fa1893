"""MUST: the symmetry of its planes, its points, and the source's claims on real pairs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from saccade import Must, MustConfig, Sift
from saccade.datasets.homography_pairs import homography_pairs
from saccade.evaluation.features import Degradation, score_detector
from saccade.keypoints import SiftConfig
from saccade.keypoints.must import octave_symmetry
from saccade.scale.scale_space import ScaleSpace, gaussian_scale_space
from support import oracles_symmetry as oracles
from support.symmetric_images import discs, texture


def one_octave(planes, spacing=1.0):
    return ScaleSpace((planes,), np.zeros((1, 2)), np.array([spacing]))


@pytest.mark.parametrize("plane", [0, 4])
@pytest.mark.parametrize("spacing", [1.0, 4.0])
def test_the_octave_symmetry_a_plane_is_that_of_the_papers(plane, spacing):
    """Of the pairs in a disc."""
    octave = np.random.default_rng(plane).random((5, 17, 19), np.float32)
    config = MustConfig(intervals=3, base_sigma=2.6, radius=1.6, falloff=1.1, gain=30.0)
    symmetry = octave_symmetry(one_octave(octave, spacing), 0, config, contrast=0.3)
    assert symmetry.shape == (5, 17, 19)
    sigma = 0.5 * config.base_sigma * 2 ** (plane / 3)
    radius, width = config.radius * sigma, 2 * 1.1 * sigma
    ring = [(x, y) for x, y in oracles.half_ring(1, int(radius)) if np.hypot(x, y) <= radius]
    gain = 30 * sigma / (8 * 0.3)
    expected = oracles.symmetry(
        octave[plane][:, :, None], "isotropic", 0, 0, width, gain, "mirror", ring
    )
    distances = [2 * np.hypot(dx, dy) for dx, dy in ring]
    total = sum(np.exp(-((d / width) ** 2) / 2) / (width * np.sqrt(2 * np.pi)) for d in distances)
    expected *= (spacing * sigma) ** config.scale_power / total
    np.testing.assert_allclose(symmetry[plane], expected, rtol=1e-4, atol=1e-4 * expected.max())


@pytest.mark.parametrize("shape", [(240, 320), (241, 323), (243, 322)])
def test_the_last_planes_of_an_octave_are_the_first_of_the_next(shape):
    """Interpolated; they differ from planes that are computed only by the filter of gradients."""
    image, config = texture(5, shape), MustConfig()
    space = gaussian_scale_space(image, config.sift(), further_planes=2)
    contrast, s = float(image.std()), config.intervals
    coarser = octave_symmetry(space, 1, config, contrast)
    computed = octave_symmetry(space, 0, config, contrast)
    interpolated = octave_symmetry(space, 0, config, contrast, coarser)
    np.testing.assert_array_equal(interpolated[:s], computed[:s])
    inner = np.s_[s:, 16:-16, 16:-16]
    assert np.corrcoef(interpolated[inner].ravel(), computed[inner].ravel())[0, 1] > 0.99


@pytest.mark.parametrize("brightness", [0.1, 0.9])
def test_a_disc_has_a_point_at_its_center(brightness):
    points = Must()(discs((80.3, 60.6, 9, brightness)))
    assert np.hypot(*(points.xy[0] - (80.3, 60.6))) < 0.2


def test_a_disc_twice_as_large_has_a_point_twice_as_large():
    small, large = (Must()(discs((90, 80, radius, 0.9))) for radius in (7, 14))
    assert large.size[0] / small.size[0] == pytest.approx(2, rel=0.15)


def test_points_of_an_image_and_of_its_mirror():
    image = texture(3, (121, 151))
    config = MustConfig(upright=True)
    here, there = Must(config)(image), Must(config)(np.ascontiguousarray(image[:, ::-1]))
    assert min(len(here), len(there)) > 20
    mirrored = there.xy * (-1, 1) + (150, 0)
    distance = np.hypot(*(here.xy[:, None] - mirrored[None]).transpose(2, 0, 1)).min(axis=1)
    assert (distance < 0.02).mean() > 0.97  # rounding decides at a threshold or between equals


@settings(max_examples=5)
@example(69, 0.5)
@given(st.integers(0, 1000), st.sampled_from([0.5, 0.25, 0.1]))
def test_less_contrast_gives_the_same_points_in_the_same_order(seed, factor):
    image = texture(seed)
    high, low = (Must()(each, describe=False) for each in (image, 0.5 + factor * (image - 0.5)))
    assert min(len(high), len(low)) > 20
    apart = np.hypot(*(high.xy[:, None] - low.xy[None]).transpose(2, 0, 1))
    nearest = apart.argmin(1)
    same = (apart.min(1) < 0.05) & (np.abs(low.response[nearest] / high.response - 1) < 0.01)
    assert same.mean() > 0.97  # rounding decides at a threshold or between equals
    np.testing.assert_allclose(low.xy[:10], high.xy[:10], atol=0.05)


@pytest.mark.shared
@pytest.mark.parametrize(
    ("disturbance", "better"), [("noise:20", 1.1), ("contrast:0.25", 1.1), ("blur:2", 1.1)]
)
def test_the_claims_of_the_source(shared, disturbance, better):
    """More of its places come back under noise, low contrast and blur than of SIFT's."""
    pairs = homography_pairs(shared / "data" / "pairs" / "oxford")
    chosen = [pair for pair in pairs if pair.second.stem == "3"]
    degradation = Degradation.parse(disturbance)
    configs = (SiftConfig(ranking="response"), MustConfig())  # as of the source's SIFT
    weak = [replace(each, contrast_threshold=1e-4, upright=True) for each in configs]
    found = []
    for detect in (Sift(weak[0]), Must(weak[1])):

        def undescribed(image, detect=detect):
            points = detect(image, describe=False)[:300]
            return SimpleNamespace(xy=points.xy, descriptors=np.zeros((len(points), 1), np.uint8))

        scores = score_detector(undescribed, chosen, degradation)
        found.append(scores.mean().repeatability)
    print(f"\n{disturbance}: SIFT {found[0]:.3f}, MUST {found[1]:.3f}")
    assert found[1] > better * found[0]
