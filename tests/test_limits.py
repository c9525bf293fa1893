"""Settings refuse what is no finite number, and combinations that do not go together."""

from math import inf, nan, nextafter
from typing import get_type_hints

import numpy as np
import pytest

from saccade.attention import (
    AttentionConfig,
    BooleanConfig,
    ContrastConfig,
    ScanpathConfig,
    ScanpathModelConfig,
    SymmetryConfig,
)
from saccade.attention.video import VideoConfig
from saccade.errors import ConfigError
from saccade.keypoints import MustConfig, SiftConfig, SymRoidConfig
from saccade.simulation import DriveConfig, WorldConfig
from saccade.slam import EkfConfig
from saccade.visual import VisualConfig

OWN_INF = float("1e999")
"""Infinite, but not the object `math.inf`."""
NO_WEIGHT = {"intensity_weight": 0, "color_weight": 0, "orientation_weight": 0}
CONFIGS = (
    *(ContrastConfig, SymmetryConfig, ScanpathConfig, AttentionConfig, BooleanConfig),
    *(SiftConfig, MustConfig, SymRoidConfig, WorldConfig, DriveConfig, VideoConfig),
    *(ScanpathModelConfig, VisualConfig, EkfConfig),
)


@pytest.mark.parametrize("config", CONFIGS)
def test_nan_and_other_types_are_refused_by_name(config):
    for name, kind in get_type_hints(config).items():
        for wrong in {float: (nan, "2"), int: (nan, 1.5, inf)}.get(kind, ()):
            with pytest.raises(ConfigError, match=f"^{name}: expected"):
                config(**{name: wrong})


@pytest.mark.parametrize(
    ("config", "name", "taken", "refused"),
    [
        (SiftConfig, "density", (0.5, 1), (0.25, 0.75, 2)),
        (SiftConfig, "neighbors", (10, 26), (9, 27)),
        (ContrastConfig, "gabor_size", (3, 99), (1, 2, 98, 101)),
        (EkfConfig, "gate", (0.9999,), (1.0, 0.0)),
        (EkfConfig, "start_sigma", ((0.0, 0.0, 0.0),), ((0.0, 0.0), (0.0, -1.0, 0.0))),
        (VisualConfig, "range_limits", ((0.0, 1.0),), ((1.0, 1.0), (-1.0, 1.0), (0.0, inf))),
        (SymmetryConfig, "variant", (), ("nonsense", 3.5)),
    ],
)
def test_a_setting_is_taken_up_to_its_limits(config, name, taken, refused):
    for value in taken:
        assert getattr(config(**{name: value}), name) == value
    for value in refused:
        with pytest.raises(ConfigError, match=name):
            config(**{name: value})


@pytest.mark.parametrize("config", [ContrastConfig, SymmetryConfig])
def test_levels_rise_and_stay_within_a_pyramid(config):
    name = "levels" if config is not ContrastConfig else "orientation_scales"
    pairs = config is ContrastConfig
    weights = {"level_weights": (1.0, 1.0)} if config is SymmetryConfig else {}
    config(**{name: ((0, 30),) if pairs else (0, 30), **weights})
    for wrong in ((-1, 1), (1, 1), (2, 1), (30, 31)):
        with pytest.raises(ConfigError, match=name):
            config(**{name: (wrong,) if pairs else wrong, **weights})
    with pytest.raises(ConfigError, match=name):
        config(**{name: ()})


@pytest.mark.parametrize(
    ("config", "words", "settings"),
    [
        (ContrastConfig, "orientation_scales", {"orientation_scales": ((1, 2, 3),)}),
        (ContrastConfig, "scale_weights", {"scale_weights": (1.0, 1.0)}),
        (ContrastConfig, "scale_weights", {"scale_weights": (1.0, 1.0, 0.0)}),
        (ContrastConfig, "scale_weights", {"scale_weights": (1.0, 1.0, nextafter(1e6, inf))}),
        (ContrastConfig, "orientations", {"orientations": ()}),
        (ContrastConfig, "smoothing", {"normalize_at": "center"}),
        (ContrastConfig, "weights", NO_WEIGHT),
        (SymmetryConfig, "channels", {"variant": "kootstra2010"}),
        (SymmetryConfig, "level_weights", {"levels": (1, 2), "level_weights": (1.0,)}),
        (SymmetryConfig, "level_weights", {"levels": (1,), "level_weights": (0.0,)}),
        (SymmetryConfig, "level_weights", {"levels": (1,), "level_weights": (OWN_INF,)}),
        (SymmetryConfig, "inner", {"inner": 12.5, "outer": 12.0}),
        (SymmetryConfig, "outer", {"outer": 0}),
        (SiftConfig, "grid", {"grid": "shifted", "density": 0.5}),
        (SiftConfig, "spread", {"spread": True}),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_refused(config, words, settings):
    with pytest.raises(ConfigError, match=words):
        config(**settings)


CONTRAST = ContrastConfig(
    scales=((2, 3), (3, 5)), scale_weights=(1.0, 1.0), orientation_scales=((3, 4),), map_level=4
)
SYMMETRY = SymmetryConfig(levels=(2, 3), level_weights=(1.0, 1.0), map_level=4)


@pytest.mark.parametrize("config", [CONTRAST, SYMMETRY])
@pytest.mark.parametrize(
    ("shape", "coarser"),
    [
        ((600, 800), 0),
        ((1600, 1200), 1),
        ((1200, 3200), 2),
        ((1100, 10), 0),  # less than half a level
        ((10, 1140), 1),
        ((400, 300), -1),
        ((200, 150), -2),
        ((50, 50), -2),  # the finest level is the image itself
    ],
)
def test_levels_follow_the_longer_side(config, shape, coarser):
    found = config.at_size(shape)
    assert found.viewing_size is None
    assert found.map_level == 4 + coarser
    if config is CONTRAST:
        pairs = np.array([*config.scales, *config.orientation_scales])
        assert (np.array([*found.scales, *found.orientation_scales]) == pairs + coarser).all()
    else:
        assert found.levels == (2 + coarser, 3 + coarser)
    assert found.at_size((5, 5)) is found
