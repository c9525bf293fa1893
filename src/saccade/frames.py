"""The data types of a camera drive: what a robot with a camera saw and how far it went meanwhile.

The robot's frame has x ahead, y to the left and z up, its origin on the ground where
odometry is measured. The camera's has x to the right, y down and z along the optical axis.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from saccade.errors import DriveError, require
from saccade.types import FloatArray, Image, IntArray, Trajectory

AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""(3, 3) that turns vectors of a camera which looks straight ahead into the robot's frame."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera without distortion on a robot; with a second one to its right, a stereo rig.

    Raises:
        ConfigError: a size, a focal length or a baseline that none has, or a rotation that is none.
    """

    width: int
    """Of the image, in pixels."""
    height: int
    """Of the image, in pixels."""
    fx: float
    """Focal length across, in pixels."""
    fy: float
    """Focal length down, in pixels."""
    cx: float
    """Where the optical axis meets the image, in pixels."""
    cy: float
    """Where the optical axis meets the image, in pixels."""
    baseline: float = 0.0
    """Metres to the right camera of a rectified rig; 0 where there is none."""
    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) where the camera is in the robot's frame, in metres; the height is 0 if not known."""
    rotation: FloatArray = field(default_factory=lambda: AHEAD.copy())
    """(3, 3) that turns vectors of the camera's frame into the robot's."""

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
    """Points that someone else has followed from frame to frame."""

    id: IntArray
    """(k,) the same number for the same point."""
    xy: FloatArray
    """(k, 2) place in the (left) image, in pixels."""
    disparity: FloatArray
    """(k,) pixels by which it lies further left in the right image; NaN where not known."""

    def __len__(self) -> int:
        return len(self.id)

    def __repr__(self) -> str:
        return f"Tracks({len(self)} points)"


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """What the camera gives at one time; what it did not give is None."""

    time: float
    """Seconds."""
    image: Image | None = None
    """Of the (left) camera."""
    right: Image | None = None
    """Of the right camera of a rectified rig."""
    depth: FloatArray | None = None
    """(H, W) metres along the optical axis, NaN where not known."""
    tracks: Tracks | None = None
    """Instead of an image, or beside it."""

    def __repr__(self) -> str:
        there = [n for n in ("image", "right", "depth", "tracks") if getattr(self, n) is not None]
        return f"Frame({self.time:.3f} s, {', '.join(there) or 'nothing'})"


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """A robot's way with a camera: n frames, and odometry from each to the next.

    Raises:
        DriveError: shapes that do not fit together, NaN, or times that go back.
    """

    name: str
    """The sequence, for headings and messages."""
    camera: Camera
    """Its calibration and its place on the robot."""
    time: FloatArray
    """(n,) of each frame, in seconds, ascending."""
    control: FloatArray
    """(n - 1, 3) pose of frame i + 1 in the robot's frame of i by odometry: metres ahead, metres
    to the left, radians turned."""
    control_covariance: FloatArray
    """(n - 1, 3, 3)."""
    load: Callable[[int], Frame]
    """Frame of a number; raises `ImageError` where its file cannot be read."""
    start: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) pose at the first frame."""
    odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """As that of `LandmarkLog`."""
    truth: Trajectory | None = None
    """Where the robot really was, if known; its times need not be those of the frames."""
    truth_off_plane: FloatArray | None = None
    """What the plane leaves out of the truth, if known: (t, 3) height in metres, pitch (nose up)
    and roll in radians, at the poses of `truth`."""
    remarks: tuple[str, ...] = ()
    """What the reader of its files had to mend, one line each."""

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
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise DriveError(
                    f"{self.name}: {name}: expected shape {shape}, found {array.shape}"
                )
            if not np.isfinite(array).all():
                raise DriveError(f"{self.name}: {name}: expected finite numbers, found NaN")
        if (np.diff(self.time) < 0).any():
            row = int(np.argmax(np.diff(self.time) < 0)) + 1
            raise DriveError(f"{self.name}: time: goes back at frame {row}; sort the frames")

    def until(self, frames: int) -> "Drive":
        """The first so many frames of it."""
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
    """Each pose (n, 3) in the frame of the last one, (n - 1, 3): metres ahead and left, radians."""
    east, north, turn = np.diff(pose, axis=0).T
    c, s = np.cos(pose[:-1, 2]), np.sin(pose[:-1, 2])
    turn = turn - 2 * np.pi * np.rint(turn / (2 * np.pi))
    return np.stack([c * east + s * north, c * north - s * east, turn], 1)
