"""`saccade evaluate fixations`: fixation prediction by saliency maps."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from saccade.attention.models import KINDS
from saccade.cli import options
from saccade.cli.fixation_tables import FixationOptions
from saccade.cli.options import DEFAULT_MODEL, Faces, attention_model
from saccade.cli.output import emit, tracked, with_interval
from saccade.errors import ConfigError, require
from saccade.evaluation.comparison import (
    FixationRow,
    center_model,
    checked_map,
    fixation_rows,
    imported_model,
    paired_difference,
    score_people,
    shuffled_model,
)
from saccade.evaluation.fixations import FixationScores
from saccade.evaluation.prediction import (
    Model,
    PredictionScores,
    saliency_from_files,
    score_models,
)
from saccade.io.files import atomic_write, results_in
from saccade.io.image import read_image
from saccade.scale.pyramid import resize
from saccade.types import Float32Array
from saccade.viewing.evaluation import Bar, fixation_score_figure
from saccade.viewing.report import Table
from saccade.viewing.style import save_figure

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
    seen: FixationOptions,
    shown: options.ReportOptions,
    maps: Annotated[
        list[str] | None,
        Option(
            metavar="[NAME=]DIR",
            rich_help_panel="Input",
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
    preset: options.Preset = None,
    config: options.Config = None,
    faces: Faces = None,
    sigma: options.Sigma = 24.0,
    references: Annotated[
        bool,
        Option(
            "--references",
            help="Also score the center, other images' fixations, and people: each viewer against "
            "the others, the ceiling. It takes a few minutes.",
        ),
    ] = False,
    per_image: Annotated[bool, Option("--per-image", help="List every image.")] = False,
    figure: options.FigureFiles = None,
    csv: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="Also write images.csv and fixations.csv: a row for each image, and for each "
            "fixation, of each model.",
        ),
    ] = None,
) -> None:
    """Score saliency maps by how well they predict human fixations.

    Means over the images with 95 % bootstrap intervals, and the paired
    differences of each further model from the first. By default the attention
    model is scored without and with the prior of the position, and as one
    density from which each metric has the map that is optimal for it.
    """
    models = chosen_models(seen, maps or [], model or [], preset, config, faces)
    results, rows_of_fixations, names = run(seen, models, sigma, references, rows=csv is not None)
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
    shown.write(
        "evaluate fixations",
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
    tables = _fitting(title, [*rows, *image_rows] if per_image else rows)
    if many:
        tables += _fitting(f"paired differences from {first}", difference_rows)
    emit(_as_json(results, differences), shown.as_json, *tables)


def _fitting(title: str, rows: list[list[str]]) -> list[Table]:
    """One table, or two where names are long."""
    long = max(len(name) for name, *_ in rows) > LONGEST
    return [
        Table(
            "" if number else title,
            columns,
            [[row[COLUMNS.index(column)] for column in columns] for row in rows],
        )
        for number, columns in enumerate(PRINTED if long else [COLUMNS])
    ]


def _as_json(results: "dict[str, PredictionScores]", differences: dict[str, Any]) -> dict[str, Any]:
    """The first model's scores, and, of several, those of each by name."""
    tables = {
        name: {
            **with_interval(result.mean(), *result.interval()),
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
        "differences": {name: with_interval(*each) for name, each in differences.items()},
    }


def _rows(
    name: str, mean: "FixationScores", low: "FixationScores", high: "FixationScores"
) -> list[list[str]]:
    return [_row(name, mean), _row("  95 % from", low), _row("  95 % to", high)]


def _row(name: str, scores: "FixationScores") -> list[str]:
    return [name, *(f"{value:.3f}" for value in astuple(scores))]


CENTER, SHUFFLED, PEOPLE = "center", "shuffled", "people"
BARE, WITH_PRIOR = "attention, bare", "attention, free viewing"
BY_METRIC = "the same, best map by metric"
"""The attention model without and with the prior of the position, and the latter as a density."""


def chosen_models(
    task: FixationOptions,
    maps: Sequence[str],
    models: Sequence[str],
    preset: str | None,
    config: Path | None,
    faces: str | None,
) -> dict[str, Model]:
    """The models of the command line by name, in their order; `default_models` where there is none.

    Raises:
        ConfigError: no such model, or a name that is given twice.
    """
    if not (models or maps or preset or config):
        return default_models(task, faces)
    chosen: dict[str, Model] = {}
    words = [*models] if models or maps else [DEFAULT_MODEL]
    single = len(words) == 1
    require(single or not (preset or config), "preset", "--model KIND:PRESET of several", preset)
    for word in words:
        name, source = _named(word)
        label = name or (f"{source}, {preset or config}" if preset or config else source)
        _add(chosen, label, _model(task, source, preset, config, faces))
    for word in maps:
        name, folder = (None, word) if Path(word).is_dir() else _named(word)
        _add(chosen, name or folder, saliency_from_files(task.images, Path(folder)))
    return chosen


def default_models(task: FixationOptions, faces: str | None) -> dict[str, Model]:
    """The attention model without and with the prior of the position, and the latter as a density.

    The last one is scored by the map that is optimal for each metric.
    """
    attention = attention_model(DEFAULT_MODEL, None, None, faces=faces, free_viewing=True)

    @lru_cache(maxsize=1)
    def maps(name: str) -> tuple[Float32Array, Float32Array]:
        image = read_image(task.images / name)
        found = attention.maps(image)
        bare, saliency = (resize(each, image.shape[:2]) for each in (found.bare, found.saliency))
        return bare, saliency

    return {
        BARE: lambda name: maps(name)[0],
        WITH_PRIOR: lambda name: maps(name)[1],
        BY_METRIC: lambda name: maps(name)[1],
    }


def _named(word: str) -> tuple[str | None, str]:
    name, equals, source = word.partition("=")
    return (name, source) if equals else (None, word)


def _add(chosen: dict[str, Model], name: str, model: Model) -> None:
    taken = {*chosen, CENTER, SHUFFLED, PEOPLE}
    require(name not in taken, "model", "another name for each: NAME=MODEL", name)
    chosen[name] = lru_cache(maxsize=1)(model)


def _model(
    task: FixationOptions, source: str, preset: str | None, config: Path | None, faces: str | None
) -> Model:

    kind, colon, rest = source.partition(":")
    if colon and kind not in KINDS:
        predict = imported_model(source)

        def imported(name: str) -> Float32Array:
            image = read_image(task.images / name)
            try:
                values = predict(image)
            except Exception as error:  # of the user's own function
                raise ConfigError(f"model: {source}: failed on {name}: {error}") from error
            return resize(checked_map(values, source), image.shape[:2])

        return imported
    attention = attention_model(kind if colon else source, rest or preset, config, faces=faces)

    def saliency(name: str) -> Float32Array:
        image = read_image(task.images / name)
        result: Float32Array = resize(attention.maps(image).saliency, image.shape[:2])
        return result

    return saliency


def run(
    task: FixationOptions, models: dict[str, Model], sigma: float, references: bool, *, rows: bool
) -> tuple[dict[str, PredictionScores], list[FixationRow], str]:
    """The scores of each model, the rows of each fixation where wished, and the models' names."""
    points, sizes = task.places
    names = ", ".join(models)
    if references:
        models[CENTER] = center_model(sizes)
        models[SHUFFLED] = lru_cache(maxsize=1)(shuffled_model(points, sizes, sigma))
    scored: dict[str, list[tuple[str, object]]] = {name: [] for name in models}
    of_fixations: list[FixationRow] = []
    for image, by_model in tracked(
        score_models(models, points, sizes, sigma, (BY_METRIC,)), "scoring", len(points)
    ):
        for name, scores in by_model.items():
            scored[name].append((image, scores))
        if rows:
            maps = {name: model(image) for name, model in models.items()}
            of_fixations += fixation_rows(image, maps, task.table, points, sizes, task.drop, sigma)
    if references:
        people = score_people(task.table, points, sizes, task.drop, sigma)
        scored[PEOPLE] = [*tracked(people, "people", len(points))]
    results = {
        name: PredictionScores(*zip(*pairs, strict=True)) for name, pairs in scored.items() if pairs
    }
    return results, of_fixations, names


def draw(results: Mapping[str, PredictionScores], path: Path, drawn: Mapping[str, str]) -> None:
    """Write the figure of the scores."""
    ends = {name: (result.mean(), *result.interval()) for name, result in results.items()}
    scores = {
        title: {name: Bar(*(getattr(end, key) for end in three)) for name, three in ends.items()}
        for title, key in drawn.items()
    }
    save_figure(fixation_score_figure(scores, (CENTER, SHUFFLED, PEOPLE)), path)


def write_csv(
    folder: Path, results: Mapping[str, PredictionScores], rows: Sequence[FixationRow]
) -> None:
    """Write images.csv and fixations.csv: tidy tables, a row for each item of each model."""
    by_image = [
        {"image": image, "model": name, **asdict(scores)}
        for name, result in results.items()
        for image, scores in zip(result.name, result.scores, strict=True)
    ]
    tables = {"images.csv": by_image, "fixations.csv": [row._asdict() for row in rows]}
    for name, table in tables.items():
        with (
            atomic_write(folder / name) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            writer = csv.DictWriter(file, list(table[0]))
            writer.writeheader()
            writer.writerows(table)
