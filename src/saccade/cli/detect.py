"""`saccade detect`: keypoints and descriptors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args

import numpy as np
from cyclopts import Parameter

from saccade import exchange
from saccade.cli.images import Images, Row, analyze_each, names_below
from saccade.cli.options import (
    INPUT,
    OUTPUT,
    SEVERAL,
    FigureFormat,
    JsonOptions,
    OutputFolder,
    SettingsOptions,
    figure_formats,
)
from saccade.cli.output import Result, Table, relative_names
from saccade.errors import require, setting
from saccade.exchange.colmap import CameraMode as ColmapMode
from saccade.exchange.colmap import check_cameras
from saccade.exchange.colmap_cameras import Cameras, parse_cameras
from saccade.extras import import_optional
from saccade.io.files import results_in
from saccade.io.image import as_rgb, read_image
from saccade.io.masks import check_masks, read_mask
from saccade.io.preparation import stretch_contrast
from saccade.keypoints.detectors import (
    DEFAULT_DETECTOR,
    DETECTORS,
    Detect,
    keypoints_of,
    make_detector,
    own_function,
    summaries,
)
from saccade.types import BoolArray, Float32Array, Keypoints, Regions

Format = Literal["npz", "csv", "hdf5", "colmap", "png", "svg", "pdf"]
"""File formats of keypoints and of figures."""


@dataclass(frozen=True, kw_only=True)
class DetectorOptions(SettingsOptions):
    """A detector and its settings."""

    detector: Annotated[str, Parameter(metavar="NAME", help=f"{summaries()}.")] = DEFAULT_DETECTOR
    max_keypoints: Annotated[int | None, Parameter("--max", metavar="N")] = setting(None, 1)
    """Keep only the N strongest keypoints, at least 1."""
    stretch: Annotated[bool, INPUT] = False
    """Stretch the contrast of each image to its .5 and 99.5 percentiles, as for thermal images of
    16 bits."""
    masks: Annotated[Path | None, INPUT, Parameter(metavar="DIR")] = None
    """Folder of masks, named as COLMAP's: DIR/NAME.png for the image NAME, black where no keypoint
    is wanted."""

    def read(self, path: Path, name: str) -> tuple[Float32Array, BoolArray | None]:
        """An image as detectors receive it, and the mask of its name."""
        image = read_image(path, keep_alpha=True)
        if self.stretch:
            image = stretch_contrast(image, name=str(path))
        if self.masks is None:
            return image, None
        return image, read_mask(self.masks, name, exchange.read_orientation(path))

    def detector_settings(self) -> Any:
        """Settings of a detector in the table; None for a user's function, which takes none.

        Raises:
            ConfigError: unknown detector, preset or setting; or settings for a function.
        """
        if self.detector not in DETECTORS:
            own_function(self.detector)
            given = self.preset or self.config
            require(given is None, "detector", "no --preset and --config with a function", given)
            return None
        settings = self.settings(self.detector)
        if self.max_keypoints is not None:
            settings = replace(settings, max_keypoints=self.max_keypoints)
        return settings

    def make_detector(self) -> Detect:
        """The detector with its settings; raises as `detector_settings`."""
        settings = self.detector_settings()
        return make_detector(self.detector, settings, max_keypoints=self.max_keypoints)


CameraModel: TypeAlias = Annotated[
    str | None,
    INPUT,
    Parameter(
        metavar="MODEL,...",
        help="Camera of all images, for --format colmap: a model of COLMAP with parameters in "
        "pixels, such as PINHOLE,fx,fy,cx,cy; a model alone, with guessed parameters; or a file "
        "with lines NAME MODEL WIDTH HEIGHT PARAMETER ... By default COLMAP chooses.",
    ),
]
CameraMode: TypeAlias = Annotated[
    ColmapMode | None,
    INPUT,
    Parameter(
        "--camera-mode",
        help="Images that share a camera, for --format colmap: by EXIF data as COLMAP (auto), "
        "those of a folder (folder), all (single) or none (image). By default auto, and single "
        "with the parameters of a --camera of all images.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class DetectOptions(DetectorOptions, JsonOptions):
    """Options of `saccade detect`."""

    out: OutputFolder = Path("saccade-detect")
    formats: Annotated[list[Format] | None, OUTPUT, SEVERAL, Parameter(("--format", "-f"))] = None
    """Output formats for keypoints (npz by default) and figures (png by default), separated by
    commas."""
    camera: CameraModel = None
    camera_mode: CameraMode = None


def detect(*images: Images, options: DetectOptions = DetectOptions()) -> Result:
    """Detect and describe keypoints.

    Writes to --out, for each image, a figure (NAME.keypoints.png) and the
    keypoints as NAME.keypoints.npz or .csv (without descriptors). hdf5 and
    colmap write one file for all images: keypoints.h5 (in the layout of hloc) or
    database.db. For Parquet see saccade extract.

    Exit code 1: some images could not be read; --out has the results of the
    others. Ctrl-C stops after the image in progress.

    Example: saccade detect photos --max 500 --format hdf5
    """
    out = options.out
    chosen = list(dict.fromkeys(options.formats or []))
    if all(each in get_args(FigureFormat) for each in chosen):
        chosen.append("npz")
    cameras = parse_cameras(options.camera)
    require(cameras is None or "colmap" in chosen, "camera", "--format colmap", chosen)
    require_libraries(chosen, cameras)
    check_masks(options.masks)
    find = options.make_detector()
    image_names = {} if options.masks is None else names_below(images, out)
    shared = [each for each in chosen if each in SHARED_FILES]
    detections: dict[Path, Detections] = {}

    def of_image(path: Path, name: str) -> Row:
        image, mask = options.read(path, image_names.get(path, path.name))
        row = {"image": str(path)}
        found, keypoints = detect_in(image, mask, out / f"{name}.keypoints", find, chosen)
        row |= found
        if shared:
            detections[path] = keypoints
        return row

    with results_in(out):
        rows, code = analyze_each(images, out, of_image)
        files = write_shared(detections, out, shared, cameras, options.camera_mode)
    cells = [[row["image"], str(row["points"]), f"{row['median_size']:.1f}"] for row in rows]
    table = Table(f"keypoints -> {out}", ["image", "points", "median size [px]"], cells)
    return Result({"images": rows} | ({"files": files} if files else {}), [table], code)


Detections: TypeAlias = tuple[Keypoints, tuple[int, ...]]
"""Keypoints of an image, and its shape."""

SHARED_FILES = {
    "hdf5": "keypoints.h5",
    "colmap": "database.db",
}
"""Formats with one file for all images, and the names of these files."""


def require_libraries(formats: Sequence[str], cameras: Cameras) -> None:
    """Import the libraries of the formats and check the cameras before the run starts."""
    if "colmap" in formats:
        check_cameras(cameras)
    if "hdf5" in formats:
        import_optional("h5py", "hdf5")


def detect_in(
    image: Float32Array, mask: BoolArray | None, out: Path, detector: Detect, formats: Sequence[str]
) -> tuple[dict[str, Any], Detections]:
    """Detect in one image: write the figure `out`.png and the files, return the row for --json."""
    detections: Any = detector(image, mask)
    image = as_rgb(image)
    regions, keypoints = isinstance(detections, Regions), keypoints_of(detections)
    from saccade.viewing import keypoint_figure, region_figure, save_figures

    figure = region_figure(image, detections) if regions else keypoint_figure(image, keypoints)
    row: dict[str, Any] = {
        "points": len(keypoints),
        "median_size": float(np.median(keypoints.size)) if len(keypoints) else 0.0,
        "picture": str(save_figures(figure, out, figure_formats(formats))),
    }
    if regions:
        row["boxes"] = detections.boxes.tolist()
    if "npz" in formats:
        row["arrays"] = f"{out}.npz"
        exchange.write_npz(row["arrays"], keypoints)
    if "csv" in formats:
        row["table"] = f"{out}.csv"
        exchange.write_csv(row["table"], keypoints)
    return row, (keypoints, image.shape)


def write_shared(
    detections: Mapping[Path, Detections],
    out: Path,
    formats: Sequence[str],
    cameras: Cameras,
    camera_mode: ColmapMode | None = None,
) -> dict[str, str]:
    """Write the keypoints of all images to one file per format; return the paths."""
    names = relative_names(list(detections))
    keypoints = {names[path]: each for path, (each, _) in detections.items()}
    shapes = {names[path]: shape for path, (_, shape) in detections.items()}
    files = {each: str(out / SHARED_FILES[each]) for each in formats}
    turned = {names[path]: exchange.read_orientation(path) for path in detections}
    if "hdf5" in formats:
        exchange.write_hdf5(files["hdf5"], keypoints, shapes, turned)
    if "colmap" in formats:
        exchange.write_colmap(
            *(files["colmap"], keypoints, shapes, None, None, turned, cameras),
            camera_mode=camera_mode,
            files={names[path]: path for path in detections},
        )
    return files
