"""`saccade fit`: fits a fixation model to your own photographs and fixations."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from saccade.cli.fixation_tables import SCORES, FixationOptions, score_cells
from saccade.cli.options import OUTPUT, JsonOptions, SettingsOptions
from saccade.cli.output import Result, comparison, print_message, tracked, write_text
from saccade.errors import setting
from saccade.evaluation.fitting import FITTED, FittingConfig, study
from saccade.settings import as_toml


@dataclass(frozen=True, kw_only=True)
class FitOptions(FixationOptions, SettingsOptions, JsonOptions):
    """Options of `saccade fit`."""

    out: Annotated[Path, OUTPUT, Parameter(("--out", "-o"))] = Path("fitted.toml")
    """The fitted model, TOML."""
    folds: int = setting(5, 2, 100)
    """Number of folds of the cross-validation, 2 to 100."""


def fit(options: FitOptions) -> Result:
    """Fit a saliency model to your own photographs and fixations.

    Convex maximum-likelihood fit over the cells of the map. Features: contrast,
    symmetry and Boolean maps at several scales and their surroundings, color,
    center, border, and functions of the saccades from earlier fixations. The
    scores are cross-validated by image and by subject.
    Pass the output to --model of look, evaluate fixations and extract.

    Example: saccade fit --images photos --fixations fixations.csv --out mine.toml
    """
    data, settings = options.data(), options.settings("attention")
    found = study(data, settings, FittingConfig(folds=options.folds), progress=tracked)
    scores = {name: each.estimate() for name, each in found.results.items()}
    own = found.results[FITTED]
    gains = {name: own.minus(each) for name, each in found.results.items() if each is not own}
    tables = comparison(
        f"{len(data.sizes)} images", scores, f"{FITTED}, minus:", gains, SCORES, score_cells
    )
    out = options.out
    write_text(out, as_toml(found.model))
    count, fitted_to = len(found.model.features), found.model.fitted_to
    print_message(f"{count} features fitted to {fitted_to} -> {out}")
    row = {
        "model": str(out),
        "scores": {name: each.as_dict() for name, each in scores.items()},
        "differences": {name: each.as_dict() for name, each in gains.items()},
    }
    return Result(row, tables)
