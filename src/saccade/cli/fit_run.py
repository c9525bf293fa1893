"""The tables of `saccade fit`."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from saccade.attention.combined import AttentionConfig
from saccade.cli.attention_models import face_detector
from saccade.cli.fixation_tables import load_fixations
from saccade.cli.output import print_message, progress_bar, tracked
from saccade.datasets.fixations import FixationFormat
from saccade.evaluation.fit_study import FITTED, FitStudy, study
from saccade.evaluation.fitted_scores import ORDERED, STATIC, differences
from saccade.evaluation.fitting import FittingConfig
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.prediction import PredictionScores
from saccade.viewing.report import Table

LEAD = "A model of fixations, fitted to photographs and people, and its cross-validated scores."
COLUMNS = ["", "sAUC", "AUC", "NSS", "CC", "IG (bit)"]
KEYS = ("shuffled_auc", "auc", "nss", "cc", "information_gain")
MEANING = (
    "By image: on images that the model was not fitted to; by viewer: on viewers that it was not "
    "fitted to. IG: information gain over the center, the density of all other images' fixations, "
    "in bits per fixation. People: each viewer against the fixations of the others. With few "
    "viewers at a time, as by viewer and of people, CC is lower: their density is coarser."
)
STEPS = (
    "Each fixation, on images that the model was not fitted to, on the cells of the map; order: "
    "what those before it tell beyond the image. The other viewers, without order, are the "
    "ceiling of static models. IG is over the fixations on other images, in bits per fixation."
)


@dataclass(frozen=True)
class Fitted:
    """A study, for printing."""

    study: FitStudy

    @property
    def model(self) -> Any:
        """The fitted model."""
        return self.study.model

    def tables(self) -> list[Table]:
        """Scores, differences, and those of each next fixation."""
        results = self.study.results
        scores = [
            [name, *_cells(result.mean(), *result.interval())] for name, result in results.items()
        ]
        paired = [
            [f"{FITTED} - {name}", *_cells(*difference)]
            for name, difference in differences(results, FITTED).items()
        ]
        images = len(results[FITTED].name)
        return [
            Table(f"{images} images: mean, half of the 95 % interval", COLUMNS, scores, MEANING),
            Table("paired differences", COLUMNS, paired, first="models"),
            Table("each next fixation", ["", "NSS", "IG (bit)"], self._steps(), STEPS, "models"),
        ]

    def _means(self) -> list[tuple[str, list[float], list[float]]]:
        """Mean NSS and bits, and half of the interval, by model; the order is a difference."""
        steps = self.study.steps
        rows = {**steps, "order": steps[ORDERED] - steps[STATIC]}
        found = []
        for name, values in rows.items():
            known = values[np.isfinite(values).all(axis=1)]
            if len(known):
                low, high = mean_interval(known, 0.95, PredictionScores.seed)
                found.append((name, known.mean(axis=0).tolist(), ((high - low) / 2).tolist()))
        return found

    def _steps(self) -> list[list[str]]:
        return [
            [name, *(f"{m:.3f} ±{h:.3f}" for m, h in zip(mean, half, strict=True))]
            for name, mean, half in self._means()
        ]

    def as_json(self) -> dict[str, Any]:
        """All figures."""
        results = self.study.results
        return {
            "scores": {n: _ends(r.mean(), *r.interval()) for n, r in results.items()},
            "differences": {n: _ends(*d) for n, d in differences(results, FITTED).items()},
            "next_fixation": {
                name: {"nss": mean[0], "information_gain": mean[1]}
                for name, mean, _ in self._means()
            },
        }


def run(
    images: Path,
    fixations: Path,
    attention: AttentionConfig,
    faces: str | None,
    config: FittingConfig,
    *,
    drop: int,
    sigma: float,
    people: bool,
    form: FixationFormat,
    only_present: bool = False,
) -> Fitted:
    """Fit a model, with progress bars."""
    table = load_fixations(fixations, images, form, only_present)
    found = study(
        table,
        images,
        attention,
        config,
        face_detector(faces),
        skip=drop,
        sigma=sigma,
        people=people,
        progress=tracked,
        bar=progress_bar,
    )
    if found.outside:
        print_message(f"{found.outside} fixations outside their images are left out")
    return Fitted(found)


def _cells(mean: Any, low: Any, high: Any) -> list[str]:
    return [
        f"{getattr(mean, key):.3f} ±{(getattr(high, key) - getattr(low, key)) / 2:.3f}"
        for key in KEYS
    ]


def _ends(mean: Any, low: Any, high: Any) -> dict[str, Any]:
    return {"mean": asdict(mean), "low": asdict(low), "high": asdict(high)}
