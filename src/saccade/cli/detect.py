"""`saccade detect`: keypoints and descriptors."""

import os
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from saccade.cli.options import Config, Images, Json, MaxKeypoints, Out, Preset, Spread

if TYPE_CHECKING:
    from saccade.types import Keypoints

    Detections: TypeAlias = tuple[Keypoints, tuple[int, ...]]
    """The keypoints of an image, and its shape."""


class Detector(StrEnum):
    """Keypoint detectors."""

    SIFT = "sift"
    MUST = "must"
    SYMROID = "symroid"


class Format(StrEnum):
    """File formats of keypoints."""

    NPZ = "npz"
    CSV = "csv"
    PARQUET = "parquet"
    HDF5 = "hdf5"
    COLMAP = "colmap"


MAX_EXPLAINED = 20
"""Number of the strongest points whose symmetric pairs are drawn."""

SHARED_FILES = {
    Format.PARQUET: "keypoints.parquet",
    Format.HDF5: "keypoints.h5",
    Format.COLMAP: "database.db",
}
"""Formats that hold the keypoints of all images, and the names of the files."""


def detect(
    images: Images,
    out: Out = Path("saccade-detect"),
    detector: Annotated[
        Detector,
        typer.Option(help="SIFT, points of symmetry (must), or regions of symmetry (symroid)."),
    ] = Detector.SIFT,
    preset: Preset = None,
    config: Config = None,
    max_keypoints: MaxKeypoints = None,
    spread: Spread = False,
    formats: Annotated[
        list[Format] | None,
        typer.Option("--format", "-f", help="Output format, npz by default; may be repeated."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Detect and describe keypoints.

    For each image --out receives a figure (NAME.keypoints.png), for points and
    regions of symmetry another with the edge pairs that contribute to them
    (NAME.pairs.png), and the keypoints as NAME.keypoints.npz or .csv (without
    descriptors). Keypoints of all images go to keypoints.parquet, keypoints.h5
    (in the layout of hloc) or database.db (for COLMAP).
    """
    from saccade.cli.detectors import make_detector
    from saccade.cli.output import for_each_image, print_json, print_table
    from saccade.errors import OutputError, SaccadeError
    from saccade.image import find_images

    chosen = list(dict.fromkeys(formats or [Format.NPZ]))
    require_libraries(chosen)
    find = make_detector(detector.value, preset, config, max_keypoints, spread=spread)
    paths = [path for source in images for path in find_images(source)]
    shared = [each for each in chosen if each in SHARED_FILES]
    detections: dict[Path, Detections] = {}

    def process(path: Path, name: str) -> dict[str, Any]:
        row, keypoints = detect_in(path, out / f"{name}.keypoints", find, chosen)
        if shared:
            detections[path] = keypoints
        return row

    try:
        rows = for_each_image(paths, out, process)
    except OutputError:
        raise
    except SaccadeError:
        if detections:  # the message says that the others are there
            write_shared(detections, out, shared)
        raise
    files = write_shared(detections, out, shared)
    if as_json:
        print_json({"images": rows} | ({"files": files} if files else {}))
        return
    print_table(
        f"keypoints -> {out}",
        ["image", "points", "median size [px]"],
        [[row["image"], str(row["points"]), f"{row['median_size']:.1f}"] for row in rows],
    )


def require_libraries(formats: Sequence[Format]) -> None:
    """Import the libraries of the formats, to fail before any work is done."""
    from saccade.exchange.colmap import import_pycolmap
    from saccade.extras import import_optional

    if Format.COLMAP in formats:
        import_pycolmap()
    if Format.HDF5 in formats:
        import_optional("h5py", Format.HDF5)
    if Format.PARQUET in formats:
        import_optional("pyarrow", Format.PARQUET)


def detect_in(
    path: Path, out: Path, find: Any, formats: Sequence[Format]
) -> tuple[dict[str, Any], "Detections"]:
    """Detect in one image: write `out`.png and its files, return the row for --json."""
    import numpy as np

    from saccade import exchange
    from saccade.cli.symmetry_overlay import contributing_pairs
    from saccade.image import read_image
    from saccade.keypoints import Must
    from saccade.types import Regions
    from saccade.viewing import keypoint_figure, pair_figure, region_figure, save_figure

    image = read_image(path)
    detections = find(image)
    regions = isinstance(detections, Regions)
    keypoints = detections.keypoints if regions else detections
    figure = region_figure(image, detections) if regions else keypoint_figure(image, keypoints)
    row: dict[str, Any] = {
        "image": str(path),
        "points": len(keypoints),
        "median_size": float(np.median(keypoints.size)) if len(keypoints) else 0.0,
        "picture": str(save_figure(figure, f"{out}.png")),
    }
    if regions:
        row["boxes"] = detections.boxes.tolist()
    if regions or isinstance(find, Must):
        pairs = contributing_pairs(find, image, keypoints[:MAX_EXPLAINED])
        picture = out.with_name(f"{out.name.removesuffix('.keypoints')}.pairs.png")
        row["pairs"] = str(save_figure(pair_figure(image, pairs), picture))
    if Format.NPZ in formats:
        row["arrays"] = f"{out}.npz"
        exchange.write_npz(row["arrays"], keypoints)
    if Format.CSV in formats:
        row["table"] = f"{out}.csv"
        exchange.write_csv(row["table"], keypoints)
    return row, (keypoints, image.shape)


def write_shared(
    detections: Mapping[Path, "Detections"], out: Path, formats: Sequence[Format]
) -> dict[str, str]:
    """Write the keypoints of all images in one file for each format; return the paths."""
    from saccade import exchange

    names = relative_names(list(detections))
    keypoints = {names[path]: each for path, (each, _) in detections.items()}
    shapes = {names[path]: shape for path, (_, shape) in detections.items()}
    files = {str(each): str(out / SHARED_FILES[each]) for each in formats}
    if Format.PARQUET in formats:
        exchange.write_parquet(files["parquet"], keypoints)
    if Format.HDF5 in formats:
        exchange.write_hdf5(files["hdf5"], keypoints, shapes)
    if Format.COLMAP in formats:
        exchange.write_colmap(files["colmap"], keypoints, shapes)
    return files


def relative_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Each path relative to the common folder, as COLMAP and hloc name images."""
    from saccade.files import as_text

    if not paths:
        return {}
    absolute = [path.absolute() for path in paths]
    root = os.path.commonpath([path.parent for path in absolute])
    return {
        path: as_text(each.relative_to(root).as_posix())
        for path, each in zip(paths, absolute, strict=True)
    }
