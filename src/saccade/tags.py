"""Tags in images (AprilTag, ArUco) as labels, corners, and ranges and bearings of their centers.

OpenCV finds and decodes the tags. Their corners are refined here: a line is fitted to the edge
between black and white on each side, and adjacent lines are intersected. The center follows from
the corners by the perspective of a square of known size. At weak perspective two tilts of a square
look alike; both have the same center, so the ambiguity affects neither range nor bearing.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from saccade.errors import (
    ConfigError,
    DriveError,
    ImageError,
    LogError,
    Settings,
    require,
    setting,
)
from saccade.frames import Camera, Drive, Frame
from saccade.io.image import as_gray
from saccade.landmark_names import number_names
from saccade.plane import path_of, steps_between, to_range_bearing
from saccade.types import FloatArray, Image, IntArray, LandmarkLog, Trajectory

FAMILIES = {
    **{f"tag{name}": f"APRILTAG_{name}" for name in ("16h5", "25h9", "36h10", "36h11")},
    **{
        f"{n}x{n}_{count}": f"{n}X{n}_{count}"
        for n in (4, 5, 6, 7)
        for count in (50, 100, 250, 1000)
    },
    "aruco_original": "ARUCO_ORIGINAL",
    "aruco_mip_36h12": "ARUCO_MIP_36h12",
}
"""Families of tags, and the names of their dictionaries in `cv2.aruco`, without DICT_."""
LARGEST_SIZE = 3.0
"""Largest plausible side of a tag in meters; a larger number is probably in millimeters."""
SHARED_SIGMA = 0.025
"""Standard deviation in pixels of a corner of a large, sharp tag."""
BLUR_FACTOR = 1.0
"""Standard deviation in pixels of a corner of a tag whose cells are as wide as its blur."""
POINTS = 16
"""Number of positions along a side at which its edge is located."""
ENDS = 0.12
"""Fraction of a side next to each corner that is not used."""
PROFILE = 25
"""Number of samples across an edge."""
HALF_WIDTH = (1.0, 3.0)
"""Minimum and maximum of half the length of the profile across an edge, in pixels."""
MIN_STEP = 12.0
"""Minimum increase of the gray level across an edge."""
MAX_CORRECTION = 3.0
"""Maximum distance between a corner as detected and as refined, in pixels."""
MAX_SAMPLES = 20
"""Maximum number of frames searched for tags of other families."""
OTHER_FAMILIES = (
    "tag36h11",
    "tag25h9",
    "tag36h10",
    "aruco_mip_36h12",
    *(f"{n}x{n}_250" for n in (5, 6, 7)),
)
"""Families searched where there is no tag; smaller ones are found where there are none."""
MIN_SIGHTINGS = 3
"""Minimum number of tags of another family for a hint."""
TILT_SIGMA = 1.0
"""Standard deviation of the orientation of a tag before it is observed, in radians."""
STEPS = 3
"""Number of Gauss-Newton steps from the closed-form pose of a tag."""
NEAREST = 1e-3
"""Minimum distance of a tag from the robot's origin in meters."""
SIDE = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])
"""(4, 3) corners of a tag of unit size, in the order of OpenCV."""


@dataclass(frozen=True)
class TagConfig(Settings):
    """Tags to detect, and the errors of their positions.

    Raises:
        ConfigError: unknown family, or a setting out of range.
    """

    family: str = "tag36h11"
    """Family of the tags: one of `FAMILIES`."""
    size: Any = None
    """Side of the black square in meters: a number, or a table by id, whose tags alone are then
    located; None if unknown, for corners alone."""
    size_sigma: float = setting(0.01, 0, 0.5)
    """Relative standard deviation of the size."""
    focal_sigma: float = setting(0.005, 0, 0.5)
    """Relative standard deviation of the focal length."""
    tilt_sigma_deg: float = setting(0.5, 0, 45)
    """Standard deviation of the camera's pitch and roll in degrees; displaces tags above and below
    the camera."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "family", family_name(self.family))
        if isinstance(self.size, Mapping):
            sizes = {_tag_id(key, self.family): _length(value) for key, value in self.size.items()}
            object.__setattr__(self, "size", sizes)
        elif self.size is not None:
            object.__setattr__(self, "size", _length(self.size))

    def size_of(self, tag: int) -> float | None:
        """Side of a tag in meters; None if unknown."""
        size: float | None = self.size.get(tag) if isinstance(self.size, dict) else self.size
        return size


def family_name(name: str) -> str:
    """Name of a family in `FAMILIES`, from any usual spelling."""
    plain = re.sub("apriltag_?", "tag", name.lower().removeprefix("dict_"))
    plain = f"tag{plain}" if f"tag{plain}" in FAMILIES else plain
    require(plain in FAMILIES, "family", f"one of {', '.join(FAMILIES)}", name)
    return plain


def _length(value: Any) -> float:
    """A side in meters."""
    known = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    require(known and value > 0, "size", "the side of the black square in meters, above 0", value)
    hint = f"in meters, at most {LARGEST_SIZE:g}; {value:g} mm are {value / 1000:g}"
    require(value <= LARGEST_SIZE, "size", hint, value)
    return float(value)


def _tag_id(key: Any, family: str) -> int:
    """Id of a tag from an id or a label."""
    text = str(key).removeprefix(f"{family}:")
    require(text.isascii() and text.isdecimal(), "size", "a table by ids of tags", key)
    return int(text)


def parse_sizes(text: str) -> float | dict[int, float]:
    """Sizes of tags from text: a number, or a list such as `0-13=0.165,20=0.3`.

    Raises:
        ConfigError: anything else.
    """
    sizes = dict[int, float]()
    try:
        if "=" not in text:
            return float(text)
        for part in text.split(","):
            ids, _, size = part.partition("=")
            sizes |= dict.fromkeys(parse_ids(ids), float(size))
    except ValueError as error:
        expected = "a number in meters, or IDS=METERS with commas, such as 0-13=0.165,20=0.3"
        raise ConfigError(f"--tag-size: expected {expected}, found {text!r}") from error
    return sizes


def parse_ids(text: str) -> list[int]:
    """Ids of tags from text such as `0-13` or `3,5,8-10`.

    Raises:
        ConfigError: anything else.
    """
    found = list[int]()
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        known = all(each.isascii() and each.isdecimal() for each in (first, last or first))
        require(known and len(part) < 20, "ids", "ids such as 0-13 or 3,5,8-10", text)
        low, high = int(first), int(last or first)
        require(low <= high < 10_000, "ids", "ascending ids below 10000", part)
        found += range(low, high + 1)
    return list(dict.fromkeys(found))


@dataclass(frozen=True, eq=False, repr=False)
class TagSightings:
    """The k tags in an image."""

    id: IntArray
    """(k,) ids in the family."""
    family: str
    """Name of the family."""
    corners: FloatArray
    """(k, 4, 2) corners of the black square in image pixels, in the order of OpenCV: clockwise."""
    corner_sigma: FloatArray
    """(k,) standard deviations of the corners in pixels."""
    z: FloatArray | None = None
    """(k, 2) range over the ground in meters and bearing in radians, to the left of ahead, from
    the robot's origin to the center; None without a camera or a size."""
    R: FloatArray | None = None
    """(k, 2, 2) covariances of `z`."""
    height: FloatArray | None = None
    """(k,) heights of the centers above the robot's origin, in meters."""

    @property
    def labels(self) -> list[str]:
        """(k,) labels `FAMILY:ID`."""
        return [f"{self.family}:{each}" for each in self.id.tolist()]

    @property
    def xy(self) -> FloatArray:
        """(k, 2) centers in image pixels: the intersections of the diagonals."""
        a, b, c, d = (self.corners[:, i] for i in range(4))
        along = _cross(b - a, d - b) / _cross(c - a, d - b)
        return np.asarray(a + along[:, None] * (c - a))

    def __len__(self) -> int:
        return len(self.id)

    def __repr__(self) -> str:
        return f"TagSightings({', '.join(self.labels) or 'no tags'})"


class Tags:
    """Detects the tags of a family: `Tags(config)(image, camera)`.

    Args:
        config: family, size and errors.

    Source: Garrido-Jurado et al. (2014) for detection; Collins & Bartoli (2014) for the pose of a
    square.
    """

    def __init__(self, config: TagConfig = TagConfig()) -> None:
        import cv2  # slow to import

        self.config = config
        kind = getattr(cv2.aruco, f"DICT_{FAMILIES[config.family]}")
        self._detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(kind))
        self._cells = cv2.aruco.getPredefinedDictionary(kind).markerSize + 2

    def __repr__(self) -> str:
        return f"Tags({self.config})"

    def __call__(self, image: Image, camera: Camera | None = None) -> TagSightings:
        """The tags in an image.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].
            camera: calibration and mounting of the camera that took the image; None for corners
                alone.

        Returns:
            The tags in ascending order of their ids. With a camera and a size, tags of unknown
            size are left out.

        Raises:
            ImageError: not an image, or of another size than the camera's.
        """
        gray = gray_bytes(image)
        if camera is not None and gray.shape != (camera.height, camera.width):
            raise ImageError(
                f"image: expected {camera.width} x {camera.height} px as in the calibration, "
                f"found {gray.shape[1]} x {gray.shape[0]}"
            )
        found, ids, _ = self._detector.detectMarkers(gray)
        if ids is None or len(found) == 0:
            none = np.zeros((0, 4, 2))
            seen = TagSightings(np.zeros(0, np.int64), self.config.family, none, np.zeros(0))
        else:
            corners = np.array(found, np.float64).reshape(-1, 4, 2)
            order = np.argsort(np.asarray(ids).ravel(), kind="stable")
            corners, sigma = refined_corners(gray, corners[order], self._cells)
            id_ = np.asarray(ids, np.int64).ravel()[order]
            seen = TagSightings(id_, self.config.family, corners, sigma)
        return seen if camera is None or self.config.size is None else self._located(seen, camera)

    def _located(self, seen: TagSightings, camera: Camera) -> TagSightings:
        """The tags of known size, with ranges and bearings."""
        sizes = [self.config.size_of(each) for each in seen.id.tolist()]
        rows, points, covariances = [], [], []
        corners = camera.undistort(seen.corners.reshape(-1, 2)).reshape(-1, 4, 2)
        for row, size in enumerate(sizes):
            if size is None or not np.isfinite(corners[row]).all():
                continue
            located = locate_center(corners[row], float(seen.corner_sigma[row]), size, camera)
            if located is not None:
                rows.append(row)
                points.append(located[0])
                covariances.append(located[1])
        index = np.array(rows, np.int64)
        center, C = np.reshape(points, (-1, 3)), np.reshape(covariances, (-1, 3, 3))
        z, R, height, ahead = self._in_plane(center, C, camera)
        kept = index[ahead]
        return TagSightings(
            seen.id[kept],
            seen.family,
            seen.corners[kept],
            seen.corner_sigma[kept],
            z[ahead],
            R[ahead],
            height[ahead],
        )

    def _in_plane(
        self, center: FloatArray, C: FloatArray, camera: Camera
    ) -> tuple[FloatArray, FloatArray, FloatArray, Any]:
        """Ranges and bearings (k, 2), covariances (k, 2, 2) and heights (k,) of centers (k, 3).

        Centers and their covariances by the corners are in the camera's frame. Also (k,) whether a
        center is away from the robot's origin.
        """
        config = self.config
        along_axis = center * (0.0, 0.0, 1.0)
        C = C + config.size_sigma**2 * center[:, :, None] * center[:, None]
        C = C + config.focal_sigma**2 * along_axis[:, :, None] * along_axis[:, None]
        Rc = camera.rotation[:2]
        xy = camera.position[:2] + center @ Rc.T
        above = center @ camera.rotation[2]
        tilt = np.square(np.radians(config.tilt_sigma_deg) * above)
        covariance = Rc @ C @ Rc.T + tilt[:, None, None] * np.eye(2)
        away = np.hypot(xy[:, 0], xy[:, 1]) > NEAREST
        xy = np.where(away[:, None], xy, (1.0, 0.0))
        z, R = to_range_bearing(xy, covariance, str)
        return z, R, above + camera.position[2], away


def gray_bytes(image: Image) -> Any:
    """(H, W) gray levels of an image as bytes."""
    if image.ndim == 2 and image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    return np.rint(as_gray(image) * 255).astype(np.uint8)


def locate_center(
    corners: FloatArray, sigma: float, size: float, camera: Camera
) -> tuple[FloatArray, FloatArray] | None:
    """Center (3,) of a tag in meters in the camera's frame, and its covariance (3, 3).

    None for corners that are no view of a square.

    Args:
        corners: (4, 2) in pixels without distortion.
        sigma: standard deviation of each coordinate in pixels.
        size: side in meters.
        camera: calibration.
    """
    import cv2  # slow to import

    square, K = SIDE * size, camera.matrix
    done, r, t, *_ = cv2.solvePnPGeneric(
        square, corners[:, None], K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not done or not float(t[0][2, 0]) > 0:
        return None
    pose = np.concatenate([r[0].ravel(), t[0].ravel()])
    prior = np.diag([TILT_SIGMA**-2] * 3 + [0.0] * 3) * sigma**2
    for _ in range(STEPS):
        projected, jacobian = cv2.projectPoints(square, pose[:3], pose[3:], K, None)
        J = np.asarray(jacobian)[:, :6]
        A = J.T @ J + prior
        pose = pose + np.linalg.solve(A, J.T @ (corners - projected[:, 0]).ravel())
    if not np.isfinite(pose).all() or pose[5] <= 0:
        return None
    covariance = sigma**2 * np.linalg.inv(A)[3:, 3:]
    return pose[3:], np.asarray(covariance, np.float64)


def refined_corners(gray: Any, corners: FloatArray, cells: int) -> tuple[FloatArray, FloatArray]:
    """Corners (k, 4, 2) of tags to a fraction of a pixel, and their standard deviations (k,).

    A line is fitted to the edge on each side; the corners are the intersections.

    Args:
        gray: (H, W) gray levels.
        corners: as detected.
        cells: number of cells along a side.
    """
    found = corners
    for _ in range(2):
        found, noise, blur = _intersect_edges(gray, found, cells)
        apart = np.linalg.norm(found - corners, axis=2).max(1)
        found = np.where((apart <= MAX_CORRECTION)[:, None, None], found, corners)
    narrow = _side_widths(found).min(1) / cells  # pixels, of the smallest cell
    by_blur = BLUR_FACTOR * np.square(blur / np.maximum(narrow, 0.5))
    sigma = np.sqrt(SHARED_SIGMA**2 + np.square(by_blur) + np.square(noise))
    return found, np.where(np.isfinite(sigma) & (apart <= MAX_CORRECTION), sigma.clip(max=1.0), 1.0)


def _side_widths(corners: FloatArray) -> FloatArray:
    """(k, 4) distance of the opposite side from the middle of each side, in pixels."""
    middle = (corners + np.roll(corners, -1, 1)) / 2
    along = np.roll(corners, -1, 1) - corners
    across = np.roll(middle, -2, 1) - middle
    return np.abs(_cross(along, across)) / np.maximum(np.linalg.norm(along, axis=2), 1e-9)


def _intersect_edges(
    gray: Any, corners: FloatArray, cells: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Intersections (k, 4, 2) of the lines along the sides of tags with given corners (k, 4, 2).

    Also (k,) the standard deviation of the lines by their residuals, and (k,) the blur, in pixels.
    """
    along = np.roll(corners, -1, 1) - corners  # (k, 4, 2), clockwise in the image
    length = np.maximum(np.linalg.norm(along, axis=2), 1e-9)
    outward = np.stack([along[..., 1], -along[..., 0]], -1) / length[..., None]
    half = np.clip(0.9 * _side_widths(corners).min(1) / cells, *HALF_WIDTH)  # (k,)
    fraction = np.linspace(ENDS, 1 - ENDS, POINTS)
    offset = np.linspace(-1, 1, PROFILE) * half[:, None]  # (k, m)
    points = corners[:, :, None] + fraction[:, None] * along[:, :, None]  # (k, 4, n, 2)
    samples = points[..., None, :] + (
        offset[:, None, None, :, None] * outward[:, :, None, None, :]
    )  # (k, 4, n, m, 2)
    slope = np.diff(_sampled(gray, samples), axis=-1).clip(min=0.0)  # (k, 4, n, m - 1)
    middle = ((offset[:, 1:] + offset[:, :-1]) / 2)[:, None, None]
    step = slope.sum(-1)
    edge = (slope * middle).sum(-1) / np.maximum(step, 1e-9)  # (k, 4, n)
    variance = (slope * np.square(middle - edge[..., None])).sum(-1) / np.maximum(step, 1e-9)
    line, spread = _fitted_lines(fraction, edge, step > MIN_STEP)
    independent = np.clip((1 - 2 * ENDS) * length, 3, POINTS)
    shift = line @ np.array([[1.0, 1.0], [0.0, 1.0]])  # offsets at both ends
    first = corners + shift[..., :1] * outward
    last = np.roll(corners, -1, 1) + shift[..., 1:] * outward
    before, direction = np.roll(first, 1, 1), last - first
    other = np.roll(direction, 1, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        position = _cross(before - first, other) / _cross(direction, other)
    found = first + position[..., None] * direction
    return (
        np.where(np.isfinite(found), found, corners),
        np.sqrt((4 * spread / independent).mean(1)),
        np.sqrt(np.median(variance, axis=2).mean(1)),
    )


def _sampled(gray: Any, xy: FloatArray) -> FloatArray:
    """Gray levels (...) at positions (..., 2) in pixels, linearly interpolated."""
    import cv2  # slow to import

    rows = xy.astype(np.float32).reshape(-1, xy.shape[-2], 2)
    values = [
        cv2.remap(
            gray,
            np.ascontiguousarray(part[..., 0]),
            np.ascontiguousarray(part[..., 1]),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        for part in np.array_split(rows, -(-len(rows) // 30_000))  # OpenCV's limit is 32767
    ]
    return np.concatenate(values).astype(np.float64).reshape(xy.shape[:-1])


def _fitted_lines(x: FloatArray, y: FloatArray, known: Any) -> tuple[FloatArray, FloatArray]:
    """Lines y = a + b x through points (..., n): (..., 2), and the variances (...,) around them.

    Points that are not `known`, and outliers, have next to no weight.
    """
    F = np.stack([np.ones_like(x), x], 1)
    base = np.where(known, 1.0, 1e-6)
    weight = base
    for _ in range(2):
        A = np.einsum("...n,na,nb->...ab", weight, F, F)
        line = np.linalg.solve(A, np.einsum("...n,na,...n->...a", weight, F, y)[..., None])[..., 0]
        residual = np.abs(y - line @ F.T)
        limit = 2.5 * (1.48 * np.median(residual, -1, keepdims=True) + 0.02)
        weight = np.where(residual < limit, base, 1e-6)
    spread = (weight * np.square(residual)).sum(-1) / np.maximum(weight.sum(-1) - 2, 1.0)
    return line, spread


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """(...) cross products of vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


class TagLog(NamedTuple):
    """Tags observed during a drive."""

    log: LandmarkLog
    """Odometry and the tags as labeled observations."""
    frame: IntArray
    """(t + 1,) number of the frame of the first camera at each pose; -1 for other cameras."""
    xy: FloatArray
    """(k, 2) centers of the observed tags in image pixels."""
    remarks: tuple[str, ...] = ()
    """Frames that could not be used, one line each."""


def observe_tags(
    drive: Drive,
    config: TagConfig,
    progress: Callable[[int, int], None] | None = None,
    others: Sequence[Drive] = (),
) -> TagLog:
    """The landmark log of the tags that a robot saw on a drive.

    Args:
        drive: frames of a camera, and odometry.
        config: family and size of the tags.
        progress: called with the number of frames done and of all frames.
        others: drives of further cameras on the robot, each with its mounting; on the clock of
            `drive`, whose odometry applies to all.

    Raises:
        ConfigError: the size is unknown.
        DriveError: the drive has no odometry, or no frame with an image.
        LogError: no tag in any frame.
    """
    require(config.size is not None, "size", "the side of the tags in meters", None)
    if not drive.has_odometry:
        raise DriveError(
            f"{drive.name}: expected odometry between the frames, found none; write odometry.csv, "
            "or use saccade drive --tags, which measures the motion by its images"
        )
    detector, cameras = Tags(config), [drive, *others]
    frames = sorted(
        (float(time), camera, number)
        for camera, each in enumerate(cameras)
        for number, time in enumerate(each.time)
        if drive.time[0] <= time <= drive.time[-1]
    )
    time = np.unique([each[0] for each in frames])
    pose, labels, seen, remarks = list[int](), list[str](), list[TagSightings](), list[str]()
    frame_of = np.full(len(time), -1)
    for done, (at, camera, number) in enumerate(frames, start=1):
        row = int(np.searchsorted(time, at))
        if camera == 0:
            frame_of[row] = number
        try:
            found = _sightings(detector, cameras[camera], number)
        except ImageError as error:
            remarks.append(str(error))
            continue
        pose += [row] * len(found)
        labels += found.labels
        seen.append(found)
        if progress is not None:
            progress(done, len(frames))
    if not labels:
        raise LogError(_nothing_found(drive, config, len(frames)))
    control, covariance = _increments_at(drive, time)
    landmark, text_names = number_names(np.array(labels, object))
    log = LandmarkLog(
        name=drive.name,
        start=drive.start,
        time=time,
        motion="compose",
        control=control,
        control_covariance=covariance,
        observation_pose=np.array(pose, np.int64),
        observation=np.concatenate([_known(each.z) for each in seen]),
        observation_covariance=np.concatenate([_known(each.R) for each in seen]),
        landmark=landmark,
        odometry_bias=drive.odometry_bias,
        truth=drive.truth,
        text_names=text_names,
    )
    return TagLog(log, frame_of, np.concatenate([each.xy for each in seen]), tuple(remarks))


def _sightings(detector: Tags, drive: Drive, number: int) -> TagSightings:
    """The tags in a frame; none without an image."""
    frame: Frame = drive.load(number)
    if frame.image is None:
        raise ImageError(f"{drive.name}, frame {number}: expected an image, found none")
    return detector(frame.image, drive.camera.turned(frame.turn))


def _known(array: FloatArray | None) -> FloatArray:
    assert array is not None
    return array


def _increments_at(drive: Drive, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Controls (m - 1, 3) between times (m,), which include all frames; and their covariances.

    A step between two frames is divided in proportion to the time.
    """
    if len(time) == len(drive.time):
        return drive.control, drive.control_covariance
    path = Trajectory(drive.time, path_of(drive.control))
    control = steps_between(path.interpolate(time))
    step = np.searchsorted(drive.time, time[:-1], side="right") - 1
    fraction = np.diff(time) / np.diff(drive.time)[step]
    return control, fraction[:, None, None] * drive.control_covariance[step]


def _nothing_found(drive: Drive, config: TagConfig, frames: int) -> str:
    """Message for a drive without tags; names another family, if one is in view."""
    message = f"{drive.name}: expected tags of the family {config.family}, found none in {frames} "
    hint = "check the family, focus, light, and that a white border surrounds each tag"
    sample = np.unique(np.linspace(0, len(drive) - 1, MAX_SAMPLES).astype(int)).tolist()
    for family in OTHER_FAMILIES:
        detector, count = Tags(replace(config, family=family, size=None)), 0
        for number in sample:
            with suppress(ImageError):
                count += len(_sightings(detector, drive, number))
        if family != config.family and count >= MIN_SIGHTINGS:
            hint = f"some are of the family {family}"
    return f"{message}frames; {hint}"
