"""Drives from a folder of images, such as KITTI, or from a video, with a calibration.

    camera.toml              see `calibration`; otherwise calib.txt, or a YAML or XML calibration
                             (see `camera_files`); otherwise the camera is guessed
    calib.txt                one or more (3, 4) projections, a (3, 3) matrix, or fx, fy, cx, cy and
                             optionally a baseline; rows may begin with a name; from KITTI's P0 to
                             P3, the projections of the cameras in use are read
    the images               in the folder or its subfolder images/, rgb/ or color/, sorted by the
                             numbers in their names or by name; or a video, in the folder of the
                             other files
    right/, depth/           optional, with the same names as the images; not with a video
    times.txt                optional: seconds, one line per frame; else `rate` of camera.toml, or
                             the frame rate of the video

Odometry and ground truth are described in `sidecar_files`. A stereo pair has its images in two
subfolders, see `PAIR_NAMES`. Without a calibration the focal length is read from EXIF or else set
to 1.2 times the width; the principal point is the center.

KITTI's layout requires times.txt, and the number in an image's name is its line there; images may
be missing. The camera is mounted as on KITTI's car, or by the optional calib.npz, see
`kitti_extrinsics`.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from saccade.datasets.drives.calibration import (
    CAMERA_FILE,
    Calibration,
    kitti_extrinsics,
    read_calibration,
)
from saccade.datasets.drives.camera_files import (
    CameraFile,
    find_cameras,
)
from saccade.datasets.drives.frames import (
    FrameTimes,
    SourceImage,
    frame_reader,
    image_files,
    image_size,
    list_images,
)
from saccade.datasets.drives.odometry import OdometryIncrements
from saccade.datasets.drives.sidecar_files import assemble_drive
from saccade.datasets.tables import Row, is_number, read_rows, read_table
from saccade.errors import ConfigError, DriveError
from saccade.frames import Camera, Drive
from saccade.io.files import IMAGE_SUFFIXES
from saccade.io.video import VideoFrames
from saccade.types import FloatArray

OTHER_LENSES = "fish|equi|kannala|fov|atan|omni|mei|unified|sphere|scaramuzza|inverse"
"""Pattern for names of lens models in a calib.txt, which has no place for their coefficients."""
Intrinsics: TypeAlias = tuple[float, float, float, float]
"""fx, fy, cx, cy in pixels."""
PAIR_NAMES = (
    *(("image_0", "image_1"), ("image_2", "image_3"), ("image_00", "image_01")),
    *(("image_02", "image_03"), ("image_l", "image_r"), ("image_left", "image_right")),
    *(("img_l", "img_r"), ("images_left", "images_right"), ("left", "right"), ("cam0", "cam1")),
    *(("l", "r"), ("left_images", "right_images"), ("camera_left", "camera_right")),
)
"""Names of the folders of the left and right images."""
IMAGE_FOLDERS = ("images", "rgb", "color", "image")
"""Names of the folder of the images of one camera."""
PROJECTIONS = {"image_0": ("P0", "P1"), "image_2": ("P2", "P3")}
"""Names of KITTI's projections by the folder of the left images."""
FOCAL_FACTOR = 1.2
"""Guessed focal length as a multiple of the image width, for a field of view of 45 degrees."""
GUESSED_RATE = 10.0
"""Guessed frames per second, if the times are unknown."""
FILM_WIDTH = 36.0
"""Width in millimeters to which EXIF's FocalLengthIn35mmFilm refers."""
EXIF_FOLDER = 0x8769
"""Number of EXIF's tag with the tags of the camera."""
FOCAL_LENGTH_35MM = 0xA405
"""Number of EXIF's tag FocalLengthIn35mmFilm."""


class CameraOptions(NamedTuple):
    """Camera parameters given by the user for images without a calibration."""

    intrinsics: Intrinsics | None = None
    baseline: float | None = None
    """Distance between the cameras of a pair in meters."""


def parse_intrinsics(text: str | None) -> Intrinsics | None:
    """The four numbers of `--intrinsics`."""
    if text is None:
        return None
    try:
        fx, fy, cx, cy = (float(value) for value in text.split(","))
    except ValueError as error:
        raise ConfigError(
            f"--intrinsics: expected four numbers fx,fy,cx,cy in pixels, found {text!r}"
        ) from error
    return fx, fy, cx, cy


class BareCamera(NamedTuple):
    """A calibration and its assumptions."""

    calibration: Calibration
    assumptions: tuple[str, ...] = ()
    is_guess: bool = False
    """Whether the focal length is guessed."""


def image_folders(path: Path) -> tuple[Path, Path | None]:
    """Folders of the left and right images; None without right images."""
    for left, right in PAIR_NAMES:
        folder = _with_images(path / left)
        if folder is not None:
            return folder, _with_images(path / right)
    beside = (_with_images(path / name) for name in IMAGE_FOLDERS)
    folder = next((each for each in beside if each is not None), path)
    return folder, _with_images(path / "right")


def has_images(path: Path) -> bool:
    """Whether a folder has images, directly or in a subfolder of a known name."""
    return _with_images(image_folders(path)[0]) is not None


def _with_images(folder: Path) -> Path | None:
    """The folder or its subfolder data/, depending on which has images."""
    for each in (folder, folder / "data"):
        with suppress(OSError):
            if any(file.suffix.lower() in IMAGE_SUFFIXES for file in each.iterdir()):
                return each
    return None


def calibration_beside(
    folder: Path,
    size: tuple[int, int],
    options: CameraOptions | None,
    image: Path | None = None,
    source: Path | None = None,
    *,
    is_pair: bool = False,
) -> BareCamera:
    """Calibration from camera.toml, or from other sources for images of a given width and height.

    Other sources are, in this order, the options, calib.txt, a YAML or XML file, the EXIF tags of
    `image`, and a guess. Assumptions name the `source`, by default the folder. The baseline of
    calib.txt applies to stereo pairs only.
    """
    file, options = folder / CAMERA_FILE, options or CameraOptions()
    if file.exists():
        if options != CameraOptions():
            raise DriveError(f"{file}: has the calibration; leave out --intrinsics and --baseline")
        return BareCamera(read_calibration(file))
    is_guess, assumptions = False, tuple[str, ...]()
    if options.intrinsics is not None:
        camera = _camera(folder, size, options.intrinsics)
    elif (folder / "calib.txt").exists():
        left = "image_0" if image is None else image.parent.name
        camera = read_calib(folder / "calib.txt", size, PROJECTIONS.get(left, ()))
    elif cameras := find_cameras(folder, size) or (image and find_cameras(image.parent, size)):
        camera = choose_camera(cameras, image)
    else:
        focal = None if image is None else exif_focal_length(image, size[0])
        is_guess = focal is None
        origin = "from EXIF" if focal else f"{FOCAL_FACTOR} times the width"
        focal = focal or FOCAL_FACTOR * size[0]
        camera = _camera(folder, size, (focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2))
        assumptions = (
            f"{source or folder}: no {CAMERA_FILE}: guessed a focal length of {focal:.0f} px "
            f"({origin}) and the principal point at the center; --intrinsics fx,fy,cx,cy gives "
            "the true ones",
        )
    baseline = options.baseline or (camera.baseline if is_pair else 0.0)
    try:
        camera = replace(camera, baseline=baseline)
    except ConfigError as error:
        raise DriveError(f"{folder}: the calibration of the camera: {error}") from error
    if not (0 < camera.cx < camera.width and 0 < camera.cy < camera.height):
        raise DriveError(
            f"{folder}: expected a principal point inside the images of {camera.width} x "
            f"{camera.height} px, found {camera.cx:.1f}, {camera.cy:.1f}"
        )
    return BareCamera(Calibration(camera, GUESSED_RATE), assumptions, is_guess)


def _camera(source: Path, size: tuple[int, int], values: Intrinsics, baseline: float = 0) -> Camera:
    try:
        return Camera(*size, *values, baseline=baseline)
    except ConfigError as error:
        raise DriveError(f"{source}: the calibration of the camera: {error}") from error


def choose_camera(cameras: Sequence[CameraFile], image: Path | None) -> Camera:
    """The camera of an image, with the baseline of the pair (0 if unknown).

    The camera's name shares the most words with the image's folder, such as left; otherwise the
    first camera is chosen. Images in a folder such as image_rect are rectified. The baseline of a
    rectified pair is read from the projections.
    """

    def words(name: str) -> set[str]:
        return {*re.findall("[a-z]+|[0-9]+", name.lower())}

    folder = words("" if image is None else f"{image.parent.parent.name} {image.parent.name}")
    left = max(cameras, key=lambda each: len(folder & words(Path(each.name).name)))
    is_rectified = bool(folder & {"rect", "rectified", "undistorted"})
    camera = left.rectified if is_rectified and left.rectified else left.camera
    baseline = 0.0 if camera.is_distorted else max(0.0, *(each.offset for each in cameras))
    if baseline > 0:
        camera = replace(left.rectified or camera, baseline=baseline)
    return camera


def exif_focal_length(image: Path, width: int) -> float | None:
    """Focal length in pixels from the EXIF tags of an image; None if unknown."""
    try:
        from PIL import Image as Pillow  # slow to import

        with Pillow.open(image) as opened:
            tags = opened.getexif().get_ifd(EXIF_FOLDER)
        focal = float(tags.get(FOCAL_LENGTH_35MM, 0) or 0) * width / FILM_WIDTH
    except (OSError, ValueError, TypeError, SyntaxError):
        return None
    return focal if 0.2 * width < focal < 20 * width else None


def read_calib(path: Path, size: tuple[int, int], names: tuple[str, ...] = ()) -> Camera:
    """The camera of a calib.txt, with the baseline of the pair (0 if unknown).

    If some rows have one of the `names`, only these are read. The module describes the formats.
    `size` is the width and height of the images in pixels.
    """
    rows = list(read_rows(path))
    for row in rows:
        if re.search(OTHER_LENSES, row.cells[0].lower()):
            raise row.error(
                "a camera without distortion",
                f"the lens {row.cells[0]!r}; write {CAMERA_FILE}, or undistort the images first",
            )
    if any(row.cells[0].lower().startswith("focal") for row in rows):
        return _focal_and_center(path, size, rows)
    rows = [row for row in rows if row.cells[0].removesuffix(":") in names] or rows
    parts = [row.numbers(slice(0 if is_number(row.cells[0]) else 1, None)) for row in rows]
    is_table = len({len(part) for part in parts}) == 1
    values = [value for part in parts for value in part] if is_table else []
    if len(values) in (4, 5):
        fx, fy, cx, cy = values[:4]
        return _camera(path, size, (fx, fy, cx, cy), sum(values[4:]))
    if len(values) != 9 and (not values or len(values) % 12):
        raise DriveError(
            f"{path}: expected (3, 4) projections, a (3, 3) matrix or fx, fy, cx, cy; found "
            f"{', '.join(str(len(part)) for part in parts)[:80]} numbers"
        )
    matrices = np.reshape(values, (-1, 3, 3 if len(values) == 9 else 4))
    (fx, _, cx), (_, fy, cy) = matrices[0, :2, :3].tolist()
    baseline = 0.0
    if len(matrices) > 1:
        offset = matrices[:2, 0, 3] / matrices[:2, 0, 0].clip(1e-9)
        baseline = max(float(offset[0] - offset[1]), 0.0)
    return _camera(path, size, (fx, fy, cx, cy), baseline)


def _focal_and_center(path: Path, size: tuple[int, int], rows: Sequence[Row]) -> Camera:
    """The camera of rows `focal_length: f`, `pp: cx cy` and optionally `baseline: b`."""
    found: dict[str, list[float]] = {}
    for row in rows:
        name, *words = re.split(r"[\s:=,;()\[\]]+", " ".join(row.cells).strip(" ()[],;"))
        if not all(is_number(word) for word in words):
            raise row.error("a name and numbers, such as focal_length: 718.9", repr(row.cells))
        found[name.lower()[:5]] = [float(word) for word in words]
    focal = found["focal"]
    center = found.get("pp") or found.get("princ") or [(size[0] - 1) / 2, (size[1] - 1) / 2]
    if len(focal) not in (1, 2) or len(center) != 2:
        raise DriveError(f"{path}: expected focal_length: f and pp: cx cy, found {found}")
    values = focal[0], focal[-1], center[0], center[1]
    return _camera(path, size, values, sum(found.get("basel", [])))


ASSUMED_SPEED = 1.0
"""Assumed speed of a single camera without odometry, in units per second."""
ASSUMED_TURN = 0.2
"""Assumed standard deviation of the turn between frames without odometry, in radians."""
_NO_SCALE = "the scale is unknown, since a single camera without odometry measures no lengths: "
HELD_SCALE = _NO_SCALE + "the speed of the first step is set to 1 m/s"
ASSUMED_SCALE = _NO_SCALE + "a constant speed of 1 m/s is assumed"


def read_folder_drive(
    path: Path, options: CameraOptions | None = None, *, is_kitti: bool = False
) -> Drive:
    """A drive from a folder of images."""
    folder, right = image_folders(path)
    images = list_images(folder)
    are_numbered = all(image.stem.isascii() and image.stem.isdecimal() for image in images)
    size = image_size(images[0])
    calibration, assumptions, is_guess = calibration_beside(
        path, size, options, images[0], is_pair=right is not None
    )
    if is_kitti and not (path / CAMERA_FILE).exists():
        mounted = replace(calibration.camera, **kitti_extrinsics(path / "calib.npz"))
        calibration = replace(calibration, camera=mounted)
    if right is not None and calibration.camera.baseline == 0:
        assumptions += (f"{right}: not used, since the baseline is unknown; --baseline gives it",)
        right = None
    left = dict(enumerate(images))
    if is_kitti and are_numbered:
        left = {int(image.stem): image for image in images}
    frames = _frame_times(path, left, calibration.rate, is_required=is_kitti)
    read = frame_reader(
        calibration,
        frames.recorded,
        left=image_files(left.get),
        right=image_files(_same_names(right, left)),
        depth=image_files(_same_names(path / "depth", left)),
    )
    name = path.resolve().name
    drive = assemble_drive(name, path, calibration, frames, read, assumptions=assumptions)
    return drive if (path / "depth").is_dir() else assume_speed(drive, is_guess)


def _same_names(folder: Path | None, images: Mapping[int, Path]) -> Callable[[int], Path | None]:
    """Function from the number of an image to the file with the same name in a folder, or None."""
    others = {path.stem: path for path in list_images(folder)} if folder and folder.is_dir() else {}
    return lambda number: others.get(images[number].stem)


def read_video_drive(path: Path, options: CameraOptions | None = None) -> Drive:
    """A drive from a video."""
    video = VideoFrames(path)
    height, width = video[0].shape[:2]
    calibration, assumptions, is_guess = calibration_beside(
        path.parent, (width, height), options, source=path
    )
    frames = _frame_times(path.parent, dict.fromkeys(range(len(video)), path), video.times)
    if video.declared > len(video):
        remark = (
            f"{path}: {video.declared} frames are announced, {len(video)} can be decoded: "
            "the video is truncated"
        )
        frames = replace(frames, remarks=(*frames.remarks, remark))

    def left(number: int) -> SourceImage:
        return SourceImage(video[number], f"{path}, frame {number}")

    read = frame_reader(calibration, frames.recorded, left)
    drive = assemble_drive(
        path.stem, path.parent, calibration, frames, read, assumptions=assumptions
    )
    return assume_speed(drive, is_guess)


def assume_speed(drive: Drive, is_guess: bool = False) -> Drive:
    """A drive of one camera without odometry, with an assumed speed of one unit per second.

    The speed is assumed for all steps if the focal length is a guess, as the error of a guess makes
    a held scale drift; otherwise for the first step.
    """
    if drive.camera.baseline > 0 or drive.has_odometry or len(drive) < 2:
        return drive
    increments = assumed_increments(np.diff(drive.time))
    return replace(
        drive,
        control=increments.control,
        control_covariance=increments.covariance,
        scale="assumed" if is_guess else "held",
        assumptions=(*drive.assumptions, ASSUMED_SCALE if is_guess else HELD_SCALE),
    )


def assumed_increments(duration: FloatArray) -> OdometryIncrements:
    """Increments over durations (m,) in seconds at the assumed speed, straight ahead."""
    step = ASSUMED_SPEED * duration
    sigma = np.stack([step / 2, step / 2, np.full(len(step), ASSUMED_TURN)], 1)
    control = np.stack([step, 0 * step, 0 * step], 1)
    return OdometryIncrements(control, np.square(sigma)[:, :, None] * np.eye(3))


def _frame_times(
    folder: Path,
    files: Mapping[int, Path],
    clock: float | FloatArray,
    *,
    is_required: bool = False,
) -> FrameTimes:
    """Times of frames by their numbers, from times.txt or by the clock: a rate, or all times."""
    available, path = np.array(sorted(files), np.int64), folder / "times.txt"
    last = int(available[-1])
    recorded = clock if isinstance(clock, np.ndarray) else np.arange(last + 1) / clock
    if is_required or path.exists():
        recorded = read_table(path, ("seconds",))[:, 0]
    if last >= len(recorded):
        raise DriveError(
            f"{files[last]}: expected a frame number below {len(recorded)}, the number of times in "
            f"{path}, found {last}"
        )
    frames = FrameTimes.sort(recorded, str(path), available)
    gaps = np.diff(available) - 1
    if not gaps.any():
        return frames
    missing = f"{int(gaps.sum())} image{' is' if gaps.sum() == 1 else 's are'} missing"
    first = available[np.argmax(gaps > 0)] + 1
    remark = f"{files[last].parent}: {missing}, first number {first}"
    return replace(frames, remarks=(*frames.remarks, remark))
