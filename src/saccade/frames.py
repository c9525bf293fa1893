"""The data types of a camera drive: calibration, frames and odometry.

The robot's frame has x ahead, y to the left and z up; its origin is the point on the ground whose
motion odometry measures. The camera's has x to the right, y down and z along the optical axis.
"""

from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError, Settings, require, setting
from saccade.types import FloatArray, Image, IntArray, Table, Trajectory, check_arrays, column

AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""(3, 3) rotation of a camera that faces straight ahead, from its frame into the robot's."""


@dataclass(frozen=True, eq=False)
class Camera(Settings):
    """Calibration of a pinhole camera without distortion, or of a rectified stereo rig.

    Raises:
        ConfigError: a size, focal length or baseline out of range, or an invalid rotation.
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

    def turned(self, turn: "CameraTurn | None") -> "Camera":
        """The camera turned about its optical center; itself where it is as mounted."""
        return self if turn is None else replace(self, rotation=turn.rotation @ self.rotation)


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

    @property
    def has_odometry(self) -> bool:
        """Whether the controls were measured, rather than zero or assumed."""
        return self.scale == "metric" and bool(self.control.any())

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
