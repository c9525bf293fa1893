"""`saccade look`: saliency maps and scanpaths."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from saccade.attention.models import AttentionModel
from saccade.attention.scanpath import ScanpathConfig, scanpath
from saccade.attention.scanpath_model import most_probable_scanpath, sample_scanpaths
from saccade.cli.images import Images, Row, analyze_each
from saccade.cli.look_video import look_at_video, video_table
from saccade.cli.model_options import PUBLISHED, ModelOptions, scanpath_network
from saccade.cli.options import (
    INPUT,
    OUTPUT,
    SEVERAL,
    JsonOptions,
    OutputFolder,
    figure_formats,
)
from saccade.cli.output import (
    Result,
    Table,
    relative_names,
    write_arrays,
)
from saccade.errors import ImageError, require, setting
from saccade.io.files import FORMATS, results_in
from saccade.io.image import read_image
from saccade.io.video import is_video
from saccade.keypoints import Sift, SiftConfig
from saccade.types import (
    FixationTable,
    Float32Array,
    FloatArray,
    Keypoints,
    Scanpath,
    ScanpathSamples,
)
from saccade.viewing import (
    Section,
    attention_figure,
    save_figures,
)
from saccade.viewing.report import MAX_DESCRIBED_POINTS, Part, ReportBuilder, image_part

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
    attention = options.attention_model(options.model, free_viewing=not options.without_center_bias)
    out, published = options.out, options.scanpath is None and options.preset in PUBLISHED
    by_network = published or options.scanpath == "winner-take-all"
    network = scanpath_network(options.preset) if by_network else None
    builder = ReportBuilder("saccade look", LEAD)
    paths = dict[Path, tuple[Scanpath, ScanpathSamples]]()

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
        return video_table(row)
    return Table(
        f"{row['image']} -> {row['picture']}",
        ["fixation", "x [px]", "y [px]", "time [ms]", "saliency"],
        [
            [str(i), f"{x:.0f}", f"{y:.0f}", f"{1000 * time:.0f}", f"{saliency:.3f}"]
            for i, (x, y, time, saliency) in enumerate(row["scanpath"], start=1)
        ],
    )


LEAD = "Saliency by contrast, symmetry and Boolean maps, and scanpaths."
TEXT = (
    "The map overlays the photograph, and the scanpath plays at a quarter of the model's speed. "
    "The cloud of thin lines is a hundred scanpaths drawn from the scanpath model; the amplitudes "
    "and directions of their saccades are below."
)
CLOUD_SIZE = 100
"""Number of scanpaths in the cloud."""


def analyze_image(
    path: Path,
    name: str,
    attention: AttentionModel,
    options: LookOptions,
    builder: ReportBuilder,
    network: ScanpathConfig | None = None,
) -> tuple[dict[str, Any], tuple[Scanpath, ScanpathSamples]]:
    """Write the requested outputs for an image to files, and to a report.

    Args:
        path: the image.
        name: name of the results in the output folder.
        attention: the model.
        options: formats, and length of the scanpath.
        builder: builder of the report.
        network: winner-take-all network; None for the most probable scanpath.

    Returns:
        The row for --json, and the scanpath with samples of the scanpath model.
    """
    image, out = read_image(path), options.out / f"{name}.look"
    try:
        maps = attention.maps(image)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from error
    if network is None:
        scan = most_probable_scanpath(maps, fixations=options.length)
    else:
        scan = scanpath(maps, network, fixations=options.length)
    samples = sample_scanpaths(maps, count=CLOUD_SIZE, fixations=options.length)
    layers = maps.layers
    pairs = attention.pairs(image, scan.xy)
    figure = attention_figure(image, layers, scan, pairs)
    picture = save_figures(figure, out, figure_formats(options.formats))
    scanpath_arrays = {
        "scanpath_xy": scan.xy,
        "scanpath_time": scan.time,
        "scanpath_saliency": scan.saliency,
        "scanpath_samples_xy": samples.xy,
        "scanpath_samples_time": samples.time,
    }
    row: dict[str, Any] = {
        "image": str(path),
        "width": image.shape[1],
        "height": image.shape[0],
        "scanpath": np.column_stack([scan.xy, scan.time, scan.saliency]).tolist(),
        "picture": str(picture),
    }
    if "csv" not in (options.formats or ()) or "npz" in (options.formats or ()):
        row["arrays"] = f"{out}.npz"
        write_arrays(Path(f"{out}.npz"), layers | scanpath_arrays | {"format": FORMATS["look"]})
    if options.maps:
        row["maps"] = write_maps(options.out / "maps", name, maps.upsampled, options)
    section = Section(path.name, "" if len(builder) else TEXT)

    def part() -> Part:
        strongest = SiftConfig(max_keypoints=MAX_DESCRIBED_POINTS, spread=True)
        keypoints = Sift(strongest)(image) if options.keypoints else Keypoints.at([], 1)
        return image_part(section, image, layers, scan, keypoints, samples)

    builder.add(part)
    return row, (scan, samples)


def write_maps(
    out: Path, name: str, layers: Mapping[str, Float32Array], options: LookOptions
) -> list[str]:
    """Write the maps (H, W) selected by --layers, or all, to one folder each; return the files.

    Raises:
        ConfigError: unknown map for this model.
    """
    from saccade.exchange import write_map

    chosen = options.layers or list(layers)
    for each in chosen:
        require(each in layers, "layers", f"names of {', '.join(layers)}", each)
    files = list[str]()
    for kind in options.maps or ():
        for each in chosen:
            files.append(str(out / each / f"{name}.{kind}"))
            write_map(files[-1], layers[each])
    return files


def write_scanpaths(
    out: Path, paths: Mapping[Path, tuple[Scanpath, ScanpathSamples]]
) -> dict[str, str]:
    """Write the scanpaths of all images, and their samples, as tables; return the files."""
    if not paths:
        return {}
    from saccade.datasets.fixations import write_fixations
    from saccade.evaluation.scanpaths import durations_of

    names = relative_names(list(paths))
    tables: dict[str, list[tuple[str, int, Scanpath, FloatArray]]] = {
        "scanpaths": [
            (names[path], 0, scan, durations_of(scan)[: len(scan)])
            for path, (scan, _) in paths.items()
        ],
        "samples": [
            (names[path], number, samples[number], samples.duration[number])
            for path, (_, samples) in paths.items()
            for number in range(len(samples))
        ],
    }
    files = {}
    for stem, rows in tables.items():
        images, subjects, scans, durations = zip(*rows, strict=True)
        lengths = [len(each) for each in scans]
        table = FixationTable(
            np.repeat(images, lengths),
            np.repeat(subjects, lengths),
            np.concatenate([np.arange(length) for length in lengths]),
            np.concatenate([each.xy for each in scans]),
            np.concatenate(durations),
        )
        onset = 1000 * np.concatenate([each.time for each in scans])
        saliency = np.concatenate([each.saliency for each in scans])
        files[f"{stem}_csv"] = str(out / f"{stem}.csv")
        write_fixations(out / f"{stem}.csv", table, onset_ms=onset, saliency=saliency)
    return files
