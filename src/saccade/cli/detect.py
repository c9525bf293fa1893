"""`saccade detect`: keypoints and descriptors."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from saccade.cli.options import (
    MAX_CAMERA_FRAMES,
    Camera,
    CameraFrames,
    Config,
    Detector,
    DetectorOption,
    FigureFormat,
    Json,
    LivePage,
    LiveWindow,
    MaxKeypoints,
    Out,
    Preset,
    Spread,
    images_or_camera,
)

if TYPE_CHECKING:
    from saccade.cli.detect_run import Detections


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
    out: Out = Path("saccade-detect"),
    detector: DetectorOption = Detector.SIFT,
    preset: Preset = None,
    config: Config = None,
    max_keypoints: MaxKeypoints = None,
    spread: Spread = False,
    formats: Annotated[
        list[Format] | None,
        Option(
            "--format",
            "-f",
            help="Output format: of the keypoints, npz by default, and of the figures, png by "
            "default; several with commas.",
        ),
    ] = None,
    camera: Camera = None,
    frames: CameraFrames = MAX_CAMERA_FRAMES,
    live: LiveWindow = False,
    page: LivePage = False,
    as_json: Json = False,
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
    from saccade.cli.detect_run import SHARED_FILES, detect_in, require_libraries, write_shared
    from saccade.cli.detectors import make_detector
    from saccade.cli.output import for_each_image, print_json, print_result, print_table
    from saccade.io.files import results_in
    from saccade.io.image import find_images

    sources = images_or_camera(images, camera)
    chosen = list(dict.fromkeys(formats or []))
    if all(each.value in tuple(FigureFormat) for each in chosen):
        chosen.append(Format.NPZ)
    require_libraries(chosen)
    find = make_detector(detector.value, preset, config, max_keypoints, spread=spread)
    if camera is not None:
        from saccade.cli.live_run import Live, detect_in_camera

        with results_in(out):
            row = detect_in_camera(Live(camera, frames, live, page), out, find)
        print_result(row, as_json, f"camera -> {out}")
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
    if as_json:
        print_json({"images": rows} | ({"files": files} if files else {}))
        raise typer.Exit(code)
    print_table(
        f"keypoints -> {out}",
        ["image", "points", "median size [px]"],
        [[row["image"], str(row["points"]), f"{row['median_size']:.1f}"] for row in rows],
    )
    raise typer.Exit(code)
