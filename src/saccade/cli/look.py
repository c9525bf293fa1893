"""`saccade look`: saliency, conspicuity and scanpath."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from saccade.cli.attention_models import Model, ModelChoice, attention_model
from saccade.cli.options import Json, Out, Preset, Settings
from saccade.cli.report_builder import ReportBuilder

if TYPE_CHECKING:
    from saccade.attention.models import AttentionModel
    from saccade.types import Float32Array, Scanpath
    from saccade.viewing import Section
    from saccade.viewing.report import Part

TEXT = (
    "The map is laid over the photograph, the scanpath plays four times slower than the model; "
    "point at an interest point to see its size, angle and descriptor."
)


class Inhibition(StrEnum):
    """What inhibition of return covers."""

    disc = "disc"
    shape = "shape"


def look(
    images: Annotated[
        list[str],
        typer.Argument(
            metavar="IMAGE...", help="Images, folders of images, quoted patterns, or videos."
        ),
    ],
    out: Out = Path("saccade-look"),
    model: ModelChoice = Model.both,
    preset: Preset = None,
    config: Settings = None,
    fixations: Annotated[int, typer.Option(min=1, max=1000, help="Length of the scanpath.")] = 10,
    inhibition: Annotated[
        Inhibition,
        typer.Option(help="What is covered once seen: a disc, or the shape of the object."),
    ] = Inhibition.disc,
    scanpath_film: Annotated[
        bool, typer.Option("--scanpath-film", help="Also play each scanpath as NAME.scanpath.gif.")
    ] = False,
    every: Annotated[int, typer.Option(min=1, help="Of a video, take one frame of so many.")] = 1,
    as_json: Json = False,
) -> None:
    """Show where contrast and symmetry draw the eye: saliency, its parts and a scanpath.

    For each image a picture (NAME.look.png) and the arrays (NAME.look.npz) appear in --out, and
    all of them on a page with layers to switch (report.html); for each video a film
    (NAME.look.mp4) and the saliency of its frames (NAME.look.npz).
    """
    from saccade.cli.output import for_each_image, print_json, print_table
    from saccade.cli.video import analyze_video
    from saccade.errors import ConfigError
    from saccade.image import find_images
    from saccade.video import is_video

    by_shape = inhibition is Inhibition.shape
    if by_shape and model is Model.symmetry:
        raise ConfigError("inhibition: a shape needs --model contrast or both, found symmetry")
    attention = attention_model(model, preset, config, keep_features=by_shape)

    def look_or_watch(path: Path, name: str) -> dict[str, Any]:
        if is_video(path):
            return analyze_video(path, out / f"{name}.look", attention, every)
        return look_at(
            path,
            out / f"{name}.look",
            attention,
            fixations,
            by_shape=by_shape,
            film=scanpath_film,
            builder=builder,
        )

    paths = [path for source in images for path in find_images(source)]
    builder = ReportBuilder(
        "saccade look", "Where contrast and symmetry draw the eye, and what can be found again."
    )
    try:
        rows = for_each_image(paths, out, look_or_watch)
    finally:
        report = builder.write(out / "report.html") if len(builder) else None
    if as_json:
        print_json({"images": rows, "report": None if report is None else str(report)})
        return
    for row in rows:
        if "frames" in row:
            facts = [["frames", str(row["frames"])], ["film", row["film"]]]
            print_table(row["image"], ["", ""], facts)
            continue
        print_table(
            f"{row['image']} -> {row['picture']}",
            ["fixation", "x [px]", "y [px]", "time [ms]", "saliency"],
            [
                [str(i), f"{x:.0f}", f"{y:.0f}", f"{1000 * time:.0f}", f"{saliency:.3f}"]
                for i, (x, y, time, saliency) in enumerate(row["scanpath"], start=1)
            ],
        )


def look_at(
    path: Path,
    out: Path,
    attention: "AttentionModel",
    fixations: int,
    *,
    by_shape: bool = False,
    film: bool = False,
    builder: ReportBuilder | None = None,
) -> dict[str, Any]:
    """Look at one image: write `out`.png, `out`.npz and the film, give the row for --json.

    Args:
        path: the image.
        out: what is written, without its suffix.
        attention: the model.
        fixations: length of the scanpath.
        by_shape: whether inhibition of return covers objects rather than discs.
        film: whether the scanpath is also played.
        builder: takes the image with its layers, for a report.
    """
    from functools import partial

    import numpy as np

    from saccade.attention.proto_object import proto_object
    from saccade.attention.scanpath import scanpath
    from saccade.cli.output import write_arrays
    from saccade.errors import ImageError
    from saccade.formats import FORMATS
    from saccade.image import read_image
    from saccade.viewing import Section, attention_figure, save_figure, save_film, scanpath_frames

    image = read_image(path)
    try:
        maps = attention.maps(image)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from error
    from saccade.attention.models import contrast_of

    region = partial(proto_object, contrast_of(maps)) if by_shape else None
    fixated = scanpath(maps.saliency, image.shape, fixations=fixations, region=region)
    layers = maps.layers
    pairs = attention.pairs(image, fixated.xy)
    picture = save_figure(attention_figure(image, layers, fixated, pairs), f"{out}.png")
    arrays = Path(f"{out}.npz")
    scanpath_arrays = {
        "scanpath_xy": fixated.xy,
        "scanpath_time": fixated.time,
        "scanpath_saliency": fixated.saliency,
    }
    write_arrays(arrays, layers | scanpath_arrays | {"format": FORMATS["look"]})
    table = np.column_stack([fixated.xy, fixated.time, fixated.saliency])
    row = {
        "image": str(path),
        "width": image.shape[1],
        "height": image.shape[0],
        "scanpath": table.tolist(),
        "picture": str(picture),
        "arrays": str(arrays),
    }
    if builder is not None:
        text = "" if len(builder) else TEXT
        builder.add(lambda: _part(Section(path.name, text), image, layers, fixated))
    if film:
        played = out.with_name(f"{out.name.removesuffix('.look')}.scanpath.gif")
        row["film"] = str(save_film(*scanpath_frames(image, fixated), played))
    return row


def _part(
    section: "Section",
    image: "Float32Array",
    layers: "dict[str, Float32Array]",
    fixated: "Scanpath",
) -> "Part":
    """The image as a part of a report, with the strongest interest points of all over it."""
    from saccade import Sift, SiftConfig
    from saccade.viewing.report_image import MAX_POINTS, image_part

    points = Sift(SiftConfig(max_keypoints=MAX_POINTS, spread=True))(image)
    return image_part(section, image, layers, fixated, points)
