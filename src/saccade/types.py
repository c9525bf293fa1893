"""The data types that flow through `saccade`: values, never changed once made.

Points are (x, y) with the centre of the top-left pixel at (0, 0); arrays are
indexed [row, column]. On the ground x and y are metres, angles radians in
(-pi, pi], counter-clockwise from the x axis.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError, LogError

Image: TypeAlias = npt.NDArray[Any]
"""(H, W), (H, W, 3) RGB or (H, W, 4) RGBA; uint8, uint16, bool, or float in [0, 1]."""

FloatArray: TypeAlias = npt.NDArray[np.float64]
Float32Array: TypeAlias = npt.NDArray[np.float32]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

THREE_SIGMA_2D = 11.829
"""Squared Mahalanobis distance on the plane within which 99.73 % of a Gaussian lie: 3 sigma."""


@dataclass(frozen=True, eq=False, repr=False)
class Keypoints:
    """Interest points of one image, strongest response first unless a detector says otherwise."""

    xy: Float32Array
    """(n, 2) place in image pixels."""
    size: Float32Array
    """(n,) diameter in image pixels, as OpenCV means it."""
    angle: Float32Array
    """(n,) orientation in radians, from x towards y (clockwise on the screen)."""
    response: Float32Array
    """(n,) strength; its unit is the detector's."""
    octave: npt.NDArray[np.int32]
    """(n,) octave of the scale space; -1 is the doubled image, 0 the image itself, or not known."""
    descriptors: npt.NDArray[np.uint8] | npt.NDArray[np.float32] | None = None
    """(n, 128) uint8, or float32 of unit length: 4 x 4 subregions, row by row in the frame of the
    angle, of 8 orientation bins that turn from y towards x, as OpenCV's do. None where they were
    not asked for."""

    @classmethod
    def at(cls, xy: npt.ArrayLike, size: npt.ArrayLike, angle: npt.ArrayLike = 0.0) -> "Keypoints":
        """Points from anywhere, without response, octave and descriptors.

        Args:
            xy: (n, 2) place in image pixels.
            size: (n,) or one for all: diameter in image pixels, as OpenCV means it.
            angle: (n,) or one for all: radians from x towards y.

        Raises:
            KeypointsError: other shapes.
        """
        places = np.array(xy, np.float32)
        if places.shape == (0,):
            places = places.reshape(0, 2)
        if places.ndim != 2 or places.shape[1] != 2:
            raise KeypointsError(f"xy: expected shape (n, 2), found {places.shape}")
        n = len(places)
        columns = {"size": np.array(size, np.float32), "angle": np.array(angle, np.float32)}
        for name, column in columns.items():
            if column.shape not in ((), (n,)):
                raise KeypointsError(f"{name}: expected shape ({n},), found {column.shape}")
        return cls(
            xy=places,
            size=np.broadcast_to(columns["size"], n).copy(),
            angle=np.broadcast_to(columns["angle"], n).copy(),
            response=np.zeros(n, np.float32),
            octave=np.zeros(n, np.int32),
        )

    def __len__(self) -> int:
        return len(self.xy)

    def __getitem__(self, index: slice | npt.NDArray[Any]) -> "Keypoints":
        """The points that a slice, a mask or an index array names."""
        return Keypoints(
            self.xy[index],
            self.size[index],
            self.angle[index],
            self.response[index],
            self.octave[index],
            None if self.descriptors is None else self.descriptors[index],
        )

    def __repr__(self) -> str:
        described = "without descriptors" if self.descriptors is None else "with descriptors"
        return f"Keypoints({len(self)} points, {described})"


@dataclass(frozen=True, eq=False, repr=False)
class Regions:
    """Regions of interest of one image, the strongest first."""

    keypoints: Keypoints
    """Their centers as points; the size is the mean side of the box."""
    boxes: Float32Array
    """(n, 4) left, top, right and bottom in image pixels."""

    @classmethod
    def none(cls) -> "Regions":
        """No regions at all."""
        points = Keypoints.at([], 1.0)
        described = replace(points, descriptors=np.zeros((0, 128), np.uint8))
        return cls(described, np.zeros((0, 4), np.float32))

    @property
    def xy(self) -> Float32Array:
        """(n, 2) centers in image pixels."""
        return self.keypoints.xy

    @property
    def descriptors(self) -> npt.NDArray[np.uint8] | npt.NDArray[np.float32] | None:
        """(n, 128), as those of points."""
        return self.keypoints.descriptors

    def __len__(self) -> int:
        return len(self.keypoints)

    def __repr__(self) -> str:
        return f"Regions({len(self)} regions)"


def check_pairs(pairs: IntArray, counts: tuple[int, int], name: str) -> None:
    """Raise `KeypointsError` unless `pairs` are (m, 2) indices below the `counts` of two images."""
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu":
        raise KeypointsError(
            f"{name}: expected whole numbers of shape (m, 2), "
            f"found {pairs.dtype} of shape {pairs.shape}"
        )
    if ((pairs < 0) | (pairs >= counts)).any():
        raise KeypointsError(
            f"{name}: expected indices below {counts[0]} and {counts[1]}, "
            f"found {pairs.min()} to {pairs.max()}"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Scanpath:
    """Fixations in the order in which they win."""

    xy: FloatArray
    """(n, 2) place in image pixels."""
    time: FloatArray
    """(n,) seconds since the onset of the image."""
    saliency: FloatArray
    """(n,) value of the saliency map at the winner."""

    def __len__(self) -> int:
        return len(self.xy)

    def __repr__(self) -> str:
        last = f", {self.time[-1]:.3f} s" if len(self) else ""
        return f"Scanpath({len(self)} fixations{last})"


@dataclass(frozen=True, eq=False, repr=False)
class SymmetricPairs:
    """Pairs of gradients that face each other across a place, the strongest first."""

    first: FloatArray
    """(n, 2) place of the one, in image pixels."""
    second: FloatArray
    """(n, 2) place of the other."""
    first_angle: FloatArray
    """(n,) direction in radians, from x towards y, in which it gets lighter at the one."""
    second_angle: FloatArray
    """(n,) the same at the other."""
    strength: FloatArray
    """(n,) what the pair contributes to the symmetry of the place."""
    level: IntArray
    """(n,) pyramid level at which it was found; 0 is the image."""

    def __len__(self) -> int:
        return len(self.strength)

    def __getitem__(self, index: slice | npt.NDArray[Any]) -> "SymmetricPairs":
        """The pairs that a slice, a mask or an index array names."""
        return SymmetricPairs(
            self.first[index],
            self.second[index],
            self.first_angle[index],
            self.second_angle[index],
            self.strength[index],
            self.level[index],
        )

    def __repr__(self) -> str:
        return f"SymmetricPairs({len(self)} pairs)"


class Observation(NamedTuple):
    """One landmark as the robot sees it."""

    z: FloatArray
    """(2,) range in metres and bearing in radians, in the robot's frame."""
    covariance: FloatArray
    """(2, 2) of `z`."""
    landmark: int = -1
    """Identity of the landmark, -1 where it is unknown."""


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """Where the robot was, in the frame of its map."""

    time: FloatArray
    """(t,) seconds; the number of the pose where the source has no clock."""
    pose: FloatArray
    """(t, 3) x and y in metres, heading in radians."""
    covariance: FloatArray | None = None
    """(t, 3, 3), or None where it is not known."""

    def __len__(self) -> int:
        return len(self.time)

    def at(self, time: FloatArray) -> FloatArray:
        """(n, 3) poses at given times (n,), between two in a straight line; those at the ends last.

        Raises:
            ValueError: the trajectory has no poses.
        """
        x, y, heading = self.pose.T
        columns = [np.interp(time, self.time, each) for each in (x, y, np.unwrap(heading))]
        columns[2] = np.angle(np.exp(1j * columns[2]))
        return np.stack(columns, 1)

    def __repr__(self) -> str:
        length = float(np.hypot(*np.diff(self.pose[:, :2], axis=0).T).sum()) if len(self) else 0.0
        return f"Trajectory({len(self)} poses, {length:.1f} m)"


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkMap:
    """Where the landmarks are."""

    id: IntArray
    """(n,) identity in the log; the order of first sight where the log has none."""
    xy: FloatArray
    """(n, 2) metres, in the frame of the trajectory."""
    covariance: FloatArray | None = None
    """(n, 2, 2) square metres, or None where it is not known."""
    observations: IntArray | None = None
    """(n,) how many observations went into each."""

    def __len__(self) -> int:
        return len(self.id)

    def __repr__(self) -> str:
        return f"LandmarkMap({len(self)} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class MapSnapshot:
    """The map as it stands at one pose of a drive."""

    step: int
    """Number of the pose."""
    path: FloatArray
    """(m, 3) the poses since the last snapshot, this one at the end."""
    covariance: FloatArray
    """(3, 3) of this pose."""
    landmarks: FloatArray
    """(n, 2) metres."""
    landmark_covariance: FloatArray
    """(n, 2, 2) square metres."""
    observed: IntArray
    """(s,) rows of `landmarks` that were observed since the last snapshot."""
    ids: IntArray
    """(n,) how many landmarks had been taken in before each: the same in every snapshot."""

    def __repr__(self) -> str:
        return f"MapSnapshot(pose {self.step}, {len(self.landmarks)} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkLog:
    """What a robot drove and what it saw: t controls between t + 1 poses, k observations.

    Raises:
        LogError: shapes that do not fit together, NaN, or an order that goes back.
    """

    name: str
    """The data set, for headings and messages."""
    start: FloatArray
    """(3,) pose at the beginning."""
    time: FloatArray
    """(t + 1,) of each pose, in seconds; the number of the pose where the log has no clock."""
    motion: Literal["drive", "compose", "custom"]
    """What a control is: "drive" (distance, turn), turned before driven as in C.5;
    "compose" (forward, left, turn), the next pose in the frame of the last; or "custom",
    what a motion model of one's own takes."""
    control: FloatArray
    """(t, c) from pose i to pose i + 1: c is 2, 3 or the model's."""
    control_covariance: FloatArray
    """(t, c, c)."""
    observation_pose: IntArray
    """(k,) number of the pose from which each observation was made, ascending."""
    observation: FloatArray
    """(k, 2) range in metres, bearing in radians; or what a sensor model of one's own takes."""
    observation_covariance: FloatArray
    """(k, 2, 2)."""
    landmark: IntArray
    """(k,) identity of what was seen, -1 where the log does not say."""
    odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How far the odometry may be off in the same way all the time, standard deviations: the share
    of the way that it leaves out, radians turned unnoticed in a metre of it, and metres not
    driven of it for each radian turned."""
    truth: Trajectory | None = None
    """Where the robot really was, if known; its times need not be those of the log."""
    landmark_truth: LandmarkMap | None = None
    """Where the landmarks really are, if known."""

    def __post_init__(self) -> None:
        sizes = {"drive": 2, "compose": 3, "custom": self.control.shape[-1]}
        if self.motion not in sizes:
            raise LogError(
                f"{self.name}: motion: expected one of {', '.join(sizes)}, found {self.motion!r}"
            )
        steps, seen = len(self.control), len(self.observation)
        size = sizes[self.motion]
        shapes = {
            "start": (3,),
            "time": (steps + 1,),
            "control": (steps, size),
            "control_covariance": (steps, size, size),
            "observation_pose": (seen,),
            "observation": (seen, 2),
            "observation_covariance": (seen, 2, 2),
            "landmark": (seen,),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise LogError(f"{self.name}: {name}: expected shape {shape}, found {array.shape}")
            if not np.isfinite(array).all():
                raise LogError(f"{self.name}: {name}: expected finite numbers, found NaN")
        for name, ordered in (("time", self.time), ("observation_pose", self.observation_pose)):
            if (np.diff(ordered) < 0).any():
                row = int(np.argmax(np.diff(ordered) < 0)) + 1
                raise LogError(f"{self.name}: {name}: goes back at entry {row}; sort the log")
        if seen > 0 and not 0 <= self.observation_pose[0] <= self.observation_pose[-1] <= steps:
            raise LogError(f"{self.name}: observation_pose: expected numbers from 0 to {steps}")

    def __repr__(self) -> str:
        return (
            f"LandmarkLog({self.name}: {len(self.control)} controls, "
            f"{len(self.observation)} observations)"
        )


@dataclass(frozen=True, eq=False, repr=False)
class FixationTable:
    """Where people looked, one row per fixation."""

    image: npt.NDArray[np.str_]
    """(n,) file name of the image."""
    viewer: IntArray
    """(n,) who looked."""
    index: IntArray
    """(n,) 0 for the first fixation of a viewer on an image."""
    xy: FloatArray
    """(n, 2) place in image pixels."""

    def __len__(self) -> int:
        return len(self.image)

    def __repr__(self) -> str:
        return f"FixationTable({len(self)} fixations on {len(np.unique(self.image))} images)"
