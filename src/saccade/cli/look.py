"""`saccade look`: saliency maps and scanpaths."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from saccade.cli.images import Images, Row, analyze_each
from saccade.cli.model_options import PUBLISHED, ModelOptions, scanpath_network
from saccade.cli.options import INPUT, OUTPUT, SEVERAL, JsonOptions, OutputFolder
from saccade.cli.output import Result, Table
from saccade.errors import setting
from saccade.io.files import results_in
from saccade.io.video import is_video

if TYPE_CHECKING:
    from saccade.types import Scanpath, ScanpathSamples

Format = Literal["npz", "csv", "png", "svg", "pdf"]
"""File formats of arrays, of tables of scanpaths, and of figures."""
MapFormat = Literal["npy", "mat", "png", "tiff"]
"""File formats of maps at the size of the image."""


@dataclass(frozen=True, kw_only=True)
class LookOptions(ModelOptions, JsonOptions):
    """Options of `saccade look`."""

    out: OutputFolder = Path("saccade-look")
    without_center_bias: bool = False
    """Saliency of the content alone, without the position prior (people prefer the center of a
    photograph and avoid its border)."""
    length: int = setting(10, 1, 1000)
    """Number of fixations of the scanpath, 1 to 1000."""
    scanpath: Literal["most-probable", "winner-take-all"] | None = None
    """Most probable path of the scanpath model (the default), or the path of the winner-take-all
    network (the default with --preset kootstra2010, itti1998 and saliencytoolbox2)."""
    formats: Annotated[list[Format] | None, OUTPUT, SEVERAL, Parameter(("--format", "-f"))] = None
    """Output formats for maps and scanpaths (npz by default, or csv for scanpaths) and for figures
    (png by default), separated by commas."""
    maps: Annotated[list[MapFormat] | None, OUTPUT, SEVERAL] = None
    """Also write the maps at the size of the image: npy or tiff (float32), mat, or png (16 bit);
    several with commas."""
    layers: Annotated[list[str] | None, OUTPUT, SEVERAL] = None
    """Restrict --maps to these layers, such as saliency, contrast, symmetry; several with
    commas."""
    every: Annotated[int, INPUT, Parameter(metavar="N")] = setting(1, 1)
    """Use every Nth frame of a video."""
    keypoints: bool = False
    """Show the strongest interest points in the report."""


def look(*images: Images, options: LookOptions = LookOptions()) -> Result:
    """Compute saliency maps and a scanpath.

    The map predicts where people look at a photograph on a screen; with
    --without-center-bias it depends on the content of the image alone. Values of
    different models, presets and images have no common scale.

    Writes to --out, for each image, a figure (NAME.look.png) and the arrays
    (NAME.look.npz), and an interactive report of all images (report.html).
    --format csv writes the scanpaths of all images to scanpaths.csv, and a
    hundred samples for each image to samples.csv; --maps writes each map to
    maps/MAP/NAME.npy. For a video, it writes a film of the gaze beside the
    saliency, which includes flicker and motion (NAME.look.mp4), and the arrays.

    Exit code 1: some images could not be read; --out has the results of the
    others. Ctrl-C stops after the image in progress.

    Example: saccade look photo.jpg --length 5 --out looked
    """
    from saccade.cli.look_image import LEAD, analyze_image, write_scanpaths
    from saccade.cli.look_video import look_at_video
    from saccade.viewing.report import ReportBuilder

    attention = options.attention_model(options.model, free_viewing=not options.without_center_bias)
    out, published = options.out, options.scanpath is None and options.preset in PUBLISHED
    by_network = published or options.scanpath == "winner-take-all"
    network = scanpath_network(options.preset) if by_network else None
    builder = ReportBuilder("saccade look", LEAD)
    paths: dict[Path, tuple[Scanpath, ScanpathSamples]] = {}

    def of_image(path: Path, name: str) -> Row:
        if is_video(path):
            return look_at_video(path, out / f"{name}.look", attention, options.every)
        row, paths[path] = analyze_image(path, name, attention, options, builder, network)
        return row

    with results_in(out):
        rows, code = analyze_each(images, out, of_image)
        report = builder.write(out / "report.html") if len(builder) else None
        written = write_scanpaths(out, paths) if "csv" in (options.formats or ()) else {}
    row: dict[str, Any] = {"images": rows, "report": None if report is None else str(report)}
    row |= {"files": written} if written else {}
    return Result(row, [_table(each) for each in rows], code)


def _table(row: dict[str, Any]) -> Table:
    """Table of the scanpath on an image, or of the film of a video."""
    if "frames" in row:
        from saccade.cli.look_video import video_table

        return video_table(row)
    return Table(
        f"{row['image']} -> {row['picture']}",
        ["fixation", "x [px]", "y [px]", "time [ms]", "saliency"],
        [
            [str(i), f"{x:.0f}", f"{y:.0f}", f"{1000 * time:.0f}", f"{saliency:.3f}"]
            for i, (x, y, time, saliency) in enumerate(row["scanpath"], start=1)
        ],
    )
