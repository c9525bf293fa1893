"""Saliency, scanpaths and report of a photograph, for `saccade look`."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from saccade.attention.models import AttentionModel
from saccade.attention.scanpath import ScanpathConfig, scanpath
from saccade.attention.scanpath_model import most_probable_scanpath, sample_scanpaths
from saccade.cli.options import figure_formats
from saccade.cli.output import relative_names, write_arrays
from saccade.errors import ImageError, require
from saccade.io.files import FORMATS
from saccade.io.image import read_image
from saccade.keypoints import Sift, SiftConfig
from saccade.types import (
    FixationTable,
    Float32Array,
    FloatArray,
    Keypoints,
    Scanpath,
    ScanpathSamples,
)
from saccade.viewing import Section, attention_figure, save_figures
from saccade.viewing.report import MAX_DESCRIBED_POINTS, Part, ReportBuilder, image_part

if TYPE_CHECKING:
    from saccade.cli.look import LookOptions

LEAD = "Saliency by contrast, symmetry and Boolean maps, and scanpaths."
TEXT = (
    "The map overlays the photograph, and the scanpath plays at a quarter of the model's speed. "
    "A hundred scanpaths drawn from the scanpath model can be shown as a cloud of thin lines; the "
    "amplitudes and directions of their saccades are below."
)
CLOUD_SIZE = 100
"""Number of scanpaths in the cloud."""


def analyze_image(
    path: Path,
    name: str,
    attention: AttentionModel,
    options: "LookOptions",
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

    Raises:
        ConfigError: a map named by --layers that the model does not have.
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
    chosen = options.layers if options.maps else None
    for each in chosen or ():
        require(each in layers, "layers", f"names of {', '.join(layers)}", each)
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
    out: Path, name: str, layers: Mapping[str, Float32Array], options: "LookOptions"
) -> list[str]:
    """Write the maps (H, W) selected by --layers, or all, to one folder each; return the files."""
    from saccade.exchange import write_map

    chosen = options.layers or list(layers)
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
