"""Differentiable contrast saliency of image batches in PyTorch, and losses.

The loop of `saccade.attention.contrast` runs on tensors (B, h, w). Steps that are linear along each
axis are applied as matrices, which are the NumPy step's results for unit vectors.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np

from saccade.attention import contrast_steps, normalize
from saccade.attention.channels import OPPONENT, ChannelName
from saccade.attention.contrast import ContrastConfig, ContrastMaps, contrast_maps
from saccade.attention.contrast_steps import MIRRORED, Shape
from saccade.attention.maps import SaliencyMaps
from saccade.errors import ImageError, require
from saccade.extras import import_optional
from saccade.io.image import OVERSHOOT
from saccade.scale import pyramid
from saccade.types import FloatArray

__all__ = ["contrast_saliency", "kl", "nss"]

torch = import_optional("torch", "torch")

Tensor: TypeAlias = Any
"""A `torch.Tensor`."""

TINY = 2.2204e-16
"""Keeps quotients and logarithms finite, as in the MIT saliency benchmark."""
TIE = 2e-7
"""Tolerance for equal maxima of maps in [0, 1]."""


def contrast_saliency(
    images: Tensor, config: ContrastConfig | None = None, *, keep_features: bool = False
) -> ContrastMaps:
    """Contrast saliency of a batch of images, with gradients.

    Args:
        images: (B, 3, H, W) RGB in [0, 1], float32 or float64, on any device. Values are not
            checked while a CUDA graph is captured.
        config: as for `saccade.contrast_saliency`, of the variant "mirrored" and with a
            normalization that supports tensors; see `saccade.attention.normalize.NORMALIZATIONS`.
        keep_features: whether the result holds the feature maps and the pyramids.

    Returns:
        Maps (B, h, w) with the dtype and device of the images, equal to `saccade.contrast_saliency`
        up to rounding.

    Raises:
        ImageError: another shape or dtype, values outside [0, 1], or images that are too small.
        ConfigError: another variant (`kootstra2010`, `saliencytoolbox2`), or normalization.
    """
    config = config or ContrastConfig()
    require(config.variant == "mirrored", "variant", '"mirrored" for tensors', config.variant)
    normalize.check_normalization(config.normalization, "tensors")
    kind = images.dtype, images.ndim, *images.shape[1:2]
    if kind not in ((torch.float32, 4, 3), (torch.float64, 4, 3)) or images.numel() == 0:
        found = f"{images.dtype} of shape {tuple(images.shape)}"
        raise ImageError(f"images: expected float32 or float64 (B, 3, H, W), found {found}")
    if not (images.is_cuda and torch.cuda.is_current_stream_capturing()):
        low, high = (float(each) for each in images.detach().aminmax())
        if not (low >= -OVERSHOOT and high <= 1 + OVERSHOOT):
            raise ImageError(f"images: expected values in [0, 1], found {low:g} to {high:g}")
    pixels, shape = images.clamp(0, 1), (images.shape[2], images.shape[3])
    return contrast_maps(pixels, config, TENSORS, shape=shape, keep_features=keep_features)


def nss(maps: SaliencyMaps, fixations: Tensor) -> Tensor:
    """Normalized scanpath saliency of each image; a loss is its negative.

    Args:
        maps: result of `contrast_saliency`, or `SaliencyMaps(saliency, (H, W))` with any (B, h, w).
        fixations: (n, 3) number of the image in the batch, and x and y in its pixels.

    Returns:
        (B,), as `saccade.evaluation.fixations.nss` of maps of the size of the image.

    Raises:
        ImageError: an image without fixations, or a fixation outside.
    """
    values = resize(maps.saliency, maps.image_shape)
    sizes = torch.tensor([len(values), *maps.image_shape[::-1]], device=values.device)
    cells = torch.floor(fixations.to(values.device) + 0.5).long()
    counts = torch.bincount(cells[:, 0].clamp(min=0), minlength=len(values))
    if not (((cells >= 0) & (cells < sizes)).all() and counts.min() > 0):
        expected = "one or more inside each of {} images of {} x {} px, none outside"
        raise ImageError(f"fixations: expected {expected.format(*sizes.tolist())}")
    image, x, y = cells.T
    centered = values - values.mean((1, 2), keepdim=True)
    sums = torch.zeros_like(values[:, 0, 0]).index_add(0, image, centered[image, y, x])
    return sums / counts * where_positive(torch.rsqrt, centered.square().mean((1, 2)))


def kl(maps: SaliencyMaps, density: Tensor) -> Tensor:
    """Kullback-Leibler divergence of maps from the fixation density, in nats; a loss.

    Args:
        maps: as for `nss`, not negative.
        density: (B, h, w) of any size, not negative.

    Returns:
        (B,), as `saccade.evaluation.fixations.divergence` of maps of the size of the density.
    """
    saliency = resize(maps.saliency, tuple(density.shape[1:]))
    predicted, observed = (
        where_positive(lambda total: 1 / total, each.sum((1, 2), keepdim=True)) * each
        for each in (saliency, density)
    )
    return (observed * (TINY + observed / (TINY + predicted)).log()).sum((1, 2))


@lru_cache(maxsize=512)
def matrix(
    step: Callable[..., FloatArray], arguments: tuple[Any, ...], side: int, device: Any, dtype: Any
) -> Tensor:
    """(n, side) matrix of a step that is linear along an axis: its results for unit vectors."""
    columns = np.hstack([step(column[:, None], *arguments) for column in np.eye(side)])
    with torch.inference_mode(False):  # a tensor of that mode could not be used outside
        return torch.as_tensor(columns, dtype=dtype, device=device)


def along_axes(
    step: Callable[..., FloatArray], values: Tensor, *along_y: Any, along_x: Any = None
) -> Tensor:
    """Maps after a step along both axes, with its arguments for each."""
    (h, w), kind = values.shape[-2:], (values.device, values.dtype)
    rows, columns = matrix(step, along_y, h, *kind), matrix(step, along_x or along_y, w, *kind)
    return rows @ values @ columns.T


def resize(values: Tensor, shape: Shape) -> Tensor:
    """Maps at another size."""
    if values.shape[-2:] == shape:
        return values
    return along_axes(pyramid.resize, values, (shape[0], 1), along_x=((shape[1], 1),))


def smooth(values: Tensor, sigma: float) -> Tensor:
    """Maps filtered by a Gaussian of `sigma` cells."""
    return along_axes(normalize.smooth, values, sigma) if sigma else values


def filter_lines(values: Tensor, along_x: FloatArray, along_y: FloatArray) -> Tensor:
    """Maps filtered along both axes, mirrored at their borders."""
    return along_axes(filter_column, values, tuple(along_y), along_x=(tuple(along_x),))


def filter_column(column: FloatArray, kernel: tuple[float, ...]) -> FloatArray:
    return contrast_steps.filter_lines(column, np.ones(1), np.array(kernel))


def where_positive(function: Callable[[Tensor], Tensor], values: Tensor) -> Tensor:
    """A function of the values above 0; 0, without a gradient, for the others."""
    above = values > 0
    return torch.where(above, function(torch.where(above, values, 1)), 0)


def gabor_energies(level: Tensor, config: ContrastConfig) -> list[Tensor]:
    """Magnitude of the response to each Gabor pair (A.6)."""
    steps: dict[str, Any] = {
        "filter_lines": filter_lines,
        "box_mean": partial(along_axes, contrast_steps.box_mean),
        "magnitude": lambda even, odd: where_positive(torch.sqrt, even.square() + odd.square()),
    }
    gabors = contrast_steps.gabors(config)
    return [contrast_steps.gabor_energy(level, *gabor, **steps) for gabor in gabors]


def rgb_channels(rgb: Tensor, config: ContrastConfig) -> dict[ChannelName, Tensor]:
    """Intensity and opponents of (B, 3, h, w) (A.1-A.3)."""
    opponent = matrix(OPPONENT.__matmul__, (), 3, rgb.device, rgb.dtype)
    intensity, red_green, blue_yellow = torch.einsum("kc,bchw->kbhw", opponent, rgb)
    if config.color == "quotient":
        (r, g, b), brightest = rgb.unbind(1), rgb.amax(1)
        scale = where_positive(torch.reciprocal, brightest * (brightest >= config.dark))
        red_green, blue_yellow = (r - g) * scale, (b - torch.minimum(r, g)) * scale  # A.2, A.3
    return {"intensity": intensity, "red-green": red_green, "blue-yellow": blue_yellow}


def highest(values: Tensor) -> Tensor:
    return values.amax((-2, -1), keepdim=True)


def rescale(values: Tensor) -> Tensor:
    """Maps scaled linearly to [0, 1]; 0 where one is flat."""
    above = values + highest(-values)
    top = highest(above)
    rough = top > normalize.FLAT
    return torch.where(rough, above / torch.where(rough, top, 1), 0)


def promotion(scaled: Tensor, threshold: float, radius: int, without_highest: bool) -> Tensor:
    """The weight `(1 - m)^2` of each map; the first of equal neighbors is the maximum.

    Compilers round a value in different ways, so that no equality decides: the cells of neighbors
    are compared, and all others with a tolerance.
    """
    pool = partial(torch.nn.functional.max_pool2d, scaled.detach(), stride=1, return_indices=True)
    cells = torch.arange(scaled[0].numel(), device=scaled.device).view(scaled.shape[1:])
    counted = (pool(3, padding=1)[1] == cells) & (scaled >= threshold) & (scaled > 0)
    if radius > 1:
        counted &= scaled >= pool(2 * radius + 1, padding=radius)[0] - TIE
    n, total = (each.sum((-2, -1), keepdim=True) for each in (counted, scaled * counted))
    left_out = highest(scaled * counted) if without_highest else 0
    mean = (total - left_out) / (n - int(without_highest)).clamp(min=1)
    return torch.where(n < 2, n, (1 - mean) ** 2)


def sharpen(saliency: Tensor, exponent: float) -> Tensor:
    """Maps scaled to [0, 1] to a power; unchanged for the power 1."""
    raised = partial(torch.pow, exponent=exponent)
    return saliency if exponent == 1 else where_positive(raised, rescale(saliency))


halve = partial(along_axes, pyramid.halve)
weight_by_maxima = partial(normalize.weight_by_maxima, promotion=promotion)
NORMALIZATIONS: dict[Any, normalize.Promote] = {
    "local-maxima": weight_by_maxima,
    "local-maxima-1998": partial(weight_by_maxima, without_highest=True),
    "none": normalize.keep,
}
"""Normalizations of tensors, by their names in `saccade.attention.normalize`."""
normalize_maps = partial(
    contrast_steps.normalize_map,
    normalize=partial(normalize.normalize, rescale=rescale, promote_of=NORMALIZATIONS.__getitem__),
)
TENSORS = replace(
    MIRRORED,
    split_channels=partial(contrast_steps.split_channels, halve=halve, channels=rgb_channels),
    halve=halve,
    orientations=gabor_energies,
    difference=partial(contrast_steps.difference, resize=resize, absdiff=lambda a, b: abs(a - b)),
    resize=resize,
    normalize=normalize_maps,
    normalize_sum=normalize_maps,
    saliency=partial(contrast_steps.weighted_mean, normalize=normalize_maps),
    smooth=smooth,
    sharpen=sharpen,
)
"""The steps of `MIRRORED` on tensors (B, h, w)."""
