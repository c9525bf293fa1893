"""`saccade look`: saliency maps and scanpaths."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from saccade.cli.attention_models import Model, ModelChoice, attention_model
from saccade.cli.options import Config, Json, Out, Preset

if TYPE_CHECKING:
    from saccade.attention.models import AttentionModel
    from saccade.types import Float32Array, Scanpath
    from saccade.viewing import Section
    from saccade.viewing.report import Part
    from saccade.viewing.report_builder import ReportBuilder

LEAD = "Saliency by contrast and symmetry, scanpaths, and the strongest interest points."
TEXT = (
    "The map is laid over the photograph, and the scanpath plays four times slower than in the "
    "model; point at an interest point to see its size, angle and descriptor."
)


class Inhibition(StrEnum):
    """Region of inhibition of return."""

    disc = "disc"
    shape = "shape"


def look(
    images: Annotated[
        list[str],
        typer.Argument(metavar="IMAGE", help="Images, videos, folders, or quoted patterns."),
    ],
    out: Out = Path("saccade-look"),
    model: ModelChoice = Model.both,
    preset: Preset = None,
    config: Config = None,
    fixations: Annotated[
        int, typer.Option(min=1, max=1000, metavar="N", help="Length of the scanpath.")
    ] = 10,
    inhibition: Annotated[
        Inhibition,
        typer.Option(help="Inhibition of return: of a disc, or of the shape of a proto-object."),
    ] = Inhibition.disc,
    scanpath_film: Annotated[
        bool, typer.Option("--scanpath-film", help="Also animate each scanpath: NAME.scanpath.gif.")
    ] = False,
    every: Annotated[
        int, typer.Option(min=1, metavar="N", help="Use every Nth frame of a video.")
    ] = 1,
    as_json: Json = False,
) -> None:
    """Compute saliency by contrast and symmetry, and a scanpath.

    For each image --out receives a figure (NAME.look.png) and the arrays
    (NAME.look.npz), and for all of them an interactive report (report.html);
    for each video a film (NAME.look.mp4) and the saliency of its frames
    (NAME.look.npz).
    """
    from saccade.cli.output import for_each_image, print_json, print_table
    from saccade.cli.video import analyze_video
    from saccade.errors import ConfigError
    from saccade.image import find_images
    from saccade.video import is_video
    from saccade.viewing.report_builder import ReportBuilder

    by_shape = inhibition is Inhibition.shape
    if by_shape and model is Model.symmetry:
        raise ConfigError("inhibition: a shape needs --model contrast or both, found symmetry")
    attention = attention_model(model, preset, config, keep_features=by_shape)
    builder = ReportBuilder("saccade look", LEAD)

    def process(path: Path, name: str) -> dict[str, Any]:
        file = out / f"{name}.look"
        if is_video(path):
            return analyze_video(path, file, attention, every)
        return analyze_image(
            path, file, attention, fixations, builder, by_shape=by_shape, film=scanpath_film
        )

    paths = [path for source in images for path in find_images(source)]
    try:
        rows = for_each_image(paths, out, process)
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


def analyze_image(
    path: Path,
    out: Path,
    attention: "AttentionModel",
    fixations: int,
    builder: "ReportBuilder",
    *,
    by_shape: bool = False,
    film: bool = False,
) -> dict[str, Any]:
    """Write `out`.png, `out`.npz and the scanpath's film, return the row for --json.

    Args:
        path: the image.
        out: the files without suffix.
        attention: the saliency model.
        fixations: length of the scanpath.
        builder: report to which the image is added.
        by_shape: whether proto-objects rather than discs are inhibited.
        film: whether the scanpath is animated.
    """
    from functools import partial

    import numpy as np

    from saccade.attention.models import contrast_of, layers_of
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
    region = partial(proto_object, contrast_of(maps)) if by_shape else None
    scan = scanpath(maps.saliency, image.shape, fixations=fixations, region=region)
    layers = layers_of(maps, attention.model)
    pairs = attention.pairs(image, scan.xy)
    picture = save_figure(attention_figure(image, layers, scan, pairs), f"{out}.png")
    arrays = Path(f"{out}.npz")
    scanpath_arrays = {
        "scanpath_xy": scan.xy,
        "scanpath_time": scan.time,
        "scanpath_saliency": scan.saliency,
    }
    write_arrays(arrays, layers | scanpath_arrays | {"format": FORMATS["look"]})
    row = {
        "image": str(path),
        "width": image.shape[1],
        "height": image.shape[0],
        "scanpath": np.column_stack([scan.xy, scan.time, scan.saliency]).tolist(),
        "picture": str(picture),
        "arrays": str(arrays),
    }
    section = Section(path.name, "" if len(builder) else TEXT)
    builder.add(lambda: _part(section, image, layers, scan))
    if film:
        file = out.with_name(f"{out.name.removesuffix('.look')}.scanpath.gif")
        row["film"] = str(save_film(*scanpath_frames(image, scan), file))
    return row


def _part(
    section: "Section",
    image: "Float32Array",
    layers: "dict[str, Float32Array]",
    scan: "Scanpath",
) -> "Part":
    """The image as a part of a report, with its strongest interest points."""
    from saccade import Sift, SiftConfig
    from saccade.viewing.report_image import MAX_POINTS, image_part

    keypoints = Sift(SiftConfig(max_keypoints=MAX_POINTS, spread=True))(image)
    return image_part(section, image, layers, scan, keypoints)
