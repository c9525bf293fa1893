"""`saccade fit`: a model of fixations from one's own photographs and people."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from typer import Option

from saccade.attention.combined import AttentionConfig
from saccade.cli import options
from saccade.cli.fixation_tables import FixationOptions
from saccade.cli.options import Faces, face_detector
from saccade.cli.output import emit, print_message, progress_bar, tracked, with_interval, write_text
from saccade.evaluation.fit_study import FITTED, ORDERED, STATIC, FitStudy, differences, study
from saccade.evaluation.fitting import FittingConfig
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.prediction import PredictionScores
from saccade.io.files import results_in
from saccade.settings import as_toml, load_settings
from saccade.viewing.report import Table


def fit(
    seen: FixationOptions,
    shown: options.ReportOptions,
    out: Annotated[
        Path, Option("--out", "-o", metavar="FILE", help="The fitted model, TOML.")
    ] = Path("fitted.toml"),
    preset: options.Preset = None,
    config: options.Config = None,
    faces: Faces = None,
    sigma: options.Sigma = 24.0,
    folds: Annotated[
        int, Option(min=2, max=100, metavar="N", help="Folds of the cross-validation.")
    ] = 5,
    seed: options.Seed = 2020,
    people: Annotated[
        bool,
        Option(help="Score people, each viewer against the others: the ceiling; some minutes."),
    ] = True,
) -> None:
    """Fit a saliency model to your own photographs and fixations.

    One convex fit over the cells of the map: contrast, symmetry and Boolean
    maps at several scales and their surroundings, color, the center, the
    border, faces with --faces, and functions of the saccade from earlier
    fixations. It is cross-validated by image and by viewer. --out is used by
    --model of look, evaluate fixations and extract.
    """
    found = run(
        seen,
        load_settings("attention", preset, config),
        faces,
        FittingConfig(folds=folds, seed=seed),
        sigma=sigma,
        people=people,
    )
    tables = found.tables()
    with results_in(out, is_file=True):
        write_text(out, as_toml(found.model))
        shown.write("fit", LEAD, tables)
    facts = [
        ["features", str(len(found.model.features))],
        ["fitted to", found.model.fitted_to],
        ["model", str(out)],
    ]
    row = {"model": str(out), **found.as_json()}
    emit(row, shown.as_json, *tables, Table("fitted model", ["", ""], facts))


LEAD = "A model of fixations, fitted to photographs and people, and its cross-validated scores."
COLUMNS = ["", "sAUC", "AUC", "NSS", "CC", "IG (bit)"]
KEYS = ("shuffled_auc", "auc", "nss", "cc", "information_gain")
SCORES = (
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
            Table(f"{images} images: mean, half of the 95 % interval", COLUMNS, scores, SCORES),
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
            "scores": {n: with_interval(r.mean(), *r.interval()) for n, r in results.items()},
            "differences": {n: with_interval(*d) for n, d in differences(results, FITTED).items()},
            "next_fixation": {
                name: {"nss": mean[0], "information_gain": mean[1]}
                for name, mean, _ in self._means()
            },
        }


def run(
    seen: FixationOptions,
    attention: AttentionConfig,
    faces: str | None,
    config: FittingConfig,
    *,
    sigma: float,
    people: bool,
) -> Fitted:
    """Fit a model, with progress bars."""
    found = study(
        seen.table,
        seen.images,
        attention,
        config,
        face_detector(faces),
        skip=seen.drop,
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
