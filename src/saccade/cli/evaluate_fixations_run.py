"""The models that `saccade evaluate fixations` scores, and the files it writes."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

from saccade.cli.attention_models import DEFAULT_MODEL, attention_model
from saccade.cli.fixation_tables import load_fixations
from saccade.cli.output import print_message, tracked
from saccade.datasets.fixations import FixationFormat
from saccade.errors import ConfigError, LogError, require
from saccade.evaluation.comparison import (
    FixationRow,
    checked_map,
    fixation_rows,
    imported_model,
)
from saccade.evaluation.fixation_references import center_model, score_people, shuffled_model
from saccade.evaluation.prediction import (
    Model,
    PredictionScores,
    fixations_by_image,
    saliency_from_files,
    score_models,
)
from saccade.io.files import atomic_write
from saccade.io.image import read_image
from saccade.scale.pyramid import resize
from saccade.types import FixationTable, Float32Array, FloatArray
from saccade.viewing.evaluation import Bar, fixation_score_figure
from saccade.viewing.style import save_figure

CENTER, SHUFFLED, PEOPLE = "center", "shuffled", "people"
BARE, WITH_PRIOR = "attention, bare", "attention, free viewing"
BY_METRIC = "the same, best map by metric"
"""The attention model without and with the prior of the position, and the latter as a density."""


@dataclass(frozen=True)
class Task:
    """Images, their fixations, and how they are scored."""

    images: Path
    file: Path
    drop: int
    sigma: float
    only_present: bool = False
    form: FixationFormat = field(default_factory=FixationFormat)

    @cached_property
    def table(self) -> FixationTable:
        """The fixations of the file."""
        table = load_fixations(self.file, self.images, self.form, self.only_present)
        if not (table.index >= self.drop).any():
            raise LogError(
                f"{self.file}: every fixation is among the first {self.drop}; lower --drop"
            )
        return table

    @cached_property
    def places(self) -> tuple[dict[str, FloatArray], dict[str, tuple[int, int]]]:
        """The fixations inside each image, and its size."""
        points, sizes, outside = fixations_by_image(self.table, self.images, self.drop)
        if outside:
            print_message(f"{outside} fixations outside their images are left out")
        return points, sizes


def chosen_models(
    task: Task,
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


def default_models(task: Task, faces: str | None) -> dict[str, Model]:
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
    task: Task, source: str, preset: str | None, config: Path | None, faces: str | None
) -> Model:
    from saccade.attention.models import KINDS

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
    task: Task, models: dict[str, Model], references: bool, *, rows: bool
) -> tuple[dict[str, PredictionScores], list[FixationRow], str]:
    """The scores of each model, the rows of each fixation where wished, and the models' names."""
    points, sizes = task.places
    names = ", ".join(models)
    if references:
        models[CENTER] = center_model(sizes)
        models[SHUFFLED] = lru_cache(maxsize=1)(shuffled_model(points, sizes, task.sigma))
    scored: dict[str, list[tuple[str, object]]] = {name: [] for name in models}
    of_fixations: list[FixationRow] = []
    for image, by_model in tracked(
        score_models(models, points, sizes, task.sigma, (BY_METRIC,)), "scoring", len(points)
    ):
        for name, scores in by_model.items():
            scored[name].append((image, scores))
        if rows:
            maps = {name: model(image) for name, model in models.items()}
            of_fixations += fixation_rows(
                image, maps, task.table, points, sizes, task.drop, task.sigma
            )
    if references:
        people = score_people(task.table, points, sizes, task.drop, task.sigma)
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
