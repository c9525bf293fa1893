"""Attention saliency: the weighted sum of symmetry, Boolean map and contrast saliency.

The saliency of each channel is normalized by N, as the conspicuity maps are in A.14, so that a
channel with a single outstanding maximum dominates a channel with many equal maxima.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from saccade.attention.boolean_maps import BooleanConfig, boolean_maps
from saccade.attention.contrast import ContrastConfig, ContrastMaps, contrast_maps
from saccade.attention.contrast_config import MAX_WEIGHT
from saccade.attention.maps import SaliencyMaps
from saccade.attention.normalize import (
    NORMALIZATIONS,
    Normalization,
    Parameters,
    check_normalization,
    normalize,
    position_prior,
    rescale,
    sharpen,
)
from saccade.attention.symmetry import SymmetryConfig, SymmetryMaps, symmetry_maps
from saccade.errors import ImageError, Settings, setting
from saccade.io.image import check_image
from saccade.scale.pyramid import FloatMap, resize
from saccade.types import FloatArray, Image

FaceDetector: TypeAlias = Callable[[Image], FloatArray]
"""Function from an image to (n, 4) face boxes: left, top, width, height in pixels."""

FACE_SPREAD = 0.35
"""Standard deviation of the Gaussian at a face, as a fraction of each side of its box."""


@dataclass(frozen=True)
class AttentionConfig(Settings):
    """Weights of contrast, symmetry and Boolean maps, and the settings of each.

    The default predicts human fixations best; docs/boolean-maps.md describes how it was chosen.
    """

    contrast_weight: float = setting(0.05, above=0, maximum=MAX_WEIGHT)
    """Weight of contrast in the saliency."""
    symmetry_weight: float = setting(1.0, above=0, maximum=MAX_WEIGHT)
    """Weight of symmetry in the saliency."""
    boolean_weight: float = setting(0.6, 0, MAX_WEIGHT)
    """Weight of Boolean maps in the saliency; with 0 they are not computed and their map is 0."""
    face_weight: float = setting(1.0, 0, MAX_WEIGHT)
    """Weight of faces relative to the sum of the channels scaled to [0, 1]; it has an effect only
    if `attention_saliency` receives a face detector."""
    normalization: Normalization = setting("local-maxima", choices=NORMALIZATIONS)
    """Normalization of the maps: a name of `saccade.attention.normalize.NORMALIZATIONS`, a function
    such as those in its rows, or module:function."""
    sharpening: float = setting(1.4, above=0, maximum=100)
    """Exponent of the sum scaled to [0, 1]."""
    center_prior: float | None = setting(None, above=0)
    """Standard deviation of the center prior, a Gaussian factor of the saliency, as a fraction of
    each side; None for no prior."""
    center_height: float = setting(0.0, -0.5, 0.5)
    """Height of the center prior above the middle of the image, as a fraction of its height."""
    border_prior: float | None = setting(None, above=0)
    """Width of the border prior, as a fraction of each side: the saliency is multiplied by `1 -
    exp(-distance / border_prior)`, with the distance from the border; None for no prior."""
    contrast: ContrastConfig = field(default_factory=ContrastConfig)
    """Settings of the contrast model."""
    symmetry: SymmetryConfig = field(default_factory=SymmetryConfig)
    """Settings of the symmetry model."""
    boolean: BooleanConfig = field(default_factory=BooleanConfig)
    """Settings of the Boolean map model."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_normalization(self.normalization, "mirrored")

    @classmethod
    def free_viewing(cls) -> Self:
        """The default with center and border priors, for photographs viewed on a screen.

        Subjects prefer the center of a photograph, somewhat above the middle, and avoid the border,
        partly because photographers center their subject. The priors raise AUC, NSS and CC and
        lower the shuffled AUC. docs/boolean-maps.md describes how they were chosen.
        """
        return cls(center_prior=0.4, center_height=0.1, border_prior=0.04)

    @classmethod
    def kootstra2010(cls) -> Self:
        """The contrast and symmetry models of Kootstra (2010), with equal weights."""
        return cls(
            contrast_weight=1.0,
            boolean_weight=0.0,
            sharpening=1.0,
            contrast=ContrastConfig.kootstra2010(),
            symmetry=SymmetryConfig.kootstra2010(),
        )


class Channel(NamedTuple):
    """A channel of the sum, which is a model of its own as well."""

    weight: str
    """Field of its weight in `AttentionConfig`; a channel of weight 0 is not computed."""
    settings: type[Settings]
    """Class of its settings; `AttentionConfig` may have a field of them under its name."""
    maps: Callable[[npt.NDArray[Any], Any, bool], SaliencyMaps]
    """Its maps, of any size, from a validated image and its settings; the last argument is
    `keep_features`."""


CHANNELS = {
    "contrast": Channel(
        "contrast_weight",
        ContrastConfig,
        lambda pixels, settings, keep: contrast_maps(pixels, settings, keep_features=keep),
    ),
    "symmetry": Channel(
        "symmetry_weight",
        SymmetryConfig,
        lambda pixels, settings, _: symmetry_maps(pixels, settings),
    ),
    "boolean": Channel(
        "boolean_weight", BooleanConfig, lambda pixels, settings, _: boolean_maps(pixels, settings)
    ),
}
"""The channels of the sum by name, in the order of their layers."""


def channel_maps(
    name: str, pixels: npt.NDArray[Any], config: AttentionConfig, *, keep_features: bool = False
) -> SaliencyMaps:
    """Maps of a channel with its settings in the configuration, or else its default."""
    row = CHANNELS[name]
    return row.maps(pixels, getattr(config, name, None) or row.settings(), keep_features)


@dataclass(frozen=True, eq=False, repr=False)
class AttentionMaps(SaliencyMaps):
    """Saliency in [0, 1], at the size of the contrast map, and the maps of the channels."""

    channels: Mapping[str, SaliencyMaps]
    """Result of each channel by its name in `CHANNELS`; a channel of weight 0 is 0 everywhere."""
    faces: FloatMap | None = None
    """(h, w) in [0, 1], 1 at the center of a face; None without a detector."""

    @property
    def contrast(self) -> ContrastMaps:
        """Contrast saliency and its conspicuity maps."""
        return cast("ContrastMaps", self.channels["contrast"])

    @property
    def symmetry(self) -> SymmetryMaps:
        """Symmetry saliency and its levels."""
        return cast("SymmetryMaps", self.channels["symmetry"])

    @property
    def boolean(self) -> SaliencyMaps:
        """Boolean map saliency."""
        return self.channels["boolean"]

    @property
    def layers(self) -> dict[str, FloatMap]:
        """The combined saliency, the saliency of each channel and the conspicuity maps, by name."""
        channels = {name: maps.saliency for name, maps in self.channels.items()}
        faces = {} if self.faces is None else {"faces": self.faces}
        conspicuity = {n: each for n, each in self.contrast.layers.items() if n != "saliency"}
        return {"saliency": self.saliency, **channels, **faces, **conspicuity}


def attention_saliency(
    image: Image,
    config: AttentionConfig | None = None,
    *,
    keep_features: bool = False,
    faces: FaceDetector | None = None,
    bgr: bool = False,
) -> AttentionMaps:
    """Saliency from contrast, symmetry and Boolean maps.

    Choice of settings:

    - `AttentionConfig.free_viewing()` predicts where people look at a photograph (AUC, NSS, CC).
    - The default has no position prior. It suits the shuffled AUC, images that nobody framed, such
      as a robot's, and models with a center bias of their own, such as `saccade.sample_scanpaths`.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: weights and settings of the models.
        keep_features: whether the contrast result includes its feature maps.
        faces: face detector, returning (n, 4) boxes; None for a model without faces.
        bgr: True for an image in OpenCV's channel order, as `cv2.imread` returns it.

    Returns:
        Saliency (h, w) and the maps of each model.

    Raises:
        ImageError: as `contrast_saliency` and `symmetry_saliency`.
    """
    pixels = check_image(image, bgr=bgr)
    return attention_maps(pixels, config, keep_features=keep_features, faces=faces)


def attention_maps(
    pixels: npt.NDArray[Any],
    config: AttentionConfig | None = None,
    *,
    keep_features: bool = False,
    faces: FaceDetector | None = None,
) -> AttentionMaps:
    """Attention saliency of a validated image; see `attention_saliency`."""
    config = config or AttentionConfig()
    channels = {
        name: channel_maps(name, pixels, config, keep_features=keep_features)
        for name, row in CHANNELS.items()
        if getattr(config, row.weight) > 0
    }
    contrast = channels["contrast"]
    shape, image_shape = contrast.saliency.shape, contrast.image_shape
    summed = np.zeros(shape, np.float64)
    for name, maps in channels.items():
        at_map = resize(maps.saliency, shape)
        normalized = normalize(at_map, config.normalization, Parameters(radius=None))
        summed += getattr(config, CHANNELS[name].weight) * normalized
    unused = SaliencyMaps(np.zeros(shape, np.float32), image_shape)
    found = None
    if faces is not None:
        found = face_map(faces(pixels), image_shape, shape)
        summed = rescale(summed) + config.face_weight * found
    saliency = sharpen(rescale(summed), config.sharpening).astype(np.float32)
    prior = position_prior(
        *(saliency.shape, config.center_prior, config.center_height, config.border_prior)
    )
    return AttentionMaps(
        saliency=saliency * prior.astype(np.float32),
        without_center_bias=saliency,
        channels={name: channels.get(name, unused) for name in CHANNELS},
        image_shape=image_shape,
        faces=found,
    )


def face_map(boxes: FloatArray, image_shape: tuple[int, int], shape: tuple[int, int]) -> FloatMap:
    """Maximum of Gaussians centered at the faces, each with a peak of 1.

    Args:
        boxes: (n, 4) left, top, width and height in pixels of the image; n may be 0.
        image_shape: (H, W) of the image.
        shape: (h, w) of the map, whose cells tile the image.

    Returns:
        (h, w) float32 in [0, 1].

    Raises:
        ImageError: the boxes are not finite, not of shape (n, 4), or have no area.
    """
    boxes = np.asarray(boxes, np.float64).reshape(-1, 4) if np.size(boxes) else np.zeros((0, 4))
    if not (np.isfinite(boxes).all() and (boxes[:, 2:] > 0).all()):
        raise ImageError("faces: expected finite boxes of left, top, width and height above 0")
    (rows, columns), (height, width) = shape, image_shape
    y = (np.arange(rows) + 0.5) * (height / rows)  # (h,) centers of the cells in pixels
    x = (np.arange(columns) + 0.5) * (width / columns)
    faces = np.zeros(shape)
    for left, top, across, down in boxes:
        along_y = np.exp(-(((y - top - down / 2) / (FACE_SPREAD * down)) ** 2) / 2)
        along_x = np.exp(-(((x - left - across / 2) / (FACE_SPREAD * across)) ** 2) / 2)
        faces = np.maximum(faces, np.outer(along_y, along_x))
    return faces.astype(np.float32)
