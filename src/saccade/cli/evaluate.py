"""`saccade evaluate`: results against people, peers and truth."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from saccade.cli.attention_models import Model, ModelChoice, attention_model
from saccade.cli.evaluate_consistency import consistency
from saccade.cli.evaluate_features import features
from saccade.cli.evaluate_places import places
from saccade.cli.evaluate_selection import selection
from saccade.cli.options import Json, Preset, Report, Settings

LARGEST = 1e15
"""In a map that somebody brings: squares of float32 can be summed up to it."""

evaluate = typer.Typer(
    help="Measure results against people, peers and truth.", no_args_is_help=True
)
evaluate.command(epilog="Example: saccade evaluate features --pairs oxford --detector opencv")(
    features
)
evaluate.command(epilog="Example: saccade evaluate consistency --preset loop --runs 20")(
    consistency
)
evaluate.command(epilog="Example: saccade evaluate places hallway --lap 40")(places)
evaluate.command(epilog="Example: saccade evaluate selection --budget 2 --seeds 5")(selection)


NAMES = {Model.both: "contrast and symmetry"}
"""What a model is called on the page, where not by its own name."""
MEANING = (
    "AUC: chance that a place where someone looked is more salient than a pixel of the image; "
    "sAUC: than a place where people looked in the other images. Both are 0.5 by chance. "
    "NSS: standard deviations by which the map is above its mean where people looked. "
    "CC, SIM and KL: correlation with the density of the fixations, overlap with it, and "
    "divergence from it. IG: bits per fixation that the map tells beyond where people look in "
    "any image. More is better, but of KL."
)


@evaluate.command(
    epilog="Example: saccade evaluate fixations --images photos --fixations fixations.csv"
)
def fixations(
    images: Annotated[Path, typer.Option(help="Folder with the images that people looked at.")],
    fixations: Annotated[
        Path, typer.Option(help="CSV (image, viewer, index, x, y), or the .mat of OSIE.")
    ],
    maps: Annotated[
        Path | None, typer.Option(help="Folder with your own maps, named like the images.")
    ] = None,
    model: ModelChoice = Model.both,
    preset: Preset = None,
    config: Settings = None,
    sigma: Annotated[
        float,
        typer.Option(min=0.1, max=1000, help="Blur of the fixations in pixels, about 1 degree."),
    ] = 24.0,
    drop: Annotated[
        int, typer.Option(min=0, help="First fixations of each viewer that do not count.")
    ] = 1,
    per_image: Annotated[bool, typer.Option(help="Also show every image.")] = False,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Score saliency maps by where people looked.

    AUC over all pixels, shuffled AUC, NSS, CC, SIM, KL and information gain; means over the images
    with 95 % bootstrap intervals.
    """
    from dataclasses import asdict

    from saccade.cli.output import print_json, print_table
    from saccade.cli.report_builder import Table, write_table_page

    predict = _predictor(images, maps, model, preset, config)
    result = _score(images, fixations, predict, sigma, drop)
    mean, (low, high) = result.mean(), result.interval()
    columns = ["", "AUC", "sAUC", "NSS", "CC", "SIM", "KL", "IG (bit)"]
    rows = [_row("mean", mean), _row("95 % from", low), _row("95 % to", high)]
    each_image = [*map(_row, result.image, result.scores)]
    label = maps or f"{NAMES.get(model, model.value)}, {preset or config or 'default settings'}"
    title = f"{len(result.image)} images, {label}"
    lead = f"How well saliency maps foretell where people looked: {title}."
    write_table_page(
        report,
        "saccade evaluate fixations",
        lead,
        [
            Table("Mean over the images", columns, rows, MEANING, "score"),
            Table("Each image", columns, each_image, first="image"),
        ],
    )
    if as_json:
        scores = {
            name: asdict(each) for name, each in zip(result.image, result.scores, strict=True)
        }
        print_json(
            {"mean": asdict(mean), "low": asdict(low), "high": asdict(high), "images": scores}
        )
        return
    print_table(title, columns, [*rows, *each_image] if per_image else rows)


def _row(name: str, scores: Any) -> list[str]:
    from dataclasses import astuple

    return [name, *(f"{value:.3f}" for value in astuple(scores))]


def _score(
    images: Path,
    fixations: Path,
    model: Callable[[str], Any],
    sigma: float,
    drop: int,
) -> Any:
    import numpy as np

    from saccade.cli.output import print_message, tracked
    from saccade.datasets.fixations import read_fixations
    from saccade.errors import LogError
    from saccade.evaluation.fixations import inside
    from saccade.evaluation.prediction import PredictionScores, score_model
    from saccade.image import read_image

    table = read_fixations(fixations)
    counted = table.index >= drop
    if not counted.any():
        raise LogError(f"{fixations}: every fixation is among the first {drop}; lower --drop")
    places = {
        str(name): table.xy[counted & (table.image == name)]
        for name in np.unique(table.image[counted])
    }
    sizes = {name: read_image(images / name).shape[:2] for name in places}
    seen = {name: inside(xy, sizes[name]) for name, xy in places.items()}
    outside = sum(map(len, places.values())) - sum(map(len, seen.values()))
    if outside:
        print_message(f"{outside} fixations outside their images are left out")
    places = {name: xy for name, xy in seen.items() if len(xy)}
    scored = tracked(score_model(model, places, sizes, sigma), "scoring", len(places))
    names, scores = zip(*scored, strict=True)
    return PredictionScores(names, scores)


def _predictor(
    images: Path, maps: Path | None, model: Model, preset: str | None, config: Path | None
) -> Callable[[str], Any]:
    from saccade.image import as_gray, read_image
    from saccade.pyramid import resize

    if maps is None:
        attention = attention_model(model, preset, config)

        def predicted(name: str) -> Any:
            image = read_image(images / name)
            return resize(attention.maps(image).saliency, image.shape[:2])

        return predicted

    def brought(name: str) -> Any:
        shape = read_image(images / name).shape[:2]
        array = maps / f"{Path(name).stem}.npy"
        if array.is_file():
            return resize(_array_in(array), shape)
        return resize(as_gray(read_image(_picture_of(name, maps))), shape)

    return brought


def _array_in(path: Path) -> Any:
    """The map in an .npy file: any numbers, (h, w)."""
    import numpy as np

    from saccade.errors import ImageError
    from saccade.npz import map_array

    try:
        array = map_array(path)
    except (OSError, ValueError) as error:
        raise ImageError(f"{path}: expected a map as .npy, found another file") from error
    if array.ndim != 2 or array.size == 0 or array.dtype.kind not in "buif":
        raise ImageError(
            f"{path}: expected numbers of shape (h, w), found {array.dtype} of shape {array.shape}"
        )
    if not (np.abs(array.astype(np.float64)) < LARGEST).all():
        raise ImageError(f"{path}: expected finite numbers under {LARGEST:g}, found NaN or others")
    return array.astype(np.float32)


def _picture_of(name: str, folder: Path) -> Path:
    from saccade.errors import ImageError

    for path in (folder / name, folder / f"{Path(name).stem}.png"):
        if path.is_file():
            return path
    raise ImageError(f"{folder}: expected a map for {name} (.npy, .png or the same name)")
