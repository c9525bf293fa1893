"""Means of scanpath scores over images, with bootstrap intervals."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import NamedTuple

import numpy as np

from saccade.evaluation.conditional import FixationRow
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.scanpaths import PathRow

SEED = 20102
"""Of the bootstrap: equal scores always have equal intervals."""


class MeanScore(NamedTuple):
    """A mean over images."""

    mean: float
    low: float
    """Lower end of the 95 % bootstrap interval."""
    high: float
    """Upper end of it."""


Summary = Mapping[str, Mapping[str, MeanScore]]
"""By source or model, and by the name of the score; without scores that no image has."""


def summary(rows: Iterable[PathRow | FixationRow]) -> Summary:
    """Means over images of the means of their paths or fixations, by source or model."""
    values: dict[str, dict[str, dict[str, list[float]]]] = {}
    for row in rows:
        group = values.setdefault(row[1], {})
        for score, value in asdict(row.scores).items():
            group.setdefault(score, {}).setdefault(row.image, []).append(value)
    return {
        name: {score: _mean_score(images) for score, images in scores.items() if _known(images)}
        for name, scores in values.items()
    }


def tidy(rows: Sequence[PathRow | FixationRow]) -> list[list[str]]:
    """Rows of a table with a heading, one for each path or fixation; what is unknown is empty."""
    keys = [name for name in rows[0]._fields if name not in ("path", "scores")]
    table = [[*keys, *asdict(rows[0].scores)]]
    for row in rows:
        scores = asdict(row.scores).values()
        cells = ["" if np.isnan(value) else f"{value:.6g}" for value in scores]
        table.append([*(str(getattr(row, key)) for key in keys), *cells])
    return table


def _known(images: Mapping[str, Sequence[float]]) -> list[float]:
    """Means of the images that have a score."""
    arrays = (np.array(values) for values in images.values())
    known = (values[np.isfinite(values)] for values in arrays)
    return [float(values.mean()) for values in known if len(values)]


def _mean_score(images: Mapping[str, Sequence[float]]) -> MeanScore:
    table = np.array(_known(images))[:, None]
    low, high = mean_interval(table, 0.95, SEED)
    return MeanScore(float(table.mean()), float(low[0]), float(high[0]))
