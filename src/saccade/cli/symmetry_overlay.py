"""Edge pairs that contribute to points and regions of symmetry, for `saccade detect`."""

from math import ceil, log2
from typing import Any

from saccade.attention import SymmetryConfig, symmetric_pairs
from saccade.keypoints import MustConfig, SymRoidConfig
from saccade.types import Float32Array, Keypoints, SymmetricPairs

MAX_PAIRS = 4
"""Pairs drawn for each point, the strongest."""
MAX_OFFSET = 2.0
"""Pixels from a point to the cell of the pyramid whose pairs are drawn."""
LEVEL_SIGMA = 1.5
"""Approximate blur of a pyramid level, in its own pixels."""


def contributing_pairs(
    detector: Any, image: Float32Array, keypoints: Keypoints
) -> list[SymmetricPairs]:
    """The pairs about each point, weighted as by its detector.

    The pyramid has fewer scales than MUST: its points use the nearest level.

    Args:
        detector: a `Must` or a `SymRoid`.
        image: (H, W, 3) in [0, 1].
        keypoints: its detections.
    """
    config = detector.config
    if isinstance(config, SymRoidConfig) and config.frame == "scale-space":
        config = config.must()
    symmetry = must_symmetry if isinstance(config, MustConfig) else symroid_symmetry
    pairs = []
    for (x, y), size in zip(keypoints.xy.tolist(), keypoints.size.tolist(), strict=True):
        settings = symmetry(config, size)
        near = symmetric_pairs(
            image, (x, y), settings, radius=min(MAX_OFFSET, size / 4), max_pairs=MAX_PAIRS
        )
        pairs.append(near[:MAX_PAIRS])
    return pairs


def must_symmetry(config: MustConfig, size: float) -> SymmetryConfig:
    """The symmetry that MUST measures for a point of `size` pixels."""
    level = max(0, round(log2(size / 2 / LEVEL_SIGMA)))
    sigma = size / 2 / 2**level
    return SymmetryConfig(
        kind="isotropic",
        channels="gray",
        levels=(level,),
        level_weights=(1.0,),
        outer=max(1, ceil(config.radius * sigma)),
        sigma=max(0.1, 2 * config.falloff * sigma),
        map_level=level,
        viewing_size=None,
    )


def symroid_symmetry(config: SymRoidConfig, _: float) -> SymmetryConfig:
    """The symmetry of SymRoID's map, of any size."""
    return SymmetryConfig(
        kind="isotropic",
        channels="gray",
        levels=config.levels,
        level_weights=(1.0,) * len(config.levels),
        inner=config.inner,
        outer=config.outer,
        sigma=config.sigma,
        gain=config.gain,
        map_level=config.levels[0],
        viewing_size=None,
    )
