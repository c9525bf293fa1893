"""Figure of the pop-out of a color."""

from typing import Any

from matplotlib.figure import Figure

from saccade.types import Float32Array, Image
from saccade.viewing.style import HEAT, draw_panel, figure_for


def pop_out_figure(image: Image, result: Any, default: Float32Array) -> Figure:
    """A display, its red-green and orientation maps, and its saliency by both models.

    Args:
        image: the display.
        result: its `ContrastSaliency` by the textbook.
        default: (h, w) its saliency by the default model.
    """
    figure = figure_for(image.shape[1], image.shape[0], columns=3, rows=2, panel=3.8)
    panels = figure.subplots(2, 3).ravel()
    draw_panel(panels[0], image, "display")
    name, c, s = next(key for key in result.features if key[0] == "red_green")
    feature = result.features[name, c, s]
    title = f"red-green, c = {c}, s = {s} (A.8)\nweight {feature.normalized.weight:.3f}"
    draw_panel(panels[1], result.channels[name], "red-green (A.2)", cmap="gray", vmin=-1, vmax=1)
    draw_panel(panels[2], feature.contrast, title, cmap=HEAT, vmin=0)
    draw_panel(panels[3], result.orientation, "orientation (A.13)", cmap=HEAT, vmin=0)
    draw_panel(panels[4], result.saliency, "saliency as printed", cmap=HEAT, vmin=0)
    draw_panel(panels[5], default, "saliency by the default", cmap=HEAT, vmin=0)
    return figure
