"""`saccade look`: saliency maps and scanpaths."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from saccade.cli.attention_models import (
    DEFAULT_MODEL,
    PUBLISHED,
    Faces,
    ModelChoice,
    attention_model,
    scanpath_network,
)
from saccade.cli.options import (
    MAX_CAMERA_FRAMES,
    Camera,
    CameraFrames,
    Config,
    Json,
    LivePage,
    LiveWindow,
    Out,
    Preset,
    figure_formats,
    images_or_camera,
)


class Format(StrEnum):
    """File formats of arrays, of tables of scanpaths, and of figures."""

    NPZ = "npz"
    CSV = "csv"
    MAT = "mat"
    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


class MapFormat(StrEnum):
    """File formats of maps at the size of the image."""

    NPY = "npy"
    MAT = "mat"
    PNG = "png"
    TIFF = "tiff"


class PathModel(StrEnum):
    """How the scanpath is found."""

    most_probable = "most-probable"
    winner_take_all = "winner-take-all"


class Inhibition(StrEnum):
    """Region of inhibition of return."""

    disc = "disc"
    shape = "shape"


def look(
    images: Annotated[
        list[str] | None,
        Argument(metavar="IMAGE", help="Images, videos, folders, or quoted patterns."),
    ] = None,
    out: Out = Path("saccade-look"),
    model: ModelChoice = DEFAULT_MODEL,
    preset: Preset = None,
    config: Config = None,
    faces: Faces = None,
    bare: Annotated[
        bool,
        Option(
            "--bare",
            help="Saliency of the content alone: without the prior of the position, by which "
            "people look at the center of a photograph and not at its border.",
        ),
    ] = False,
    fixations: Annotated[
        int, Option(min=1, max=1000, metavar="N", help="Length of the scanpath.")
    ] = 10,
    scanpath: Annotated[
        PathModel | None,
        Option(
            help="The most probable path of the scanpath model, or that of the winner-take-all "
            "network, the default with --preset kootstra2010, itti1998 and saliencytoolbox2.",
            show_default="most-probable",
        ),
    ] = None,
    inhibition: Annotated[
        Inhibition,
        Option(
            help="Inhibition of return in the winner-take-all network: of a disc, or of the shape "
            "of a proto-object."
        ),
    ] = Inhibition.disc,
    scanpath_film: Annotated[
        bool, Option("--scanpath-film", help="Also animate each scanpath: NAME.scanpath.gif.")
    ] = False,
    formats: Annotated[
        list[Format] | None,
        Option(
            "--format",
            "-f",
            help="Output format: of the maps and scanpaths, npz by default, or csv and mat for the "
            "scanpaths; and of the figures, png by default; several with commas.",
        ),
    ] = None,
    maps: Annotated[
        list[MapFormat] | None,
        Option(
            help="Also write every map at the size of the image: npy and tiff of float32, mat, or "
            "png of 16 bits; several with commas."
        ),
    ] = None,
    every: Annotated[int, Option(min=1, metavar="N", help="Use every Nth frame of a video.")] = 1,
    camera: Camera = None,
    frames: CameraFrames = MAX_CAMERA_FRAMES,
    live: LiveWindow = False,
    page: LivePage = False,
    as_json: Json = False,
) -> None:
    """Compute saliency by contrast and symmetry, and a scanpath.

    The map shows where people look at a photograph on a screen; with --bare it
    depends on the content of the image alone. Values of different models,
    presets and images have no common scale.

    For each image --out receives a figure (NAME.look.png) and the arrays
    (NAME.look.npz), and for all of them an interactive report (report.html);
    for each video a film of the gaze beside the saliency, which has flicker
    and motion (NAME.look.mp4), and both as arrays (NAME.look.npz). With
    --format csv or mat the scanpaths of all images go to scanpaths.csv, and a
    hundred drawn ones of each to samples.csv; with --maps each map goes to
    maps/MAP/NAME.npy. Of a --camera the film is camera.look.mp4; Ctrl-C ends
    it.

    Exit code 1: some images could not be read; the results of the others are
    in --out. Ctrl-C stops after the image in progress.
    """
    from saccade.cli.look_files import LookFiles
    from saccade.cli.look_run import LEAD, analyze_image
    from saccade.cli.look_video import analyze_video
    from saccade.cli.output import for_each_image, print_json, print_result, print_table
    from saccade.cli.precompile import points_compiled_ahead
    from saccade.errors import ConfigError
    from saccade.io.files import results_in
    from saccade.io.image import find_images
    from saccade.io.video import is_video
    from saccade.viewing.report import ReportBuilder

    sources = images_or_camera(images, camera)
    by_shape = inhibition is Inhibition.shape
    if by_shape and scanpath is PathModel.most_probable:
        raise ConfigError("inhibition: a shape needs --scanpath winner-take-all")
    if by_shape and model not in (DEFAULT_MODEL, "contrast"):
        raise ConfigError(f"inhibition: a shape needs --model attention or contrast, found {model}")
    attention = attention_model(
        model, preset, config, keep_features=by_shape, faces=faces, free_viewing=not bare
    )
    if camera is not None:
        from saccade.cli.live_run import Live, look_at_camera

        with results_in(out):
            row = look_at_camera(Live(camera, frames, live, page), out, attention)
        print_result(row, as_json, f"camera -> {out}")
        return
    published = scanpath is None and preset in PUBLISHED
    by_network = by_shape or published or scanpath is PathModel.winner_take_all
    network = scanpath_network(preset) if by_network else None
    builder = ReportBuilder("saccade look", LEAD)
    chosen = list(dict.fromkeys(formats or []))
    tables = [each for each in chosen if each in (Format.CSV, Format.MAT)]
    files = LookFiles(
        figure_formats(chosen), Format.NPZ in chosen or not tables, tables, [*(maps or [])]
    )

    def process(path: Path, name: str) -> dict[str, Any]:
        file = out / f"{name}.look"
        if is_video(path):
            return analyze_video(path, file, attention, every)
        return analyze_image(
            *(path, file, attention, fixations, builder, files),
            network=network,
            by_shape=by_shape,
            film=scanpath_film,
        )

    paths = [path for source in sources for path in find_images(source)]
    with results_in(out), points_compiled_ahead():
        rows, code = for_each_image(paths, out, process)
        report = builder.write(out / "report.html") if len(builder) else None
        written = files.write_tables(out)
    if as_json:
        result = {"images": rows, "report": None if report is None else str(report)}
        print_json(result | ({"files": written} if written else {}))
        raise typer.Exit(code)
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
    raise typer.Exit(code)
