"""`saccade evaluate scanpaths`: similarity of model scanpaths to human scanpaths."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from saccade.attention.scanpath_model import ScanpathModelConfig
from saccade.cli.fixation_tables import FixationOptions
from saccade.cli.model_options import ModelOptions, scanpath_network
from saccade.cli.options import INPUT, JsonOptions
from saccade.cli.output import Result, Table, tracked
from saccade.errors import setting
from saccade.evaluation.conditional import FixationRow, Summary, score_fixations, summary
from saccade.evaluation.prediction import FixationData
from saccade.evaluation.scanpaths import (
    PathRow,
    PathSettings,
    mean_fixations,
    score_paths,
    viewings,
)
from saccade.settings import load_settings

PATHS = {
    "scanmatch": "ScanMatch",
    "amplitude": "amplitude [deg]",
    "horizontal": "horizontal",
    "seconds": "duration [ms]",
    "fixations": "fixations",
}
FIXATIONS = {"nss": "NSS", "auc": "AUC", "information_gain": "IG (bit)"}


@dataclass(frozen=True, kw_only=True)
class ScanpathOptions(FixationOptions, ModelOptions, JsonOptions):
    """Options of `saccade evaluate scanpaths`."""

    paths_config: Annotated[Path | None, INPUT] = None
    """TOML file of the scanpath model, as saccade config scanpath-model prints it."""
    length: int | None = setting(None, 1, 1000)
    """Number of fixations per path, and maximum for subjects, 1 to 1000; by default the subjects'
    mean."""
    samples: int = setting(15, 1, 1000)
    """Number of paths drawn for each image, 1 to 1000."""
    seed: int = setting(0, 0)
    """Seed of the random number generator, at least 0."""


def scanpaths(options: ScanpathOptions) -> Result:
    """Score scanpaths by their similarity to human scanpaths.

    Prints means over the images with 95 % bootstrap intervals.

    docs/evaluation.md defines the figures.

    Example: saccade evaluate scanpaths --images photos --fixations fixations.csv
    """
    model, preset, config = options.model, options.preset, options.config
    data = options.data()
    people = viewings(data)
    chosen: ScanpathModelConfig = load_settings("scanpath-model", None, options.paths_config)
    settings = PathSettings(
        options.length or mean_fixations(people),
        options.samples,
        chosen,
        scanpath_network(preset),
        seed=options.seed,
    )
    attention = options.attention_model(model)
    path_rows: list[PathRow] = []
    fixation_rows: list[FixationRow] = []
    for name in tracked(people, "scoring", len(people)):
        saliency = attention.maps(data.read(name)).saliency
        path_rows += score_paths(name, people, saliency, settings)
        fixation_rows += score_fixations(name, data, saliency, chosen)
    paths, predicted = summary(path_rows), summary(fixation_rows)
    shown = summary(in_degrees(row, data) for row in path_rows)
    title = f"{len(people)} images, {model}, {preset or config or 'default settings'}"
    similarity = f"{title}: paths of {settings.fixations} fixations"
    tables = [
        Table(similarity, ["", *PATHS.values()], _cells(shown, PATHS)),
        Table("Each next fixation", ["", *FIXATIONS.values()], _cells(predicted, FIXATIONS)),
    ]
    return Result({"paths": _as_dict(paths), "fixations": _as_dict(predicted)}, tables)


def in_degrees(row: PathRow, data: FixationData) -> PathRow:
    """The row with its amplitude in degrees of visual angle."""
    degrees = row.scores.amplitude / data.sigma_of(row.image)
    return row._replace(scores=replace(row.scores, amplitude=degrees))


def _cells(summary: Summary, columns: dict[str, str]) -> Sequence[Sequence[str]]:
    """One row per source; the first score has its interval."""
    scale = {"seconds": 1000.0}
    digits = {"seconds": 0, "fixations": 1, "amplitude": 1, "nss": 2}
    rows = []
    for name, scores in summary.items():
        row = [name]
        for number, key in enumerate(columns):
            if key not in scores:
                row.append("")
                continue
            mean, low, high = (value * scale.get(key, 1.0) for value in scores[key])
            places = digits.get(key, 3)
            text, *ends = (f"{value:.{places}f}" for value in (mean, low, high))
            row.append(text if number else f"{text} [{' '.join(ends)}]")
        rows.append(row)
    return rows


def _as_dict(summary: Summary) -> dict[str, dict[str, dict[str, float]]]:
    return {
        name: {score: value._asdict() for score, value in scores.items()}
        for name, scores in summary.items()
    }
