"""`saccade detect`: interest points."""

import os
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from saccade.cli.options import Images, Json, Out, Preset, Settings

if TYPE_CHECKING:
    from saccade.types import Keypoints

    Found: TypeAlias = tuple[Keypoints, tuple[int, ...]]
    """The points of an image, and its shape."""

Most = Annotated[
    int | None, typer.Option("--max", min=1, help="Keep only this many, the strongest.")
]
Spread = Annotated[
    bool, typer.Option("--spread", help="With --max: keep those that spread over the image.")
]


class Detector(StrEnum):
    """What finds the points."""

    SIFT = "sift"
    MUST = "must"
    SYMROID = "symroid"


class Format(StrEnum):
    """Files that points are written to."""

    NPZ = "npz"
    CSV = "csv"
    PARQUET = "parquet"
    HDF5 = "hdf5"
    COLMAP = "colmap"


EXPLAINED = 20
"""Of the strongest points it is shown which pairs made them."""

TOGETHER = {
    Format.PARQUET: "keypoints.parquet",
    Format.HDF5: "keypoints.h5",
    Format.COLMAP: "database.db",
}
"""What holds the points of all images in one file, and its name."""


def detect(
    images: Images,
    out: Out = Path("saccade-detect"),
    detector: Annotated[
        Detector,
        typer.Option(help="SIFT, symmetric points (must), or regions of symmetry (symroid)."),
    ] = Detector.SIFT,
    preset: Preset = None,
    config: Settings = None,
    most: Most = None,
    spread: Spread = False,
    formats: Annotated[
        list[Format] | None,
        typer.Option("--format", "-f", help="May be repeated; the default is npz."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Find interest points and describe them.

    For each image a picture (NAME.keypoints.png) appears in --out, for symmetric
    ones another that shows the pairs of edges which made them (NAME.pairs.png), and the
    points: in NAME.keypoints.npz or .csv (which has no descriptors), or those
    of all images in keypoints.parquet, keypoints.h5 (as hloc reads it) or
    database.db (for COLMAP).
    """
    from saccade.cli.detectors import make_detector
    from saccade.cli.output import for_each_image, print_json, print_table
    from saccade.errors import OutputError, SaccadeError
    from saccade.image import find_images

    chosen = list(dict.fromkeys(formats or [Format.NPZ]))
    require_libraries(chosen)
    find = make_detector(detector.value, preset, config, most, spread=spread)
    paths = [path for source in images for path in find_images(source)]
    together = [each for each in chosen if each in TOGETHER]
    found: dict[Path, Found] = {}

    def work(path: Path, name: str) -> dict[str, Any]:
        row, points = detect_in(path, out / f"{name}.keypoints", find, chosen)
        if together:
            found[path] = points
        return row

    try:
        rows = for_each_image(paths, out, work)
    except OutputError:
        raise
    except SaccadeError:
        if found:  # the message says that the others are there
            write_together(found, out, together)
        raise
    files = write_together(found, out, together)
    if as_json:
        print_json({"images": rows} | ({"files": files} if files else {}))
        return
    print_table(
        f"interest points -> {out}",
        ["image", "points", "median size [px]"],
        [[row["image"], str(row["points"]), f"{row['median_size']:.1f}"] for row in rows],
    )


def require_libraries(formats: Sequence[Format]) -> None:
    """Import what the formats need, before any work is done."""
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
) -> tuple[dict[str, Any], "Found"]:
    """Detect in one image: write `out`.png and its files, give the row for --json."""
    import numpy as np

    from saccade import exchange
    from saccade.cli.symmetry_overlay import contributing_pairs
    from saccade.image import read_image
    from saccade.keypoints import Must
    from saccade.types import Regions
    from saccade.viewing import keypoint_figure, pair_figure, region_figure, save_figure

    image = read_image(path)
    found = find(image)
    regions = isinstance(found, Regions)
    keypoints = found.keypoints if regions else found
    figure = region_figure(image, found) if regions else keypoint_figure(image, keypoints)
    row: dict[str, Any] = {
        "image": str(path),
        "points": len(keypoints),
        "median_size": float(np.median(keypoints.size)) if len(keypoints) else 0.0,
        "picture": str(save_figure(figure, f"{out}.png")),
    }
    if regions:
        row["boxes"] = found.boxes.tolist()
    if regions or isinstance(find, Must):
        pairs = contributing_pairs(find, image, keypoints[:EXPLAINED])
        picture = out.with_name(f"{out.name.removesuffix('.keypoints')}.pairs.png")
        row["pairs"] = str(save_figure(pair_figure(image, pairs), picture))
    if Format.NPZ in formats:
        row["arrays"] = f"{out}.npz"
        exchange.write_npz(row["arrays"], keypoints)
    if Format.CSV in formats:
        row["table"] = f"{out}.csv"
        exchange.write_csv(row["table"], keypoints)
    return row, (keypoints, image.shape)


def write_together(
    found: Mapping[Path, "Found"], out: Path, formats: Sequence[Format]
) -> dict[str, str]:
    """Write the points of all images in one file for each format; give their paths."""
    from saccade import exchange

    names = names_below(list(found))
    points = {names[path]: each for path, (each, _) in found.items()}
    shapes = {names[path]: shape for path, (_, shape) in found.items()}
    files = {str(each): str(out / TOGETHER[each]) for each in formats}
    if Format.PARQUET in formats:
        exchange.write_parquet(files["parquet"], points)
    if Format.HDF5 in formats:
        exchange.write_hdf5(files["hdf5"], points, shapes)
    if Format.COLMAP in formats:
        exchange.write_colmap(files["colmap"], points, shapes)
    return files


def names_below(paths: Sequence[Path]) -> dict[Path, str]:
    """Each path from the deepest folder that holds all, as COLMAP and hloc name images."""
    from saccade.files import as_text

    if not paths:
        return {}
    absolute = [path.absolute() for path in paths]
    root = os.path.commonpath([path.parent for path in absolute])
    return {
        path: as_text(each.relative_to(root).as_posix())
        for path, each in zip(paths, absolute, strict=True)
    }
