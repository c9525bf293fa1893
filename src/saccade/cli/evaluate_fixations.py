"""`saccade evaluate fixations`: fixation prediction by saliency maps."""

from dataclasses import asdict, astuple
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from saccade.cli.attention_models import Faces
from saccade.cli.options import (
    Columns,
    Config,
    DropFirst,
    FigureFiles,
    Fixations,
    Json,
    Offset,
    OnlyPresent,
    PositionUnits,
    Preset,
    Report,
)

if TYPE_CHECKING:
    from saccade.evaluation.fixations import FixationScores
    from saccade.evaluation.prediction import PredictionScores

COLUMNS = ["", "AUC", "sAUC", "NSS", "CC", "SIM", "KL", "IG (bit)"]
PRINTED = (["", "AUC", "sAUC", "NSS", "CC"], ["", "SIM", "KL", "IG (bit)"])
"""Columns of the two tables that are printed where a name is longer than `LONGEST`."""
LONGEST = 16
"""Characters of a name beside which all columns fit into 80 characters."""
MEANING = (
    "AUC: probability that a fixation is more salient than a pixel of the image; sAUC: than a "
    "fixation of another image. Both are 0.5 by chance. NSS: saliency at the fixations in standard "
    "deviations above the mean of the map. CC, SIM and KL: correlation with the fixation density, "
    "histogram intersection with it, and divergence from it. IG: information gain over the center, "
    "the density of all other images' fixations, in bits per fixation. Higher is better, except "
    "for KL."
)
DRAWN = {"sAUC": "shuffled_auc", "AUC": "auc", "NSS": "nss", "CC": "cc"}
"""Titles of the panels of the figure, and their scores."""


def fixations(
    images: Annotated[Path, Option(help="Folder of the images.")],
    fixations: Fixations,
    maps: Annotated[
        list[str] | None,
        Option(
            metavar="[NAME=]DIR",
            help="Folder of saliency maps to score: .npy, .mat, or images named as the images. "
            "Several with commas.",
        ),
    ] = None,
    model: Annotated[
        list[str] | None,
        Option(
            metavar="[NAME=]MODEL",
            help="attention, contrast, symmetry or boolean, with :PRESET where wished, a file of "
            "saccade fit (.toml), or module:function. Several with commas; attention by default.",
        ),
    ] = None,
    preset: Preset = None,
    config: Config = None,
    faces: Faces = None,
    sigma: Annotated[
        float,
        Option(
            min=0.1,
            max=1000,
            metavar="PX",
            help="Standard deviation of the fixation density: one degree of visual angle.",
        ),
    ] = 24.0,
    drop: DropFirst = 1,
    columns: Columns = None,
    xy: PositionUnits = None,
    offset: Offset = None,
    references: Annotated[
        bool,
        Option(
            "--references",
            help="Also score the center, other images' fixations, and people: each viewer against "
            "the others, the ceiling. It takes a few minutes.",
        ),
    ] = False,
    only_present: OnlyPresent = False,
    per_image: Annotated[bool, Option("--per-image", help="List every image.")] = False,
    figure: FigureFiles = None,
    csv: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="Also write images.csv and fixations.csv: a row for each image, and for each "
            "fixation, of each model.",
        ),
    ] = None,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Score saliency maps by how well they predict human fixations.

    Means over the images with 95 % bootstrap intervals, and the paired
    differences of each further model from the first. By default the attention
    model is scored without and with the prior of the position, and as one density
    from which each metric has the map that is optimal for it.
    """
    from saccade.cli.evaluate_fixations_run import Task, chosen_models, draw, run, write_csv
    from saccade.cli.fixation_tables import fixation_format
    from saccade.cli.output import print_json
    from saccade.evaluation.comparison import paired_difference
    from saccade.io.files import results_in
    from saccade.viewing.report import Table, write_tables

    task = Task(images, fixations, drop, sigma, only_present, fixation_format(columns, xy, offset))
    models = chosen_models(task, maps or [], model or [], preset, config, faces)
    results, rows_of_fixations, names = run(task, models, references, rows=csv is not None)
    first, *others = results
    differences = {name: paired_difference(results[first], results[name]) for name in others}
    many = len(results) > 1
    rows = [
        row
        for name, result in results.items()
        for row in _rows(name if many else "mean", result.mean(), *result.interval())
    ]
    difference_rows = [row for name, each in differences.items() for row in _rows(name, *each)]
    image_rows = [
        _row(f"{image}, {name}" if many else image, scores)
        for name, result in results.items()
        for image, scores in zip(result.name, result.scores, strict=True)
    ]
    label = f"{len(results)} models" if many else names
    title = f"{len(results[first].name)} images, {label}"
    write_tables(
        report,
        "saccade evaluate fixations",
        f"Prediction of human fixations by saliency maps: {title}.",
        [
            Table("Mean over the images", COLUMNS, rows, MEANING, "score"),
            Table(f"Paired differences from {first}", COLUMNS, difference_rows, first="score"),
            Table("Each image", COLUMNS, image_rows, first="image"),
        ],
    )
    for path in figure or []:
        draw(results, path, DRAWN)
    if csv is not None:
        with results_in(csv):
            write_csv(csv, results, rows_of_fixations)
    if as_json:
        print_json(_as_json(results, differences))
        return
    _print(title, [*rows, *image_rows] if per_image else rows)
    if many:
        _print(f"paired differences from {first}", difference_rows)


def _print(title: str, rows: list[list[str]]) -> None:
    """Print one table, or two where names are long."""
    from saccade.cli.output import print_table

    long = max(len(name) for name, *_ in rows) > LONGEST
    for number, columns in enumerate(PRINTED if long else [COLUMNS]):
        cells = [[row[COLUMNS.index(column)] for column in columns] for row in rows]
        print_table("" if number else title, columns, cells)


def _as_json(results: "dict[str, PredictionScores]", differences: dict[str, Any]) -> dict[str, Any]:
    """The first model's scores, and, of several, those of each by name."""
    tables = {
        name: {
            **_ends(result.mean(), *result.interval()),
            "images": dict(zip(result.name, map(asdict, result.scores), strict=True)),
        }
        for name, result in results.items()
    }
    first = next(iter(tables.values()))
    if len(tables) == 1:
        return first
    return {
        **first,
        "models": tables,
        "differences": {name: _ends(*each) for name, each in differences.items()},
    }


def _ends(mean: Any, low: Any, high: Any) -> dict[str, Any]:
    return {"mean": asdict(mean), "low": asdict(low), "high": asdict(high)}


def _rows(
    name: str, mean: "FixationScores", low: "FixationScores", high: "FixationScores"
) -> list[list[str]]:
    return [_row(name, mean), _row("  95 % from", low), _row("  95 % to", high)]


def _row(name: str, scores: "FixationScores") -> list[str]:
    return [name, *(f"{value:.3f}" for value in astuple(scores))]
