"""Feature maps from which a fitted model predicts fixations.

A feature map is the logarithm of a map of `attention_saliency`, relative to its mean over the
image, so that their weighted sum is the logarithm of a product of powers. "NAME around 8" is the
same of the map smoothed by 8 cells: what surrounds a position. The geometry of the image (center,
height, border) and faces are features as they are.
"""

from collections.abc import Collection

import cv2
import numpy as np

from saccade.attention.boolean_maps import boolean_saliency
from saccade.attention.channels import CONSPICUITY
from saccade.attention.combined import (
    AttentionConfig,
    AttentionMaps,
    FaceDetector,
    attention_saliency,
)
from saccade.io.image import check_image, in_unit_range
from saccade.scale.pyramid import FloatMap, resize
from saccade.types import FloatArray, Image

FLOOR = 0.1
"""Added to a map of mean 1 before its logarithm."""
SURROUNDINGS = (3, 8)
"""Standard deviations in cells of the smoothed maps."""
AROUND = " around "
"""Between the parts of a feature's name."""
GEOMETRY = ("center x", "center y", "height", "border", "edge")
"""Squared distance from the center along each axis, downward position, distance from the border as
fractions of the sides, and closeness to it."""
EDGE = 0.05
"""Distance from the border at which the closeness to it has fallen to 1 / e."""
FACES = "faces"
SKIN = ((15.0, 12.0), (18.0, 12.0))
"""Mean and standard deviation of a* and b* of skin in CIE L*a*b*."""
EARLY = ("attention", "attention around 3", "center x", "center y", "height", "border")
"""Features whose weight differs for the first fixations of a scanpath."""


def map_names(config: AttentionConfig) -> list[str]:
    """The names of the maps of a configuration."""
    names = ["attention", "contrast", "symmetry", "boolean", "boolean edges"]
    names += ["intensity", "color", "orientation", "color distance", "skin"]
    names += [f"symmetry {i}" for i in range(len(config.symmetry.levels))]
    for channel in CONSPICUITY:
        oriented = channel == "orientation"
        scales = config.contrast.orientation_scales if oriented else config.contrast.scales
        names += [f"{channel} {i}" for i in range(len(scales))]
    return names


def feature_names(config: AttentionConfig, *, faces: bool) -> list[str]:
    """The names of all features; of faces only with a detector of faces."""
    maps = map_names(config)
    around = [f"{name}{AROUND}{cells}" for cells in SURROUNDINGS for name in maps]
    return [*maps, *around, *GEOMETRY, *([FACES] if faces else [])]


def feature_maps(
    image: Image,
    names: Collection[str],
    config: AttentionConfig | None = None,
    faces: FaceDetector | None = None,
) -> FloatArray:
    """The features of an image, in the order of their names.

    Args:
        image: as `attention_saliency` takes it.
        names: of `feature_names`.
        config: of the maps.
        faces: finds (n, 4) boxes; None for no faces.

    Returns:
        (k, h, w) with the k names, of the size of the attention map.

    Raises:
        ImageError: as `attention_saliency`.
    """
    maps = base_maps(image, config or AttentionConfig(), faces)
    shape = maps["attention"].shape
    fixed = geometry(shape) | {FACES: maps.pop(FACES)}

    def feature(name: str) -> FloatArray:
        if name in fixed:
            return fixed[name]
        source, _, cells = name.partition(AROUND)
        return relative_log(maps[source], float(cells or 0))

    return np.stack([feature(name) for name in names])


def base_maps(
    image: Image, config: AttentionConfig, faces: FaceDetector | None
) -> dict[str, FloatMap]:
    """The maps by name, all of the size of the attention map; a scale may be missing."""
    found = attention_saliency(image, config, keep_features=True, faces=faces)
    shape = found.saliency.shape
    boolean = found.boolean.saliency
    if config.boolean_weight == 0:
        boolean = boolean_saliency(image, config.boolean).saliency
    distance, skin = color_maps(image, found.image_shape)
    maps = {
        "attention": found.saliency,
        "contrast": found.contrast.saliency,
        "symmetry": found.symmetry.saliency,
        "boolean": boolean,
        "boolean edges": np.maximum(boolean - cv2.GaussianBlur(boolean, (0, 0), 6), 0),
        "intensity": found.contrast.intensity,
        "color": found.contrast.color,
        "orientation": found.contrast.orientation,
        "color distance": distance,
        "skin": skin,
        FACES: np.zeros(shape) if found.faces is None else found.faces,
    }
    maps = dict.fromkeys(map_names(config), np.zeros(shape)) | maps | scale_maps(found, config)
    return {name: resize(np.asarray(values, np.float64), shape) for name, values in maps.items()}


def scale_maps(maps: AttentionMaps, config: AttentionConfig) -> dict[str, FloatMap]:
    """Symmetry and contrast by scale, numbered as in the configuration."""
    symmetry = config.symmetry.at_size(maps.image_shape)
    contrast = config.contrast.at_size(maps.image_shape)
    found: dict[str, FloatMap] = {
        f"symmetry {i}": maps.symmetry.levels[level]
        for i, level in enumerate(symmetry.levels)
        if level in maps.symmetry.levels
    }
    for each in maps.contrast.features:
        oriented = each.channel.name == "orientation"
        scales = contrast.orientation_scales if oriented else contrast.scales
        name = f"{each.channel.name} {list(scales).index((each.center, each.surround))}"
        found[name] = found.get(name, 0) + each.values  # over the angles
    return found


def color_maps(image: Image, shape: tuple[int, int]) -> tuple[FloatMap, FloatMap]:
    """Distance from the mean color in CIE L*a*b*, and likeness to skin; (h, w) of a small image."""
    scale = min(1.0, 200 / max(shape))
    small = max(1, round(shape[0] * scale)), max(1, round(shape[1] * scale))
    pixels = resize(in_unit_range(check_image(image)), small)
    rgb = np.repeat(pixels[:, :, None], 3, 2) if pixels.ndim == 2 else pixels
    lab = cv2.cvtColor(np.ascontiguousarray(rgb, np.float32), cv2.COLOR_RGB2LAB)
    distance = np.sqrt(((lab - lab.mean((0, 1))) ** 2).sum(2))
    squared = sum(
        ((lab[:, :, i] - mean) / sigma) ** 2 for i, (mean, sigma) in enumerate(SKIN, start=1)
    )
    return distance, np.exp(-squared / 2)


def geometry(shape: tuple[int, ...]) -> dict[str, FloatArray]:
    """The features that depend on the position alone, (h, w) each."""
    y, x = (
        axis.astype(np.float64)
        for axis in np.meshgrid(
            *((np.arange(side) + 0.5) / side - 0.5 for side in shape), indexing="ij"
        )
    )
    border = np.minimum(0.5 - abs(x), 0.5 - abs(y))
    return dict(zip(GEOMETRY, (x * x, y * y, y, border, np.exp(-border / EDGE)), strict=True))


def relative_log(values: FloatMap, cells: float) -> FloatArray:
    """Logarithm of a map, not negative, over its mean; smoothed by so many cells before."""
    if cells > 0:
        values = cv2.GaussianBlur(values, (0, 0), cells, borderType=cv2.BORDER_REFLECT)
    mean = float(values.mean())
    scaled = values / mean if mean > 0 else np.ones_like(values)
    return np.asarray(np.log(np.maximum(scaled, 0) + FLOOR), np.float64)
