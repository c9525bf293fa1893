"""The data types of a camera drive: calibration, frames and odometry.

The robot's frame has x ahead, y to the left and z up, its origin on the ground where
odometry is measured. The camera's has x to the right, y down and z along the optical axis.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from saccade.errors import DriveError, require
from saccade.types import FloatArray, Image, IntArray, Trajectory, check_arrays

AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""(3, 3) rotation into the robot's frame of a camera that faces straight ahead."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Calibration of a pinhole camera without distortion, or of a rectified stereo rig.

    Raises:
        ConfigError: a size, focal length or baseline out of range, or an invalid rotation.
    """

    width: int
    """Of the image, in pixels."""
    height: int
    """Of the image, in pixels."""
    fx: float
    """Horizontal focal length in pixels."""
    fy: float
    """Vertical focal length in pixels."""
    cx: float
    """Column of the principal point in pixels."""
    cy: float
    """Row of the principal point in pixels."""
    baseline: float = 0.0
    """Distance to the right camera in meters; 0 for a single camera."""
    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) of the camera in the robot's frame, in meters; the height is 0 if unknown."""
    rotation: FloatArray = field(default_factory=lambda: AHEAD.copy())
    """(3, 3) rotation from the camera's frame into the robot's."""

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self, name)
            require(1 <= value <= 1 << 16, name, "1 to 65536 px", value)
        for name in ("fx", "fy"):
            value = getattr(self, name)
            require(0 < value < 1e6, name, "over 0 px, under 1e6", value)
        for name in ("cx", "cy"):
            require(bool(np.isfinite(getattr(self, name))), name, "a number", getattr(self, name))
        require(0 <= self.baseline < 1e3, "baseline", "0 to under 1000 m", self.baseline)
        placed = self.position.shape == (3,) and bool(np.isfinite(self.position).all())
        require(placed, "position", "three numbers in metres", self.position.tolist())
        turns = self.rotation.shape == (3, 3) and bool(
            np.abs(self.rotation).max() < 2  # so that no product is infinite
            and np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() < 1e-3
            and np.linalg.det(self.rotation) > 0
        )
        require(turns, "rotation", "a rotation matrix (3, 3)", self.rotation.tolist())


@dataclass(frozen=True, eq=False, repr=False)
class Tracks:
    """Points of one frame that were tracked by another program."""

    id: IntArray
    """(k,) number of the track."""
    xy: FloatArray
    """(k, 2) position in the (left) image, in pixels."""
    disparity: FloatArray
    """(k,) stereo disparity in pixels; NaN if unknown."""

    def __len__(self) -> int:
        return len(self.id)

    def __repr__(self) -> str:
        return f"Tracks({len(self)} points)"


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """The data of the camera at one time."""

    time: float
    """Seconds."""
    image: Image | None = None
    """Of the (left) camera."""
    right: Image | None = None
    """Of the right camera of a rectified rig."""
    depth: FloatArray | None = None
    """(H, W) meters along the optical axis, NaN where unknown."""
    tracks: Tracks | None = None
    """Tracked points, instead of an image or with it."""

    def __repr__(self) -> str:
        names = ("image", "right", "depth", "tracks")
        present = [name for name in names if getattr(self, name) is not None]
        return f"Frame({self.time:.3f} s, {', '.join(present) or 'nothing'})"


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """A recording of a robot with a camera: n frames, and odometry from each to the next.

    Raises:
        DriveError: shapes that do not fit together, NaN, or times that go back.
    """

    name: str
    """Name of the sequence, for headings and messages."""
    camera: Camera
    """Its calibration and its pose on the robot."""
    time: FloatArray
    """(n,) of each frame, in seconds, ascending."""
    control: FloatArray
    """(n - 1, 3) pose of frame i + 1 in the robot's frame of i by odometry: meters ahead, meters
    to the left, radians."""
    control_covariance: FloatArray
    """(n - 1, 3, 3)."""
    load: Callable[[int], Frame]
    """Frame of a number; raises `ImageError` where its file cannot be read."""
    start: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) pose at the first frame."""
    odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """As that of `LandmarkLog`."""
    truth: Trajectory | None = None
    """Ground truth, if known; its times need not be those of the frames."""
    truth_off_plane: FloatArray | None = None
    """(t, 3) ground truth off the plane, if known: height in meters, pitch (nose up) and roll in
    radians, at the poses of `truth`."""
    remarks: tuple[str, ...] = ()
    """Repairs by the reader of its files, one line each."""

    def __post_init__(self) -> None:
        n = len(self.time)
        if n < 1:
            raise DriveError(f"{self.name}: expected at least one frame, found none")
        shapes = {
            "time": (n,),
            "control": (n - 1, 3),
            "control_covariance": (n - 1, 3, 3),
            "start": (3,),
        }
        check_arrays(self, shapes, ("time",), DriveError)

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


def steps_between(pose: FloatArray) -> FloatArray:
    """Each pose (n, 3) in the frame of the previous, (n - 1, 3): meters ahead and left, radians."""
    east, north, turn = np.diff(pose, axis=0).T
    c, s = np.cos(pose[:-1, 2]), np.sin(pose[:-1, 2])
    turn = turn - 2 * np.pi * np.rint(turn / (2 * np.pi))
    return np.stack([c * east + s * north, c * north - s * east, turn], 1)
