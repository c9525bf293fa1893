"""One call that shows a result as a picture."""

import sys
from base64 import b64encode
from html import escape
from io import BytesIO
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from PIL import Image as PillowImage

from saccade.attention.maps import SaliencyMaps
from saccade.errors import ConfigError, require
from saccade.io.image import check_image, in_unit_range, repeat_gray
from saccade.types import FixationTable, FloatArray, Keypoints, Regions, Scanpath
from saccade.viewing.attention import attention_figure
from saccade.viewing.keypoints import keypoint_figure, region_figure
from saccade.viewing.slam import map_figure
from saccade.viewing.style import draw_panel, figure_for

EXPECTED = "the result of a run, or an image and its maps, Scanpath, Keypoints or Regions"


def show(
    *items: Any,
    fixations: FixationTable | npt.ArrayLike | None = None,
    sigma: float = 24.0,
    dpi: float = 110.0,
) -> None:
    """Shows results below the notebook cell, or in the system's image viewer.

    Args:
        items: a `SlamResult` or `VisualResult`; or an image (H, W) or (H, W, 3) with its results:
            the maps of an attention model, a `Scanpath`, or both; or `Keypoints`, or `Regions`.
        fixations: human fixations on the image, drawn on it and as a density beside the maps: rows
            of a `FixationTable` on one image, or (n, 2) x and y in pixels.
        sigma: standard deviation of that density in pixels; about a degree of visual angle.
        dpi: resolution of the figure in pixels per inch.

    Raises:
        ConfigError: unsupported items, or fixations on several images.

    Examples:
        >>> import saccade
        >>> image = saccade.read_image("photo.jpg")
        >>> saccade.show(image, saccade.attention_saliency(image))  # doctest: +SKIP
        >>> saccade.show(image, saccade.Sift()(image))  # doctest: +SKIP
        >>> saccade.show(image, maps, fixations=table[table.image == "photo.jpg"])  # doctest: +SKIP
    """
    data = BytesIO()
    figure = result_figure(*items, fixations=fixations, sigma=sigma, dpi=dpi)
    figure.savefig(data, format="png")
    IPython = sys.modules.get("IPython")
    if IPython is not None and IPython.get_ipython() is not None:
        IPython.display.display(IPython.display.Image(data=data.getvalue()))
    else:
        PillowImage.open(data).show(title="saccade")


def result_html(result: Any) -> str:
    """A result as an HTML image, in a notebook; keypoints and saliency without their image."""
    if isinstance(result, SaliencyMaps):
        if result.saliency.ndim != 2:  # a batch of tensors
            return escape(repr(result))
        layers, (height, width) = result.layers, result.image_shape
        figure = figure_for(width, height, len(layers))
        panels = figure.subplots(1, len(layers), squeeze=False)[0]
        for axes, (name, values) in zip(panels, layers.items(), strict=True):
            draw_panel(axes, values, name, vmin=0)
    elif isinstance(result, Keypoints):
        width, height = (np.max(result.xy, axis=0, initial=1.0) + 16).astype(int)
        figure = keypoint_figure(np.ones((height, width, 3), np.float32), result)
    else:
        figure = result_figure(result)
    data = BytesIO()
    figure.savefig(data, format="png")
    encoded = b64encode(data.getvalue()).decode()
    return f'<img alt="{escape(repr(result))}" src="data:image/png;base64,{encoded}">'


def result_figure(
    *items: Any,
    fixations: FixationTable | npt.ArrayLike | None = None,
    sigma: float = 24.0,
    dpi: float = 110.0,
) -> Figure:
    """The figure that `show` shows; takes the same arguments."""
    xy = None if fixations is None else _positions(fixations)
    if len(items) == 1 and hasattr(items[0], "trajectory") and hasattr(items[0], "map"):
        run = items[0]
        odometry = getattr(run, "dead_reckoning", None) or run.odometry
        return map_figure(run.trajectory, run.map, odometry, lost=run.lost)
    if len(items) < 1 + (xy is None) or not hasattr(items[0], "shape"):
        raise ConfigError(f"show: expected {EXPECTED}, found {_names(items)}")
    image, found = repeat_gray(in_unit_range(check_image(items[0]))), items[1:]
    if len(found) == 1 and isinstance(found[0], Keypoints):
        return keypoint_figure(image, found[0])
    if len(found) == 1 and isinstance(found[0], Regions):
        return region_figure(image, found[0])
    maps = [each.layers for each in found if isinstance(each, SaliencyMaps)]
    paths = [each for each in found if isinstance(each, Scanpath)]
    if len(maps) + len(paths) < len(found) or len(maps) > 1 or len(paths) > 1:
        raise ConfigError(f"show: expected {EXPECTED}, found {_names(items)}")
    path = paths[0] if paths else None
    layers = maps[0] if maps else {}
    return attention_figure(image, layers, path, fixations=xy, sigma=sigma, dpi=dpi)


def _positions(fixations: FixationTable | npt.ArrayLike) -> FloatArray:
    """(n, 2) positions of fixations on one image."""
    if isinstance(fixations, FixationTable):
        names = np.unique(fixations.image).tolist()
        expected = 'those on one image, as table[table.image == "photo.jpg"]'
        require(len(names) < 2, "fixations", expected, names[:3])
        return fixations.xy
    xy = np.asarray(fixations, np.float64)
    require(xy.ndim == 2 and xy.shape[1] == 2, "fixations", "positions (n, 2)", xy.shape)
    return xy


def _names(items: tuple[Any, ...]) -> str:
    return ", ".join(type(each).__name__ for each in items) or "nothing"
