import numpy as np
import pytest

from saccade.attention import SymmetryConfig, symmetric_pairs, symmetry_saliency
from saccade.errors import ConfigError, ImageError
from support import oracles_symmetry as oracles

ALL = 10_000


def spot(x, y, shape=(120, 160)):
    """A bright disc on a dark ground."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return (np.hypot(columns - x, rows - y) < 9).astype(np.float32)


def test_pairs_of_a_disc_face_each_other_across_its_middle():
    config = SymmetryConfig(levels=(1, 2), level_weights=(3.0, 2.0), viewing_size=None)
    pairs = symmetric_pairs(spot(100, 60), (100, 60), config)
    assert sorted(pairs.level) == [1, 1, 1, 1, 2, 2, 2, 2]
    assert (np.diff(pairs.strength) <= 0).all()
    middles = (pairs.first + pairs.second) / 2
    np.testing.assert_allclose(middles, (100, 60) * np.ones((8, 1)), atol=2)
    for place, angle in ((pairs.first, pairs.first_angle), (pairs.second, pairs.second_angle)):
        inwards = (100, 60) - place
        heading = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        assert ((inwards * heading).sum(axis=1) > 0.9 * np.hypot(*inwards.T)).all()
    assert repr(pairs) == "SymmetricPairs(8 pairs)"


def test_all_pairs_of_a_place_are_its_symmetry():
    """What every pair contributes adds up to the value of the map."""
    image = np.random.default_rng(4).random((30, 40)).astype(np.float32)
    config = SymmetryConfig(
        kind="isotropic",
        channels="gray",
        gain=60.0,
        border="missing",
        levels=(0,),
        level_weights=(2.0,),
        map_level=1,
        viewing_size=None,
    )
    level = symmetry_saliency(image, config).levels[0]
    for x, y in ((20, 15), (3, 2), (38, 20), (20, 28)):
        pairs = symmetric_pairs(image, (x, y), config, max_pairs=ALL)
        assert pairs.strength.sum() == pytest.approx(2 * level[y, x], rel=1e-4)
    expected = oracles.symmetry(image[10:21, 15:26, None], "isotropic", 1, 4, 4, 60)[5, 5]
    pairs = symmetric_pairs(image[10:21, 15:26], (5, 5), config, max_pairs=ALL)
    assert pairs.strength.sum() == pytest.approx(2 * expected, rel=1e-4)


def test_within_a_radius_the_most_symmetric_place_is_taken():
    config = SymmetryConfig(kind="isotropic", levels=(2,), level_weights=(1.0,), viewing_size=None)
    off = symmetric_pairs(spot(100, 60), (92, 66), config, max_pairs=1)
    near = symmetric_pairs(spot(100, 60), (92, 66), config, radius=12, max_pairs=1)
    middle = (near.first[0] + near.second[0]) / 2
    assert np.hypot(*(middle - (100, 60))) < 4
    assert near.strength[0] > off.strength[0]


def test_nothing_is_symmetric_on_a_flat_ground():
    assert len(symmetric_pairs(np.full((80, 80), 0.5), (40, 40))) == 0


@pytest.mark.parametrize("xy", [(-1, 5), (5, 40), (50, 5), (np.nan, 5)])
def test_a_place_outside_is_refused(xy):
    with pytest.raises(ImageError, match="position: expected inside 50 x 40 px"):
        symmetric_pairs(np.zeros((40, 50)), xy)


@pytest.mark.parametrize("broken", [{"max_pairs": 0}, {"radius": -1.0}])
def test_a_broken_setting_is_named(broken):
    with pytest.raises(ConfigError, match=next(iter(broken))):
        symmetric_pairs(np.zeros((40, 40)), (5, 5), **broken)
