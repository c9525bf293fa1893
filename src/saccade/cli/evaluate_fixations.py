"""`saccade evaluate fixations`: fixation prediction by saliency maps."""

from dataclasses import asdict, astuple
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from saccade.cli.attention_models import Model, ModelChoice, attention_model
from saccade.cli.options import Config, Json, Preset, Report

if TYPE_CHECKING:
    from collections.abc import Callable

    from saccade.evaluation.fixations import FixationScores
    from saccade.types import Float32Array

COLUMNS = ["", "AUC", "sAUC", "NSS", "CC", "SIM", "KL", "IG (bit)"]
MEANING = (
    "AUC: probability that a fixation is more salient than a pixel of the image; sAUC: than a "
    "fixation of another image. Both are 0.5 by chance. NSS: saliency at the fixations in standard "
    "deviations above the mean of the map. CC, SIM and KL: correlation with the fixation density, "
    "histogram intersection with it, and divergence from it. IG: information gain over the "
    "fixations of all images, in bits per fixation. Higher is better, except for KL."
)


def fixations(
    images: Annotated[Path, Option(help="Folder of the images.")],
    fixations: Annotated[
        Path, Option(help="Fixations as CSV (image, viewer, index, x, y) or OSIE's .mat.")
    ],
    maps: Annotated[
        Path | None,
        Option(help="Folder of saliency maps to score, .npy or images named as the images."),
    ] = None,
    model: ModelChoice = Model.attention,
    preset: Preset = None,
    config: Config = None,
    sigma: Annotated[
        float,
        Option(
            min=0.1,
            max=1000,
            metavar="PX",
            help="Standard deviation of the fixation density: one degree of visual angle.",
        ),
    ] = 24.0,
    drop: Annotated[
        int, Option(min=0, metavar="N", help="Leave out the first N fixations of each viewer.")
    ] = 1,
    per_image: Annotated[bool, Option("--per-image", help="List every image.")] = False,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Score saliency maps by how well they predict human fixations.

    Means over the images with 95 % bootstrap intervals.
    """
    from saccade.cli.output import print_json, print_message, print_table, tracked
    from saccade.datasets.fixations import read_fixations
    from saccade.errors import LogError
    from saccade.evaluation.prediction import PredictionScores, fixations_by_image, score_model
    from saccade.viewing.report import Table, write_tables

    table = read_fixations(fixations)
    if not (table.index >= drop).any():
        raise LogError(f"{fixations}: every fixation is among the first {drop}; lower --drop")
    points, sizes, outside = fixations_by_image(table, images, drop)
    if outside:
        print_message(f"{outside} fixations outside their images are left out")
    saliency = _saliency(images, maps, model, preset, config)
    scored = tracked(score_model(saliency, points, sizes, sigma), "scoring", len(points))
    result = PredictionScores(*zip(*scored, strict=True))
    mean, (low, high) = result.mean(), result.interval()
    rows = [_row("mean", mean), _row("95 % from", low), _row("95 % to", high)]
    image_rows = [*map(_row, result.name, result.scores)]
    label = maps or f"{model.value}, {preset or config or 'default settings'}"
    title = f"{len(result.name)} images, {label}"
    write_tables(
        report,
        "saccade evaluate fixations",
        f"Prediction of human fixations by saliency maps: {title}.",
        [
            Table("Mean over the images", COLUMNS, rows, MEANING, "score"),
            Table("Each image", COLUMNS, image_rows, first="image"),
        ],
    )
    if as_json:
        scores = zip(result.name, map(asdict, result.scores), strict=True)
        ends = {"mean": asdict(mean), "low": asdict(low), "high": asdict(high)}
        print_json({**ends, "images": dict(scores)})
        return
    print_table(title, COLUMNS, [*rows, *image_rows] if per_image else rows)


def _row(name: str, scores: "FixationScores") -> list[str]:
    return [name, *(f"{value:.3f}" for value in astuple(scores))]


def _saliency(
    images: Path, maps: Path | None, model: Model, preset: str | None, config: Path | None
) -> "Callable[[str], Float32Array]":
    """A function from the name of an image to its saliency map."""
    from saccade.evaluation.prediction import saliency_from_files
    from saccade.image import read_image
    from saccade.pyramid import resize

    if maps is not None:
        return saliency_from_files(images, maps)
    attention = attention_model(model, preset, config)

    def saliency(name: str) -> "Float32Array":
        image = read_image(images / name)
        result: Float32Array = resize(attention.maps(image).saliency, image.shape[:2])
        return result

    return saliency
