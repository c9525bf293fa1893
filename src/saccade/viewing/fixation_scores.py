"""A figure of models of fixations, in the width of a journal's column."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from saccade.viewing.style import BLUE, GRAY, grid_axes

COLUMN_WIDTH = 3.5
"""Inches: 89 mm, a single column of most journals."""
LONGEST = 24
"""Characters of a model's name for which there is room; of a longer one the end is kept."""


class Bar(NamedTuple):
    """A score of a model with its interval."""

    mean: float
    low: float
    high: float


def fixation_score_figure(
    scores: Mapping[str, Mapping[str, Bar]], references: Sequence[str] = ()
) -> Figure:
    """Each score in a panel of its own, a point with its interval for each model.

    Args:
        scores: by title of the score and name of the model; the first model is on top.
        references: names of the models that are drawn in gray.
    """
    models = list(dict.fromkeys(name for of_models in scores.values() for name in of_models))
    rows = -(-len(scores) // 2)
    height = rows * (0.55 + 0.17 * len(models))
    figure = Figure(figsize=(COLUMN_WIDTH, height), layout="constrained", dpi=300)
    panels = figure.subplots(rows, 2, squeeze=False, sharey=True)
    place = np.arange(len(models))[::-1]
    for axes, (title, of_models) in zip(panels.ravel(), scores.items(), strict=False):
        grid_axes(axes)
        for y, name in zip(place, models, strict=True):
            if name in of_models:
                mean, low, high = of_models[name]
                color = GRAY if name in references else BLUE
                axes.plot([low, high], [y, y], color=color, linewidth=1.2)
                axes.plot([mean], [y], "o", color=color, markersize=3)
        axes.set_title(title, fontsize=7, pad=2)
        axes.set_yticks(place, [_shortened(name) for name in models])
        axes.set_ylim(-0.6, len(models) - 0.4)
        axes.tick_params(labelsize=6, length=0)
    for axes in panels.ravel()[len(scores) :]:
        axes.set_axis_off()
    return figure


def _shortened(name: str) -> str:
    return name if len(name) <= LONGEST else f"...{name[3 - LONGEST :]}"
