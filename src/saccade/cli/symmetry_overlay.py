"""What `saccade detect` draws of the pairs that made symmetric points."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade.attention import SymmetryConfig
    from saccade.types import Float32Array, Keypoints, SymmetricPairs

MAX_PAIRS = 4
"""Pairs of those that made a point, the strongest."""
BINOMIAL = 1.5
"""Blur of a pyramid level in its own pixels, about."""


def contributing_pairs(
    find: Any, image: "Float32Array", points: "Keypoints"
) -> "list[SymmetricPairs]":
    """The pairs about each point, as its detector weighs them.

    The pyramid has fewer scales than the detector: MUST's are those of the level next to its own.

    Args:
        find: a `Must` or a `SymRoid`.
        image: (H, W, 3) in [0, 1].
        points: what it found.
    """
    from saccade.attention import symmetric_pairs
    from saccade.keypoints import Must

    settings = as_must if isinstance(find, Must) else as_symroid
    pairs = []
    for number in range(len(points)):
        point = points[number : number + 1]
        place = float(point.xy[0, 0]), float(point.xy[0, 1])
        config = settings(find, float(point.size[0]))
        pairs.append(
            symmetric_pairs(image, place, config, radius=2.0, max_pairs=MAX_PAIRS)[:MAX_PAIRS]
        )
    return pairs


def as_must(find: Any, size: float) -> "SymmetryConfig":
    """The symmetry that MUST measures for a point of a size in pixels."""
    from math import ceil, log2

    from saccade.attention import SymmetryConfig

    level = max(0, round(log2(size / 2 / BINOMIAL)))
    sigma = size / 2 / 2**level
    return SymmetryConfig(
        kind="isotropic",
        channels="gray",
        levels=(level,),
        level_weights=(1.0,),
        outer=max(1, ceil(find.config.radius * sigma)),
        sigma=max(0.1, 2 * find.config.falloff * sigma),
        map_level=level,
        viewing_size=None,
    )


def as_symroid(find: Any, size: float) -> "SymmetryConfig":
    """The symmetry that SymRoID measures, whatever the size."""
    from saccade.attention import SymmetryConfig

    config = find.config
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
