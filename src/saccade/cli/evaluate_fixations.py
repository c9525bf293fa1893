"""`saccade evaluate fixations`: fixation prediction by saliency maps."""

from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from math import isnan
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from saccade.attention.models import MODELS
from saccade.attention.values import KINDS
from saccade.cli.fixation_tables import SCORES, FixationOptions, score_cells
from saccade.cli.model_options import DEFAULT_MODEL, SaliencyOptions
from saccade.cli.options import SEVERAL, JsonOptions
from saccade.cli.output import Result, comparison, tracked
from saccade.errors import require
from saccade.evaluation.fixations import FixationScores
from saccade.evaluation.prediction import (
    FixationData,
    Model,
    PredictionScores,
    saliency_from_files,
    score_models,
    score_people,
)
from saccade.scale.pyramid import resize
from saccade.types import Float32Array

MODEL = Parameter(
    metavar="[NAME=]MODEL",
    help=f"Models: {', '.join(MODELS)}, optionally with :PRESET; a file of saccade fit (.toml); "
    "module:function; or a folder of saliency maps (.npy, .mat or images) with the paths of the "
    f"images. Before a function or folder, {': or '.join(KINDS)}: declares its values. Several "
    "with commas; attention by default.",
)


@dataclass(frozen=True, kw_only=True)
class ScoreOptions(FixationOptions, SaliencyOptions, JsonOptions):
    """Options of `saccade evaluate fixations`."""

    model: Annotated[list[str] | None, SEVERAL, MODEL] = None
    references: bool = False
    """Also score three references: a center Gaussian, fixations on other images, and each subject
    predicted by the others (the ceiling). Takes a few minutes."""


def fixations(options: ScoreOptions) -> Result:
    """Score saliency maps by how well they predict human fixations.

    Prints means over the images with 95 % bootstrap intervals, and the paired
    difference of each model from the first; --json has the scores of each image.
    By default the attention model is scored without and with the position prior,
    and as a density converted to the optimal map for each metric.

    docs/evaluation.md defines the figures.

    Example: saccade evaluate fixations --images photos --fixations fixations.csv
    """
    data = options.data()
    results = score(data, chosen_models(data, options), references=options.references)
    first, *others = results
    gains = {name: results[name].minus(results[first]) for name in others}
    tables = comparison(
        f"{len(results[first].name)} images",
        {name: result.estimate() for name, result in results.items()},
        f"paired differences from {first}",
        gains,
        SCORES,
        score_cells,
    )
    rows: dict[str, dict[str, Any]] = {
        name: result.estimate().as_dict()
        | {"images": dict(zip(result.name, map(known_scores, result.scores), strict=True))}
        for name, result in results.items()
    }
    row = rows[first]
    if others:
        of_others = {name: each.as_dict() for name, each in gains.items()}
        row = row | {"models": rows, "differences": of_others}
    return Result(row, tables)


def known_scores(scores: FixationScores) -> dict[str, float | None]:
    """Scores by name; None for those that a single image does not have."""
    return {name: None if isnan(value) else value for name, value in asdict(scores).items()}


CENTER = "center"
"""Title of the center Gaussian."""
SHUFFLED = "shuffled"
"""Title of the fixations on other images."""
PEOPLE = "people"
"""Title of the subjects, each predicted by the others."""
WITHOUT_BIAS = "attention, without center bias"
"""Title of the attention model without the position prior."""
WITH_PRIOR = "attention, free viewing"
"""Title of the attention model with the position prior."""
BY_METRIC = "attention, best map by metric"
"""Title of the free-viewing density, converted to the optimal map for each metric."""


def chosen_models(data: FixationData, options: ScoreOptions) -> dict[str, Model]:
    """Models named on the command line, in order; `default_models` if --model is absent.

    Raises:
        ConfigError: unknown model, or duplicate name.
    """
    given = options.preset or options.config
    if not (options.model or given):
        return default_models(data, options)
    chosen: dict[str, Model] = {}
    words = options.model or [DEFAULT_MODEL]
    single = len(words) == 1
    require(single or not given, "preset", "--model KIND:PRESET of several", options.preset)
    for word in words:
        name, equals, source = word.partition("=")
        if not equals or Path(word).is_dir():
            name, source = f"{word}, {given}" if given else word, word
        taken = {*chosen, CENTER, SHUFFLED, PEOPLE}
        require(name not in taken, "model", "another name for each: NAME=MODEL", name)
        chosen[name] = lru_cache(maxsize=1)(_model(data, source, options))
    return chosen


def default_models(data: FixationData, options: ScoreOptions) -> dict[str, Model]:
    """The attention model without and with the position prior, and the latter as a density.

    The density is converted to the optimal map for each metric.
    """
    attention = options.attention_model(DEFAULT_MODEL, free_viewing=True)

    @lru_cache(maxsize=1)
    def maps(name: str) -> tuple[Float32Array, Float32Array]:
        found = attention.maps(data.read(name))
        size = data.sizes[name]
        return resize(found.without_center_bias, size), resize(found.saliency, size)

    return {
        WITHOUT_BIAS: lambda name: maps(name)[0],
        WITH_PRIOR: lambda name: maps(name)[1],
        BY_METRIC: lambda name: maps(name)[1],
    }


def _model(data: FixationData, source: str, options: ScoreOptions) -> Model:
    declared, colon, rest = source.partition(":")
    values = declared if colon and declared in KINDS else None
    source = rest if values else source
    if source not in MODELS and Path(source).is_dir():
        return saliency_from_files(data.folder, Path(source), values)
    name, colon, preset = source.partition(":")
    if not (colon and name in MODELS):
        name, preset = source, ""
    attention = replace(options.attention_model(name, preset), kind=values)

    def saliency(name: str) -> Float32Array:
        return resize(attention.maps(data.read(name)).saliency, data.sizes[name])

    return saliency


def score(
    data: FixationData, models: dict[str, Model], *, references: bool
) -> dict[str, PredictionScores]:
    """Scores of each model and, with `references`, of each reference."""
    if references:
        models |= {CENTER: data.center}
        models |= {SHUFFLED: data.shuffled} if len(data.sizes) > 1 else {}
    scored: dict[str, list[tuple[str, FixationScores]]] = {name: [] for name in models}
    count = len(data.sizes)
    for image, by_model in tracked(score_models(models, data, (BY_METRIC,)), "scoring", count):
        for name, scores in by_model.items():
            scored[name].append((image, scores))
    if references:
        scored[PEOPLE] = [*tracked(score_people(data), "people", count)]
    return {
        name: PredictionScores(*zip(*pairs, strict=True)) for name, pairs in scored.items() if pairs
    }
