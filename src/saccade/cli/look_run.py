"""Saliency and scanpaths of images, written to files."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from saccade.attention.models import AttentionModel, bare_saliency, contrast_of
from saccade.attention.scanpath import ScanpathConfig, proto_object, scanpath
from saccade.attention.scanpath_model import most_probable_scanpath, sample_scanpaths
from saccade.cli.look_files import LookFiles
from saccade.cli.output import write_arrays
from saccade.errors import ImageError
from saccade.io.formats import FORMATS
from saccade.io.image import read_image
from saccade.keypoints import Sift, SiftConfig
from saccade.types import Float32Array, Scanpath, ScanpathSamples
from saccade.viewing import (
    Section,
    attention_figure,
    save_figures,
    save_film,
    scanpath_frames,
)
from saccade.viewing.report import MAX_POINTS, Part, ReportBuilder, image_part

LEAD = "Saliency by contrast and symmetry, scanpaths, and the strongest interest points."
TEXT = (
    "The map is laid over the photograph, and the scanpath plays four times slower than in the "
    "model. Point at an interest point to see its size, angle and descriptor. The cloud of thin "
    "lines is a hundred scanpaths drawn from the scanpath model; below are the amplitudes and the "
    "directions of their saccades."
)
SAMPLES = 100
"""Scanpaths of the cloud."""


def analyze_image(
    path: Path,
    out: Path,
    attention: AttentionModel,
    fixations: int,
    builder: ReportBuilder,
    files: LookFiles | None = None,
    *,
    network: ScanpathConfig | None = None,
    by_shape: bool = False,
    film: bool = False,
) -> dict[str, Any]:
    """Write `out`.png, `out`.npz and the scanpath's film, return the row for --json.

    The image is added to a report, and its scanpaths to those of `files`, which names other
    formats. `by_shape` inhibits proto-objects rather than discs.
    """
    files = files or LookFiles()
    image = read_image(path)
    try:
        maps = attention.maps(image)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from error
    bare = bare_saliency(maps)
    if network is None:
        scan = most_probable_scanpath(bare, image.shape, fixations)
    else:
        region = partial(proto_object, contrast_of(maps)) if by_shape else None
        scan = scanpath(maps.saliency, image.shape, fixations, network, region=region)
    samples = sample_scanpaths(bare, image.shape, SAMPLES, fixations)
    layers = maps.layers
    pairs = attention.pairs(image, scan.xy)
    picture = save_figures(attention_figure(image, layers, scan, pairs), out, files.figures)
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
    if files.arrays:
        row["arrays"] = f"{out}.npz"
        write_arrays(Path(f"{out}.npz"), layers | scanpath_arrays | {"format": FORMATS["look"]})
    if files.maps:
        name = out.name.removesuffix(".look")
        row["maps"] = files.write_maps(out.parent, name, maps.full_size)
    files.paths[path] = scan, samples
    section = Section(path.name, "" if len(builder) else TEXT)
    builder.add(lambda: _part(section, image, layers, scan, samples))
    if film:
        file = out.with_name(f"{out.name.removesuffix('.look')}.scanpath.gif")
        row["film"] = str(save_film(*scanpath_frames(image, scan), file))
    return row


def _part(
    section: Section,
    image: Float32Array,
    layers: dict[str, Float32Array],
    scan: Scanpath,
    samples: ScanpathSamples,
) -> Part:
    """The image as a part of a report, with its strongest interest points."""
    keypoints = Sift(SiftConfig(max_keypoints=MAX_POINTS, spread=True))(image)
    return image_part(section, image, layers, scan, keypoints, samples)
