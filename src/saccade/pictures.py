"""One call that shows a result as a picture."""

import sys
from base64 import b64encode
from html import escape
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image as PillowImage

from saccade.attention.maps import SaliencyMaps
from saccade.errors import ConfigError
from saccade.io.image import check_image, in_unit_range, repeat_gray
from saccade.types import Keypoints, Regions, Scanpath
from saccade.viewing.attention import attention_figure
from saccade.viewing.keypoints import keypoint_figure, region_figure
from saccade.viewing.slam import map_figure
from saccade.viewing.style import draw_panel, figure_for

EXPECTED = "the result of a run, or an image and its maps, Scanpath, Keypoints or Regions"


def show(*items: Any) -> None:
    """Shows results below the notebook cell, or in the system's image viewer.

    Args:
        items: a `SlamResult` or `VisualResult`; or an image (H, W) or (H, W, 3) with its results:
            the maps of an attention model, a `Scanpath`, or both; or `Keypoints`, or `Regions`.

    Raises:
        ConfigError: unsupported items.

    Examples:
        >>> import saccade
        >>> image = saccade.read_image("photo.jpg")
        >>> saccade.show(image, saccade.attention_saliency(image))  # doctest: +SKIP
        >>> saccade.show(image, saccade.Sift()(image))  # doctest: +SKIP
    """
    data = BytesIO()
    result_figure(*items).savefig(data, format="png")
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


def result_figure(*items: Any) -> Figure:
    """The figure that `show` shows; takes the same arguments."""
    if len(items) == 1 and hasattr(items[0], "trajectory") and hasattr(items[0], "map"):
        run = items[0]
        odometry = getattr(run, "dead_reckoning", None) or run.odometry
        return map_figure(run.trajectory, run.map, odometry, lost=run.lost)
    if len(items) < 2 or not hasattr(items[0], "shape"):
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
    return attention_figure(image, maps[0] if maps else {}, paths[0] if paths else None)


def _names(items: tuple[Any, ...]) -> str:
    return ", ".join(type(each).__name__ for each in items) or "nothing"
