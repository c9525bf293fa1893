"""The data types of a camera drive: cameras, poses, frames and odometry.

The robot's frame has x ahead, y to the left and z up; its origin is the point on the ground whose
motion odometry measures. The camera's has x to the right, y down and z along the optical axis.
"""

from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError, LogError, Settings, require, setting
from saccade.types import FloatArray, Image, IntArray, Table, Trajectory, check_arrays, column

AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""(3, 3) rotation of a camera that faces straight ahead, from its frame into the robot's."""
MAX_REPROJECTION = 0.1
"""Maximum error in pixels of a pixel that is undistorted and distorted again."""


class Lens(NamedTuple):
    """A lens model of OpenCV."""

    parameters: tuple[str, ...]
    """Names of the distortion coefficients, in order."""
    counts: tuple[int, ...]
    """Permitted numbers of coefficients; the others are 0."""
    names: str
    """Pattern of the model's names in calibration files, in lower-case letters only."""
    project: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    """Function of points (k, 3) in the camera's frame, the camera matrix (3, 3) and the
    coefficients: pixels (k, 2)."""
    undistort: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    """Function of pixels (k, 2), the camera matrix (3, 3) and the coefficients: pixels (k, 2) of
    the camera without distortion."""


STILL = np.zeros(3)
"""Rotation or translation of points that are in the camera's frame."""
TERMINATION = (3, 100, 1e-12)
"""OpenCV's termination criteria: maximum number of iterations, and accuracy in pixels."""


def _project_pinhole(points: FloatArray, K: FloatArray, distortion: FloatArray) -> FloatArray:
    import cv2

    xy = cv2.projectPoints(points, STILL, STILL, K, distortion)[0]
    return np.asarray(xy, np.float64).reshape(-1, 2)


def _undistort_pinhole(xy: FloatArray, K: FloatArray, distortion: FloatArray) -> FloatArray:
    import cv2

    undistort: Any = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # in OpenCV 4 and 5
    ideal = undistort(xy[:, None], K, distortion, R=np.eye(3), P=K, criteria=TERMINATION)
    return np.asarray(ideal, np.float64).reshape(-1, 2)


def _project_fisheye(points: FloatArray, K: FloatArray, distortion: FloatArray) -> FloatArray:
    import cv2

    xy = cv2.fisheye.projectPoints(points[:, None], STILL, STILL, K, distortion)[0]
    return np.asarray(xy, np.float64).reshape(-1, 2)


def _undistort_fisheye(xy: FloatArray, K: FloatArray, distortion: FloatArray) -> FloatArray:
    import cv2

    ideal = cv2.fisheye.undistortPoints(xy[:, None], K, distortion, P=K, criteria=TERMINATION)
    return np.asarray(ideal, np.float64).reshape(-1, 2)


LENSES = {
    "pinhole": Lens(
        parameters=(
            *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
            *("s1", "s2", "s3", "s4", "tx", "ty"),
        ),
        counts=(0, 4, 5, 8, 12, 14),
        names=(
            "|none|pinhole|plumbbob|rational(polynomial)?|thinprism|radialtangential|radtan"
            "|brown(conrad(y|ie))?|opencv|fullopencv"
        ),
        project=_project_pinhole,
        undistort=_undistort_pinhole,
    ),
    "fisheye": Lens(
        parameters=("k1", "k2", "k3", "k4"),
        counts=(4,),
        names="(opencv)?fisheye|equi(distant)?|kannalabrandt",
        project=_project_fisheye,
        undistort=_undistort_fisheye,
    ),
}
"""Lens models by name."""


@dataclass(frozen=True, eq=False)
class Camera(Settings):
    """Calibration of a camera, or of a rectified stereo rig, and its mounting on the robot.

    Pixel (0, 0) is the center of the first pixel.

    Raises:
        ConfigError: a size, focal length or baseline out of range, an invalid rotation, or
            coefficients that the lens model does not have.
    """

    width: int = setting(MISSING, 1, 65536)
    """Width of the image in pixels."""
    height: int = setting(MISSING, 1, 65536)
    """Height of the image in pixels."""
    fx: float = setting(MISSING, 1e-6, 1e6)
    """Horizontal focal length in pixels."""
    fy: float = setting(MISSING, 1e-6, 1e6)
    """Vertical focal length in pixels."""
    cx: float = setting(MISSING, -1e6, 1e6)
    """Column of the principal point in pixels."""
    cy: float = setting(MISSING, -1e6, 1e6)
    """Row of the principal point in pixels."""
    baseline: float = setting(0.0, 0, 1000)
    """Distance to the right camera in meters; 0 for a single camera."""
    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) position of the camera in the robot frame, in meters; the height is 0 if unknown."""
    rotation: FloatArray = field(default_factory=lambda: AHEAD.copy())
    """(3, 3) rotation from the camera's frame into the robot's."""
    lens: str = "pinhole"
    """Lens model, a name in `LENSES`."""
    distortion: tuple[float, ...] = ()
    """Coefficients of the lens model in OpenCV's order; none without distortion."""

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike, size: tuple[int, int], **others: Any) -> "Camera":
        """The camera of a matrix (3, 3) or a projection (3, 4).

        Args:
            matrix: camera matrix in pixels; its skew is ignored.
            size: width and height in pixels.
            others: the other fields, by name.
        """
        (fx, _, cx), (_, fy, cy) = np.asarray(matrix, np.float64)[:2, :3].tolist()
        return cls(int(size[0]), int(size[1]), fx, fy, cx, cy, **others)

    def __post_init__(self) -> None:
        super().__post_init__()
        valid = self.position.shape == (3,) and bool(np.isfinite(self.position).all())
        require(valid, "position", "three numbers in meters", self.position.tolist())
        valid = self.rotation.shape == (3, 3) and bool(
            np.abs(self.rotation).max() < 2  # so that no product is infinite
            and np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() < 1e-3
            and np.linalg.det(self.rotation) > 0
        )
        require(valid, "rotation", "a rotation matrix (3, 3)", self.rotation.tolist())
        require(self.lens in LENSES, "lens", f"one of {', '.join(LENSES)}", self.lens)
        lens = LENSES[self.lens]
        names, counts = ", ".join(lens.parameters), ", ".join(map(str, lens.counts))
        expected = f"{counts} coefficients of {names} of the lens {self.lens!r}"
        require(len(self.distortion) in lens.counts, "distortion", expected, self.distortion)

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether pixels deviate from those of a pinhole camera."""
        return self.lens != "pinhole" or any(self.distortion)

    @property
    def undistorted(self) -> "Camera":
        """The camera of undistorted images: a pinhole camera with the same matrix."""
        return replace(self, lens="pinhole", distortion=())

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels (k, 2) of points (k, 3) in the camera's frame, in meters; NaN behind it."""
        K, distortion = self.matrix, np.array(self.distortion)
        is_ahead = points[:, 2] > 0
        safe = np.where(is_ahead[:, None], points, (0.0, 0.0, 1.0))
        xy = LENSES[self.lens].project(safe, K, distortion)
        return np.where(is_ahead[:, None], xy, np.nan)

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Pixels (k, 2) of the camera without distortion, of pixels (k, 2) as recorded.

        NaN outside the field of the lens model.
        """
        if not self.is_distorted or len(xy) == 0:
            return xy
        K, distortion = self.matrix, np.array(self.distortion)
        recorded = np.asarray(xy, np.float64)
        ideal = LENSES[self.lens].undistort(recorded, K, distortion)
        again = self.project(directions(self.undistorted, ideal))
        is_valid = np.abs(again - recorded).max(1) < MAX_REPROJECTION
        return np.where(is_valid[:, None], ideal, np.nan)

    def maps_to(
        self, camera: "Camera", rotation: FloatArray | None = None
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Maps (H, W) for `cv2.remap` from images of this camera to those of another camera.

        Args:
            camera: camera of the images to make, at the same position and without distortion.
            rotation: (3, 3) from its frame to the frame of this camera; by default the identity.
        """
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        pixels = np.stack([columns.ravel(), rows.ravel()], 1).astype(np.float64)
        rays = directions(camera, pixels)
        xy = self.project(rays if rotation is None else rays @ rotation.T).astype(np.float32)
        x, y = (
            np.nan_to_num(xy, nan=-1.0).reshape(camera.height, camera.width, 2).transpose(2, 0, 1)
        )
        return np.ascontiguousarray(x), np.ascontiguousarray(y)

    def turned(self, turn: "CameraTurn | None") -> "Camera":
        """The camera turned about its optical center; itself where it is as mounted."""
        return self if turn is None else replace(self, rotation=turn.rotation @ self.rotation)


def directions(camera: Camera, xy: FloatArray) -> FloatArray:
    """Rays (k, 3) of undistorted pixels (k, 2) in the camera's frame, with z = 1."""
    x, y = (xy[:, 0] - camera.cx) / camera.fx, (xy[:, 1] - camera.cy) / camera.fy
    return np.stack([x, y, np.ones(len(xy))], 1)


class CameraTurn(NamedTuple):
    """Rotation of a pan-tilt camera relative to its mounting.

    The axis passes through the optical center, of the left camera in a stereo rig.
    """

    pan: float
    """Radians to the left, about the vertical."""
    tilt: float = 0.0
    """Radians up."""
    sigma: float = 0.0
    """Standard deviation of both as measured, in radians."""
    reason: str = ""
    """Reason for the turn: the `Gaze.reason` of the last decision."""

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) rotation in the robot's frame: tilt, then pan."""
        c, s = np.cos(self.pan), np.sin(self.pan)
        a, b = np.cos(self.tilt), np.sin(self.tilt)
        return np.array([[c * a, -s, -c * b], [s * a, c, -s * b], [b, 0.0, a]])


@dataclass(frozen=True, eq=False, repr=False)
class Poses:
    """n timed poses in space; `Trajectory` has poses on the plane."""

    time: FloatArray
    """(n,) seconds, ascending."""
    rotation: FloatArray
    """(n, 3, 3) from the frame of the body to the frame of the world."""
    position: FloatArray
    """(n, 3) meters, in the frame of the world."""

    @classmethod
    def from_rows(cls, rows: npt.ArrayLike, name: str) -> "Poses":
        """Poses of rows (n, 8): time, position, and quaternion x, y, z, w, normalized first.

        Raises:
            LogError: a quaternion that is near 0; the message begins with `name`.
        """
        from scipy.spatial.transform import Rotation  # slow to import

        table = np.asarray(rows, np.float64).reshape(-1, 8)
        length = np.linalg.norm(table[:, 4:], axis=1)
        if (length < 0.5).any():
            row = int(np.argmin(length))
            raise LogError(
                f"{name}: expected unit quaternions, found length {length[row]:.3g}, {row=}"
            )
        rotation = Rotation.from_quat(table[:, 4:]).as_matrix()
        return cls(table[:, 0], rotation, table[:, 1:4])

    @property
    def inverse(self) -> "Poses":
        """Poses of the world in the frame of the body."""
        rotation = self.rotation.transpose(0, 2, 1)
        return Poses(self.time, rotation, -np.einsum("nij,nj->ni", rotation, self.position))

    @property
    def on_plane(self) -> Trajectory:
        """Poses projected to the plane z = 0: x, y, and the heading of the x axis."""
        x_axis = self.rotation[:, :, 0]
        heading = np.arctan2(x_axis[:, 1], x_axis[:, 0])
        return Trajectory(self.time, np.column_stack([self.position[:, :2], heading]))

    def interpolate(self, time: FloatArray) -> "Poses":
        """Poses at times (m,), with spherical interpolation; the end poses are held."""
        from scipy.spatial.transform import Rotation

        after = np.searchsorted(self.time, time).clip(1, len(self.time) - 1)
        before = after - 1
        span = self.time[after] - self.time[before]
        fraction = (time - self.time[before]) / np.where(span > 0, span, 1.0)
        fraction = np.where(span > 0, fraction, 0.0).clip(0.0, 1.0)[:, None]
        step = self.position[after] - self.position[before]
        start = Rotation.from_matrix(self.rotation[before])
        turn = (start.inv() * Rotation.from_matrix(self.rotation[after])).as_rotvec()
        rotation = (start * Rotation.from_rotvec(fraction * turn)).as_matrix()
        return Poses(time, rotation, self.position[before] + fraction * step)

    def __matmul__(self, other: "Poses") -> "Poses":
        """Poses of a body that has the poses `other` (n,) in the frame of this one."""
        shift = np.einsum("nij,nj->ni", self.rotation, other.position)
        return Poses(self.time, self.rotation @ other.rotation, self.position + shift)

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        return f"Poses({len(self)})"


@dataclass(frozen=True)
class Gaze:
    """A viewing direction, with the reason for its choice."""

    pan: float
    """Radians to the left of ahead."""
    tilt: float = 0.0
    """Radians up."""
    reason: str = ""
    """The term that decided."""


@dataclass(frozen=True)
class GazeLimits(Settings):
    """Limits of the direction of view.

    Raises:
        ConfigError: a limit outside its range.
    """

    pan: tuple[float, float] = setting((-2.6, 2.6), -2 * np.pi, 2 * np.pi)
    """Minimum and maximum pan in radians."""
    tilt: tuple[float, float] = setting((0.0, 0.0), -2 * np.pi, 2 * np.pi)
    """Minimum and maximum tilt in radians."""
    rate: float = setting(float(np.pi), 1e-3, 1e3)
    """Maximum speed of pan and tilt, in radians per second."""
    latency: float = setting(0.1, 0, 60)
    """Seconds from a decision to the start of the motion."""
    max_range: float = setting(16.0, 0.1, 1e4)
    """Maximum distance in meters of the landmarks and salient regions that count; less where the
    camera does not measure ranges so far."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("pan", "tilt"):
            low, high = getattr(self, name)
            require(low <= high, name, "two ascending angles", (low, high))


@dataclass(frozen=True, eq=False, repr=False)
class Tracks(Table):
    """Points of one frame that were tracked by another program."""

    id: IntArray = column(dtype=np.int64)
    """(k,) track ids."""
    xy: FloatArray = column(2)
    """(k, 2) positions in the (left) image, in pixels."""
    disparity: FloatArray = column()
    """(k,) stereo disparities in pixels; NaN where unknown."""
    descriptor: npt.NDArray[np.uint8] | None = None
    """(k, 128) SIFT descriptors for re-identification; None if unknown."""

    def __repr__(self) -> str:
        return f"Tracks({len(self)} points)"


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """The data of the camera at one time."""

    time: float
    """Timestamp in seconds."""
    image: Image | None = None
    """Image of the (left) camera."""
    right: Image | None = None
    """Image of the right camera of a rectified stereo rig."""
    depth: FloatArray | None = None
    """(H, W) meters along the optical axis, NaN where unknown."""
    tracks: Tracks | None = None
    """Tracked points, instead of an image or with it."""
    turn: CameraTurn | None = None
    """Turn of a camera that turns, at this time; None where it is as mounted."""

    @property
    def gaze(self) -> Gaze:
        """Where the camera looks, and why."""
        if self.turn is not None:
            return Gaze(self.turn.pan, self.turn.tilt, self.turn.reason)
        return Gaze(0.0)

    def __repr__(self) -> str:
        names = ("image", "right", "depth", "tracks")
        present = [name for name in names if getattr(self, name) is not None]
        return f"Frame({self.time:.3f} s, {', '.join(present) or 'empty'})"


class EndOfDrive(Exception):  # noqa: N818 - as StopIteration
    """Raised by `Drive.load` of a live camera that gives no more frames: the drive ends there."""


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """A recording of a robot with a camera: n frames, and odometry from each to the next.

    Raises:
        DriveError: inconsistent shapes, NaN, or times that go back.
    """

    name: str
    """Name of the sequence, for headings and messages."""
    camera: Camera
    """Calibration of the camera and its pose on the robot."""
    time: FloatArray
    """(n,) times of the frames in seconds, ascending."""
    control: FloatArray
    """(n - 1, 3) pose of frame i + 1 in the robot's frame of i by odometry: meters ahead, meters
    to the left, radians."""
    control_covariance: FloatArray
    """(n - 1, 3, 3) covariances of `control`."""
    load: Callable[[int], Frame]
    """Loads a frame by number; raises `ImageError` for an unreadable file and `EndOfDrive` at the
    end of a live camera."""
    start: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) pose at the first frame."""
    has_odometry: bool = True
    """Whether the controls were measured; otherwise they are unknown or assumed."""
    odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviations of systematic errors, as `LandmarkLog.odometry_bias`."""
    truth: Trajectory | None = None
    """Ground truth, if known; its times may differ from the times of the frames."""
    start_known: bool = True
    """Whether `start` is in the frame of the truth; False where the truth does not cover it."""
    scale: Literal["metric", "held", "assumed"] = "metric"
    """Unit of lengths, arbitrary for a single camera without odometry: "held" from step to step
    by triangulated points, or "assumed" from a constant speed."""
    remarks: tuple[str, ...] = ()
    """Repairs made when its files were read, one line each."""
    assumptions: tuple[str, ...] = ()
    """Assumptions on camera and motion that the files lack, one line each."""

    def __post_init__(self) -> None:
        n = len(self.time)
        if n < 1:
            raise DriveError(f"{self.name}: expected at least one frame, found none")
        shapes: dict[str, tuple[int, ...]] = {"time": (n,), "control": (n - 1, 3), "start": (3,)}
        shapes["control_covariance"] = (n - 1, 3, 3)
        check_arrays(self, shapes, ("time",), DriveError)

    @property
    def aligned_truth(self) -> Trajectory | None:
        """The truth, if it is in the frame of `start`."""
        return self.truth if self.start_known else None

    def until(self, frames: int) -> "Drive":
        """The first frames of the drive."""
        return replace(
            self,
            time=self.time[:frames],
            control=self.control[: frames - 1],
            control_covariance=self.control_covariance[: frames - 1],
        )

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        return f"Drive({self.name}: {len(self)} frames)"
