"""`saccade detect`: keypoints and descriptors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, log2
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args

import cv2
import numpy as np
from cyclopts import Parameter

from saccade import exchange
from saccade.attention import SymmetryConfig, symmetric_pairs
from saccade.cli.films import Frames, Row, analyze_each, make_film
from saccade.cli.options import (
    OUTPUT,
    SEVERAL,
    FigureFormat,
    JsonOptions,
    OutputFolder,
    SettingsOptions,
    SourceOptions,
    figure_formats,
)
from saccade.cli.output import Result, Table, relative_names
from saccade.datasets import write_table
from saccade.errors import require, setting
from saccade.exchange.colmap import import_pycolmap
from saccade.extras import import_optional
from saccade.io.files import results_in
from saccade.io.image import read_image
from saccade.keypoints import Must, MustConfig, Sift, SymRoid, SymRoidConfig
from saccade.types import Float32Array, FloatArray, Image, Keypoints, Regions, SymmetricPairs
from saccade.viewing import keypoint_figure, pair_figure, region_figure, save_figures
from saccade.viewing.style import ORANGE, rgb_levels

DETECTORS: dict[str, Any] = {"sift": Sift, "must": Must, "symroid": SymRoid}
Format = Literal["npz", "csv", "parquet", "hdf5", "colmap", "png", "svg", "pdf"]
"""File formats of keypoints and of figures."""


@dataclass(frozen=True, kw_only=True)
class DetectorOptions(SettingsOptions):
    """A detector and its settings."""

    detector: Literal["sift", "must", "symroid"] = "sift"
    """SIFT, points of symmetry (must), or regions of symmetry (symroid)."""
    max_keypoints: Annotated[int | None, Parameter("--max", metavar="N")] = setting(None, 1)
    """Keep only the N strongest keypoints, at least 1."""
    spread: bool = False
    """With --max: keep keypoints spread over the image."""

    def detector_of_settings(self) -> Any:
        """A `Sift`, `Must` or `SymRoid`.

        Raises:
            ConfigError: a setting that the detector does not have.
        """
        settings = self.settings(self.detector)
        if self.max_keypoints is not None:
            settings = replace(settings, max_keypoints=self.max_keypoints)
        if self.spread:
            points = self.detector != "symroid"
            require(points, "spread", "a detector of points", self.detector)
            settings = replace(settings, spread=True)
        return DETECTORS[self.detector](settings)


def keypoints_of(detections: Keypoints | Regions) -> Keypoints:
    """The keypoints themselves, or those of regions."""
    return detections.keypoints if isinstance(detections, Regions) else detections


@dataclass(frozen=True, kw_only=True)
class DetectOptions(DetectorOptions, JsonOptions, SourceOptions):
    """Options of `saccade detect`."""

    out: OutputFolder = Path("saccade-detect")
    formats: Annotated[list[Format] | None, OUTPUT, SEVERAL, Parameter(("--format", "-f"))] = None
    """Output format: of the keypoints, npz by default, and of the figures, png by default; several
    with commas."""


def detect(options: DetectOptions = DetectOptions()) -> Result:
    """Detect and describe keypoints.

    For each image --out receives a figure (NAME.keypoints.png), for points and
    regions of symmetry another with the edge pairs that contribute to them
    (NAME.pairs.png), and the keypoints as NAME.keypoints.npz or .csv (without
    descriptors). Keypoints of all images go to keypoints.parquet, keypoints.h5
    (in the layout of hloc) or database.db (for COLMAP). Of a video or a
    --camera --out receives a film (NAME.keypoints.mp4) and a table; Ctrl-C ends
    a camera.

    Exit code 1: some images could not be read; the results of the others are
    in --out. Ctrl-C stops after the image in progress.

    Example: saccade detect photos --max 500 --spread --format hdf5
    """
    out = options.out
    chosen = list(dict.fromkeys(options.formats or []))
    if all(each in get_args(FigureFormat) for each in chosen):
        chosen.append("npz")
    require_libraries(chosen)
    find = options.detector_of_settings()
    shared = [each for each in chosen if each in SHARED_FILES]
    detections: dict[Path, Detections] = {}

    def of_image(path: Path, name: str) -> Row:
        row, keypoints = detect_in(path, out / f"{name}.keypoints", find, chosen)
        if shared:
            detections[path] = keypoints
        return row

    def of_frames(frames: Frames, name: str) -> Row:
        return detect_in_frames(frames, out / f"{name}.keypoints", find)

    with results_in(out):
        rows, code = analyze_each(options, out, of_image, of_frames)
        files = write_shared(detections, out, shared)
    cells = [[row["image"], str(row["points"]), f"{row['median_size']:.1f}"] for row in rows]
    table = Table(f"keypoints -> {out}", ["image", "points", "median size [px]"], cells)
    return Result({"images": rows} | ({"files": files} if files else {}), [table], code)


Detections: TypeAlias = tuple[Keypoints, tuple[int, ...]]
"""The keypoints of an image, and its shape."""

MAX_EXPLAINED = 20
"""Number of the strongest points whose symmetric pairs are drawn."""
SHARED_FILES = {
    "parquet": "keypoints.parquet",
    "hdf5": "keypoints.h5",
    "colmap": "database.db",
}
"""Formats that hold the keypoints of all images, and the names of the files."""


def require_libraries(formats: Sequence[str]) -> None:
    """Import the libraries of the formats, to fail before any work is done."""
    if "colmap" in formats:
        import_pycolmap()
    if "hdf5" in formats:
        import_optional("h5py", "hdf5")
    if "parquet" in formats:
        import_optional("pyarrow", "parquet")


def detect_in(
    path: Path, out: Path, detector: Any, formats: Sequence[str]
) -> tuple[dict[str, Any], Detections]:
    """Detect in one image: write the figure `out`.png and its files, return the row for --json."""
    image = read_image(path)
    detections = detector(image)
    regions, keypoints = isinstance(detections, Regions), keypoints_of(detections)
    figure = region_figure(image, detections) if regions else keypoint_figure(image, keypoints)
    drawn = figure_formats(formats)
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
    if "npz" in formats:
        row["arrays"] = f"{out}.npz"
        exchange.write_npz(row["arrays"], keypoints)
    if "csv" in formats:
        row["table"] = f"{out}.csv"
        exchange.write_csv(row["table"], keypoints)
    return row, (keypoints, image.shape)


COLOR, RICH = rgb_levels(ORANGE), cv2.DRAW_MATCHES_FLAGS_DRAW_RICH_KEYPOINTS
"""Color and style of keypoints in a film: with their sizes and angles."""


def detect_in_frames(frames: Frames, out: Path, detector: Any) -> dict[str, Any]:
    """Write the keypoints of each frame as a film and a table; returns the row for --json."""
    rows = list[FloatArray]()

    def analyze(time: float, image: Image) -> tuple[Image, dict[str, Any]]:
        found = keypoints_of(detector(image))
        columns = (found.xy, found.size, found.angle, found.response)
        count = np.full(len(found), len(rows)), np.full(len(found), time)
        rows.append(np.column_stack([*count, *columns]))
        drawn = cv2.drawKeypoints(image, exchange.to_opencv(found)[0], image.copy(), COLOR, RICH)
        return drawn, {"points": np.column_stack([found.xy, found.size / 2])}

    film, table = Path(f"{out}.mp4"), Path(f"{out}.csv")
    count = make_film(frames, film, analyze)
    names = ("frame", "time", "x", "y", "size", "angle", "response")
    values = np.concatenate(rows).astype(np.float64)
    write_table(table, dict(zip(names, values.T, strict=True)))
    return {
        "image": frames.source,
        "frames": count,
        "points": len(values),
        "median_size": float(np.median(values[:, 4])) if len(values) else 0.0,
        "film": str(film),
        "table": str(table),
    }


def write_shared(
    detections: Mapping[Path, Detections], out: Path, formats: Sequence[str]
) -> dict[str, str]:
    """Write the keypoints of all images in one file for each format; return the paths."""
    names = relative_names(list(detections))
    keypoints = {names[path]: each for path, (each, _) in detections.items()}
    shapes = {names[path]: shape for path, (_, shape) in detections.items()}
    files = {each: str(out / SHARED_FILES[each]) for each in formats}
    if "parquet" in formats:
        exchange.write_parquet(files["parquet"], keypoints)
    if "hdf5" in formats or "colmap" in formats:
        turned = {names[path]: exchange.read_orientation(path) for path in detections}
    if "hdf5" in formats:
        exchange.write_hdf5(files["hdf5"], keypoints, shapes, turned)
    if "colmap" in formats:
        exchange.write_colmap(files["colmap"], keypoints, shapes, orientations=turned)
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
    must = config.must() if isinstance(config, SymRoidConfig) else config
    pairs = []
    for (x, y), size in zip(keypoints.xy.tolist(), keypoints.size.tolist(), strict=True):
        settings = must_symmetry(must, size)
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
