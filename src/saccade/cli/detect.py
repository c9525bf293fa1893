"""`saccade detect`: keypoints and descriptors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import ceil, log2
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from typer import Argument, Option

from saccade import exchange
from saccade.attention import SymmetryConfig, symmetric_pairs
from saccade.cli import options
from saccade.cli.output import Table, emit, emit_facts, for_each_image, relative_names
from saccade.errors import require
from saccade.exchange.colmap import import_pycolmap
from saccade.extras import import_optional
from saccade.io.files import results_in
from saccade.io.image import find_images, read_image
from saccade.keypoints import Must, MustConfig, Sift, SymRoid, SymRoidConfig
from saccade.settings import load_settings
from saccade.types import Float32Array, Keypoints, Regions, SymmetricPairs
from saccade.viewing import keypoint_figure, pair_figure, region_figure, save_figures


class Detector(StrEnum):
    """Keypoint detectors."""

    SIFT = "sift"
    MUST = "must"
    SYMROID = "symroid"


@dataclass(frozen=True)
class DetectorOptions:
    """A detector and its settings."""

    detector: Annotated[
        Detector,
        Option(
            "--detector", help="SIFT, points of symmetry (must), or regions of symmetry (symroid)."
        ),
    ] = Detector.SIFT
    preset: options.Preset = None
    config: options.Config = None
    max_keypoints: Annotated[
        int | None,
        Option("--max", min=1, metavar="N", help="Keep only the N strongest keypoints."),
    ] = None
    spread: Annotated[
        bool, Option("--spread", help="With --max: keep keypoints spread over the image.")
    ] = False

    def make(self) -> Any:
        """A `Sift`, `Must` or `SymRoid`.

        Raises:
            ConfigError: a setting that the detector does not have.
        """
        settings = load_settings(self.detector, self.preset, self.config)
        if self.max_keypoints is not None:
            settings = replace(settings, max_keypoints=self.max_keypoints)
        if self.spread:
            points = self.detector is not Detector.SYMROID
            require(points, "spread", "a detector of points", self.detector.value)
            settings = replace(settings, spread=True)
        return {"sift": Sift, "must": Must, "symroid": SymRoid}[self.detector](settings)


class Format(StrEnum):
    """File formats of keypoints and of figures."""

    NPZ = "npz"
    CSV = "csv"
    PARQUET = "parquet"
    HDF5 = "hdf5"
    COLMAP = "colmap"
    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


def detect(
    images: Annotated[
        list[str] | None,
        Argument(metavar="IMAGE", help="Images, folders of images, or quoted patterns."),
    ] = None,
    *,
    detector: DetectorOptions,
    camera: options.CameraOptions,
    out: options.Out = Path("saccade-detect"),
    formats: Annotated[
        list[Format] | None,
        Option(
            "--format",
            "-f",
            help="Output format: of the keypoints, npz by default, and of the figures, png by "
            "default; several with commas.",
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Detect and describe keypoints.

    For each image --out receives a figure (NAME.keypoints.png), for points and
    regions of symmetry another with the edge pairs that contribute to them
    (NAME.pairs.png), and the keypoints as NAME.keypoints.npz or .csv (without
    descriptors). Keypoints of all images go to keypoints.parquet, keypoints.h5
    (in the layout of hloc) or database.db (for COLMAP). Of a --camera --out
    receives a film (camera.keypoints.mp4) and a table; Ctrl-C ends it.

    Exit code 1: some images could not be read; the results of the others are
    in --out. Ctrl-C stops after the image in progress.
    """
    sources = camera.instead_of(images)
    chosen = list(dict.fromkeys(formats or []))
    if all(each.value in tuple(options.FigureFormat) for each in chosen):
        chosen.append(Format.NPZ)
    require_libraries(chosen)
    find = detector.make()
    if camera.camera is not None:
        from saccade.cli.live_run import detect_in_camera

        with results_in(out):
            row = detect_in_camera(camera, out, find)
        emit_facts(row, as_json, f"camera -> {out}")
        return
    paths = [path for source in sources for path in find_images(source)]
    shared = [each for each in chosen if each in SHARED_FILES]
    detections: dict[Path, Detections] = {}

    def process(path: Path, name: str) -> dict[str, Any]:
        row, keypoints = detect_in(path, out / f"{name}.keypoints", find, chosen)
        if shared:
            detections[path] = keypoints
        return row

    with results_in(out):
        rows, code = for_each_image(paths, out, process)
        files = write_shared(detections, out, shared)
    cells = [[row["image"], str(row["points"]), f"{row['median_size']:.1f}"] for row in rows]
    table = Table(f"keypoints -> {out}", ["image", "points", "median size [px]"], cells)
    emit({"images": rows} | ({"files": files} if files else {}), as_json, table)
    raise typer.Exit(code)


Detections: TypeAlias = tuple[Keypoints, tuple[int, ...]]
"""The keypoints of an image, and its shape."""

MAX_EXPLAINED = 20
"""Number of the strongest points whose symmetric pairs are drawn."""
SHARED_FILES = {
    Format.PARQUET: "keypoints.parquet",
    Format.HDF5: "keypoints.h5",
    Format.COLMAP: "database.db",
}
"""Formats that hold the keypoints of all images, and the names of the files."""


def require_libraries(formats: Sequence[Format]) -> None:
    """Import the libraries of the formats, to fail before any work is done."""
    if Format.COLMAP in formats:
        import_pycolmap()
    if Format.HDF5 in formats:
        import_optional("h5py", Format.HDF5)
    if Format.PARQUET in formats:
        import_optional("pyarrow", Format.PARQUET)


def detect_in(
    path: Path, out: Path, detector: Any, formats: Sequence[Format]
) -> tuple[dict[str, Any], Detections]:
    """Detect in one image: write the figure `out`.png and its files, return the row for --json."""
    image = read_image(path)
    detections = detector(image)
    regions = isinstance(detections, Regions)
    keypoints = detections.keypoints if regions else detections
    figure = region_figure(image, detections) if regions else keypoint_figure(image, keypoints)
    drawn = options.figure_formats(formats)
    row: dict[str, Any] = {
        "image": str(path),
        "points": len(keypoints),
        "median_size": float(np.median(keypoints.size)) if len(keypoints) else 0.0,
        "picture": str(save_figures(figure, out, drawn)),
    }
    if regions:
        row["boxes"] = detections.boxes.tolist()
    if regions or isinstance(detector, Must):
        pairs = contributing_pairs(detector, image, keypoints[:MAX_EXPLAINED])
        picture = out.with_name(f"{out.name.removesuffix('.keypoints')}.pairs")
        row["pairs"] = str(save_figures(pair_figure(image, pairs), picture, drawn))
    if Format.NPZ in formats:
        row["arrays"] = f"{out}.npz"
        exchange.write_npz(row["arrays"], keypoints)
    if Format.CSV in formats:
        row["table"] = f"{out}.csv"
        exchange.write_csv(row["table"], keypoints)
    return row, (keypoints, image.shape)


def write_shared(
    detections: Mapping[Path, Detections], out: Path, formats: Sequence[Format]
) -> dict[str, str]:
    """Write the keypoints of all images in one file for each format; return the paths."""
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


MAX_PAIRS = 4
"""Pairs drawn for each point, the strongest."""
MAX_OFFSET = 2.0
"""Pixels from a point to the cell of the pyramid whose pairs are drawn."""
LEVEL_SIGMA = 1.5
"""Approximate blur of a pyramid level, in its own pixels."""


def contributing_pairs(
    detector: Any, image: Float32Array, keypoints: Keypoints
) -> list[SymmetricPairs]:
    """The pairs about each point, weighted as by its detector.

    The pyramid has fewer scales than MUST: its points use the nearest level.

    Args:
        detector: a `Must` or a `SymRoid`.
        image: (H, W, 3) in [0, 1].
        keypoints: its detections.
    """
    config = detector.config
    if isinstance(config, SymRoidConfig) and config.frame == "scale-space":
        config = config.must()
    symmetry = must_symmetry if isinstance(config, MustConfig) else symroid_symmetry
    pairs = []
    for (x, y), size in zip(keypoints.xy.tolist(), keypoints.size.tolist(), strict=True):
        settings = symmetry(config, size)
        near = symmetric_pairs(
            image, (x, y), settings, radius=min(MAX_OFFSET, size / 4), max_pairs=MAX_PAIRS
        )
        pairs.append(near[:MAX_PAIRS])
    return pairs


def must_symmetry(config: MustConfig, size: float) -> SymmetryConfig:
    """The symmetry that MUST measures for a point of `size` pixels."""
    level = max(0, round(log2(size / 2 / LEVEL_SIGMA)))
    sigma = size / 2 / 2**level
    return SymmetryConfig(
        kind="isotropic",
        channels="gray",
        levels=(level,),
        level_weights=(1.0,),
        outer=max(1, ceil(config.radius * sigma)),
        sigma=max(0.1, 2 * config.falloff * sigma),
        map_level=level,
        viewing_size=None,
    )


def symroid_symmetry(config: SymRoidConfig, _: float) -> SymmetryConfig:
    """The symmetry of SymRoID's map, of any size."""
    return SymmetryConfig(
        kind="isotropic",
        channels="gray",
        levels=config.levels,
        level_weights=(1.0,) * len(config.levels),
        inner=config.inner,
        outer=config.outer,
        sigma=config.sigma,
        gain=config.gain,
        map_level=config.levels[0],
        viewing_size=None,
    )
