"""The data types shared by the packages: immutable records of arrays.

Image points are (x, y) with the center of the top-left pixel at (0, 0); arrays are indexed
[row, column]. On the ground x and y are meters, angles radians in (-pi, pi], counter-clockwise
from the x axis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError, KeypointsError, LogError
from saccade.landmark_names import name_texts, number_names
from saccade.motions import RELATIVE, Motion, find_motion
from saccade.pictured import Pictured


def check_arrays(
    record: Any,
    shapes: Mapping[str, tuple[int, ...]],
    ascending: Sequence[str],
    error: type[LogError | DriveError],
    partial: Sequence[str] = (),
) -> None:
    """Raises `error` unless the arrays of a named record have the given shapes and are finite.

    Args:
        record: has a `name`, for the message.
        shapes: by name of the array.
        ascending: names of arrays that must not decrease.
        error: to raise.
        partial: names of arrays in whose rows some, but not all, numbers may be NaN.
    """
    for name, shape in shapes.items():
        array = getattr(record, name)
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "iuf":
            found = " ".join(repr(array).split())[:60]
            raise error(f"{record.name}: {name}: expected an array of numbers, found {found}")
        if array.shape != shape:
            raise error(f"{record.name}: {name}: expected shape {shape}, found {array.shape}")
        finite = np.isfinite(array)
        if name in partial:
            finite = (finite | np.isnan(array)) & finite.any(1, keepdims=True)
        if not finite.all():
            raise error(f"{record.name}: {name}: expected finite numbers, found NaN")
    for name in ascending:
        decreases = np.diff(getattr(record, name)) < 0
        if decreases.any():
            entry = int(np.argmax(decreases)) + 1
            raise error(f"{record.name}: {name}: goes back at entry {entry}; sort by {name}")


def invalid_range_bearing(z: npt.NDArray[np.float64]) -> tuple[int, str, str] | None:
    """The first invalid range or bearing among observations (k, 2).

    Returns:
        Row, expected value and found value; None if all are valid.
    """
    for k, (distance, bearing) in enumerate(z.tolist()):
        if distance < 0:
            return k, "a range of 0 m or more", f"{distance:g}"
        if abs(bearing) > 2 * np.pi:
            hint = "degrees? Multiply bearings, turns and headings by pi / 180"
            return k, "a bearing in radians, within 2 pi", f"{bearing:g}: {hint}"
    return None


class Table:
    """Base class of column tables: arrays (n, ...), or None for unknown columns."""

    def __len__(self) -> int:
        return len(self._columns()[0])

    def __getitem__(self, index: slice | npt.NDArray[Any]) -> Self:
        """The rows of a slice, a mask or an array of indices."""
        return type(self)(*(each if each is None else each[index] for each in self._columns()))

    @classmethod
    def concatenate(cls, tables: Sequence[Self]) -> Self:
        """The rows of one or more tables."""
        columns = zip(*(table._columns() for table in tables), strict=True)
        return cls(*(np.concatenate(column) for column in columns))

    @classmethod
    def zeros(cls, n: int, **columns: npt.NDArray[Any]) -> Self:
        """A table of n rows, with zeros in columns that are not given."""
        empty = {each.name: getattr(cls(), each.name) for each in fields(cast("Any", cls))}
        blank = {k: np.zeros((n, *each.shape[1:]), each.dtype) for k, each in empty.items()}
        return cls(**blank | columns)

    def _columns(self) -> list[npt.NDArray[Any]]:
        return [getattr(self, each.name) for each in fields(cast("Any", self))]


def column(*shape: int, dtype: npt.DTypeLike = np.float64) -> Any:
    """Field of a `Table` whose rows have a shape and a type; empty by default."""
    return field(default_factory=lambda: np.zeros((0, *shape), dtype))


Image: TypeAlias = npt.NDArray[Any]
"""(H, W), (H, W, 3) RGB or (H, W, 4) RGBA; uint8, uint16, bool, or float in [0, 1].

Pyramids of uint8 are rounded to integers at each level: saliency maps of a uint8 image and of the
same image as float32 differ by up to .01, with other types by less than .0005.
"""

FloatArray: TypeAlias = npt.NDArray[np.float64]
Float32Array: TypeAlias = npt.NDArray[np.float32]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

THREE_SIGMA_2D = 11.829
"""Squared Mahalanobis distance that encloses 99.73 % of a Gaussian on the plane (3 sigma)."""


@dataclass(frozen=True, eq=False, repr=False)
class Keypoints(Table, Pictured):
    """Keypoints of one image, normally in order of decreasing strength."""

    xy: Float32Array
    """(n, 2) position in image pixels."""
    size: Float32Array
    """(n,) diameter in image pixels, as OpenCV defines it."""
    angle: Float32Array
    """(n,) orientation in radians, from x towards y (clockwise on the screen)."""
    response: Float32Array
    """(n,) strength, in the unit of the detector."""
    octave: npt.NDArray[np.int32]
    """(n,) octave of the scale space: -1 is the doubled image, 0 the image itself, or unknown."""
    descriptors: npt.NDArray[np.uint8] | npt.NDArray[np.float32] | None = None
    """(n, 128) uint8, or float32 of unit length: 4 x 4 subregions, row by row in the frame of the
    angle, of 8 orientation bins from y towards x, in OpenCV's order. None if not computed."""

    @classmethod
    def at(cls, xy: npt.ArrayLike, size: npt.ArrayLike, angle: npt.ArrayLike = 0.0) -> "Keypoints":
        """Keypoints without response, octave and descriptors.

        Args:
            xy: (n, 2) position in image pixels.
            size: (n,) or one for all: diameter in image pixels, as OpenCV defines it.
            angle: (n,) or one for all: radians from x towards y.

        Raises:
            KeypointsError: other shapes.
        """
        positions = np.array(xy, np.float32)
        if positions.shape == (0,):
            positions = positions.reshape(0, 2)
        if positions.ndim != 2 or positions.shape[1] != 2:
            raise KeypointsError(f"xy: expected shape (n, 2), found {positions.shape}")
        n = len(positions)
        columns = {"size": np.array(size, np.float32), "angle": np.array(angle, np.float32)}
        for name, column in columns.items():
            if column.shape not in ((), (n,)):
                raise KeypointsError(f"{name}: expected shape ({n},), found {column.shape}")
        return cls(
            xy=positions,
            size=np.broadcast_to(columns["size"], n).copy(),
            angle=np.broadcast_to(columns["angle"], n).copy(),
            response=np.zeros(n, np.float32),
            octave=np.zeros(n, np.int32),
        )

    def __repr__(self) -> str:
        described = "without descriptors" if self.descriptors is None else "with descriptors"
        return f"Keypoints({len(self)} points, {described})"


@dataclass(frozen=True, eq=False, repr=False)
class Regions:
    """Regions of interest of one image, the strongest first."""

    keypoints: Keypoints
    """Their frames; the size of one that is described in its box is the mean side of the box."""
    boxes: Float32Array
    """(n, 4) left, top, right and bottom in image pixels."""

    @property
    def xy(self) -> Float32Array:
        """(n, 2) centers in image pixels."""
        return self.keypoints.xy

    @property
    def descriptors(self) -> npt.NDArray[np.uint8] | npt.NDArray[np.float32] | None:
        """(n, 128), as `Keypoints.descriptors`."""
        return self.keypoints.descriptors

    def __len__(self) -> int:
        return len(self.keypoints)

    def __repr__(self) -> str:
        return f"Regions({len(self)} regions)"


def check_pairs(pairs: IntArray, counts: tuple[int, int], name: str) -> None:
    """Raise `KeypointsError` unless `pairs` are (m, 2) indices below the `counts` of two images."""
    if not isinstance(pairs, np.ndarray):
        raise KeypointsError(
            f"{name}: expected an array (m, 2), found a {type(pairs).__name__}; use np.array(...)"
        )
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
class Scanpath(Table):
    """Fixations in temporal order."""

    xy: FloatArray
    """(n, 2) position in image pixels."""
    time: FloatArray
    """(n,) seconds since the onset of the image."""
    saliency: FloatArray
    """(n,) value of the saliency map at the fixation."""

    def __repr__(self) -> str:
        last = f", {self.time[-1]:.3f} s" if len(self) else ""
        return f"Scanpath({len(self)} fixations{last})"


@dataclass(frozen=True, eq=False, repr=False)
class ScanpathSamples:
    """Scanpaths of one length over one saliency map."""

    xy: FloatArray
    """(p, n, 2) positions in image pixels, path by path."""
    time: FloatArray
    """(p, n) onset of each fixation in seconds since the onset of the image."""
    duration: FloatArray
    """(p, n) of each fixation, in seconds."""
    saliency: FloatArray
    """(p, n) value of the saliency map at the fixation."""

    def __len__(self) -> int:
        return len(self.xy)

    def __getitem__(self, index: int) -> Scanpath:
        return Scanpath(self.xy[index], self.time[index], self.saliency[index])

    def __repr__(self) -> str:
        return f"ScanpathSamples({len(self)} paths of {self.xy.shape[1]} fixations)"


@dataclass(frozen=True, eq=False, repr=False)
class SymmetricPairs(Table):
    """Pairs of gradients on opposite sides of a position, the strongest first."""

    first: FloatArray
    """(n, 2) position of the first of each pair, in image pixels."""
    second: FloatArray
    """(n, 2) position of the second."""
    first_angle: FloatArray
    """(n,) direction of the first gradient in radians, from x towards y."""
    second_angle: FloatArray
    """(n,) direction of the second."""
    strength: FloatArray
    """(n,) contribution of the pair to the symmetry."""
    level: IntArray
    """(n,) pyramid level; 0 is the image."""

    def __repr__(self) -> str:
        return f"SymmetricPairs({len(self)} pairs)"


GAP_INTERVALS = 3.0
"""Minimum duration of a gap in a trajectory, in median intervals between poses."""
GAP_SECONDS = (0.55, 1.1)
"""Minimum and maximum of the gap threshold, in seconds."""
SAME_TIME = 0.01
"""Maximum time difference in seconds between a query and a pose that answers it."""


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """The poses of the robot in the frame of its map."""

    time: FloatArray
    """(t,) seconds; the number of the pose where the source has no clock."""
    pose: FloatArray
    """(t, 3) x and y in meters, heading in radians."""
    covariance: FloatArray | None = None
    """(t, 3, 3), or None if unknown."""

    def __len__(self) -> int:
        return len(self.time)

    def covers(self, time: FloatArray, longest: float = GAP_SECONDS[1]) -> BoolArray:
        """(n,) True for times with a pose, or with poses shortly before and after.

        Intervals above `longest` seconds are gaps, others if they are long among the intervals.
        """
        if len(self) == 0:
            return np.zeros(len(time), bool)
        limit = GAP_INTERVALS * float(np.median(np.diff(self.time))) if len(self) > 1 else 0.0
        after = np.searchsorted(self.time, time)
        last, first = (self.time[i.clip(0, len(self) - 1)] for i in (after - 1, after))
        is_gap = first - last > min(max(limit, GAP_SECONDS[0]), longest)
        is_at_pose = np.minimum(np.abs(time - last), np.abs(time - first)) <= SAME_TIME
        return np.asarray(is_at_pose | (last <= time) & (time <= first) & ~is_gap)

    def at(self, time: FloatArray) -> FloatArray:
        """(n, 3) poses at times (n,), linearly interpolated; NaN where `covers` is False."""
        poses = self.interpolate(time) if len(self) else np.zeros((len(time), 3))
        return np.where(self.covers(time)[:, None], poses, np.nan)

    def interpolate(self, time: FloatArray) -> FloatArray:
        """(n, 3) poses interpolated at times (n,), also across gaps; the end poses are held.

        Raises:
            ValueError: the trajectory has no poses.
        """
        x, y, heading = self.pose.T
        columns = [np.interp(time, self.time, values) for values in (x, y, np.unwrap(heading))]
        columns[2] = np.angle(np.exp(1j * columns[2]))
        return np.stack(columns, 1)

    @property
    def size(self) -> str:
        """Number of poses and length of the path."""
        length = float(np.hypot(*np.diff(self.pose[:, :2], axis=0).T).sum()) if len(self) else 0.0
        return f"{len(self)} poses, {length:.1f} m"

    def __repr__(self) -> str:
        return f"Trajectory({self.size})"


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkMap:
    """Positions of landmarks."""

    id: IntArray
    """(n,) name in the log, by its number (see `landmark_names`); the order of initialization where
    the log has none."""
    xy: FloatArray
    """(n, 2) meters, in the frame of the trajectory."""
    covariance: FloatArray | None = None
    """(n, 2, 2) square meters, or None if unknown."""
    observations: IntArray | None = None
    """(n,) number of observations of each."""
    text_names: tuple[str, ...] = ()
    """Names that are text; the number of the first is `landmark_names.FIRST_TEXT`."""

    @property
    def names(self) -> npt.NDArray[Any]:
        """(n,) name of each landmark: `id`, or text if any name is text."""
        return name_texts(self.id, self.text_names)

    def __len__(self) -> int:
        return len(self.id)

    def __repr__(self) -> str:
        return f"LandmarkMap({len(self)} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class MapSnapshot:
    """The map at one pose of a drive."""

    step: int
    """Number of the pose."""
    path: FloatArray
    """(m, 3) poses since the last snapshot, up to this one."""
    covariance: FloatArray
    """(3, 3) of this pose."""
    landmarks: FloatArray
    """(n, 2) meters."""
    landmark_covariance: FloatArray
    """(n, 2, 2) square meters."""
    observed: IntArray
    """(s,) rows of `landmarks` observed since the last snapshot."""
    ids: IntArray
    """(n,) number of landmarks initialized before each: the same in every snapshot."""
    hypotheses: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    """(h, 4) x, y, heading and probability of the hypotheses of a lost robot's pose."""

    def __repr__(self) -> str:
        return f"MapSnapshot(pose {self.step}, {len(self.landmarks)} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkLog:
    """Odometry and landmark observations: t controls between t + 1 poses, k observations.

    Raises:
        LogError: shapes that do not fit together, NaN, an order that goes back, or a landmark
            that is neither an integer from -1 on nor text.
    """

    name: str
    """The data set, for headings and messages."""
    start: FloatArray
    """(3,) initial pose."""
    time: FloatArray
    """(t + 1,) of each pose, in seconds; the number of the pose where the log has no clock."""
    control: FloatArray
    """(t, c) from pose i to pose i + 1; `motion` says what the numbers are."""
    control_covariance: FloatArray
    """(t, c, c)."""
    observation_pose: IntArray
    """(k,) number of the pose of each observation, ascending."""
    observation: FloatArray
    """(k, 2) range in meters and bearing in radians, in the sensor frame; NaN for an unmeasured
    component."""
    observation_covariance: FloatArray
    """(k, 2, 2); entries of a component that is NaN are ignored."""
    landmark: IntArray
    """(k,) name of the landmark as a number, -1 if unknown; text is numbered (see `names`)."""
    motion: str | Motion = RELATIVE
    """Kind of the controls, a name in `motions.MOTIONS`, or a `Motion`; by default relative
    poses."""
    odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviations of systematic odometry errors: the relative error of the distance, the
    turn in radians per meter of distance, and the distance in meters per radian of turn."""
    range_errors: tuple[float, float] = (0.0, 0.0)
    """Standard deviations of systematic errors of the ranges: relative error, and offset in
    meters. The range of a landmark at distance q is (1 + relative error) q + offset."""
    sensor: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of the sensor in the frame of the robot: meters ahead and to the left, radians to the
    left (see `plane.in_robot_frame`)."""
    truth: Trajectory | None = None
    """Ground truth, if known; its times may differ from the times of the log."""
    landmark_truth: LandmarkMap | None = None
    """True positions of the landmarks, if known."""
    text_names: tuple[str, ...] = ()
    """Names that are text; the number of the first is `landmark_names.FIRST_TEXT`."""

    def __post_init__(self) -> None:
        numbers = number_names(self.landmark, self.text_names, name=f"{self.name}: landmark")
        for field_name, value in zip(("landmark", "text_names"), numbers, strict=True):
            object.__setattr__(self, field_name, value)
        c = len(find_motion(self.motion, f"{self.name}: motion").columns)
        t, k = len(self.control), len(self.observation)
        shapes = {
            "start": (3,),
            "time": (t + 1,),
            "control": (t, c),
            "control_covariance": (t, c, c),
            "observation_pose": (k,),
            "observation": (k, 2),
            "observation_covariance": (k, 2, 2),
            "landmark": (k,),
        }
        ascending, partial = ("time", "observation_pose"), ("observation",)
        check_arrays(self, shapes, ascending, LogError, partial)
        if np.shape(self.sensor) != (3,) or not np.isfinite(self.sensor).all():
            raise LogError(
                f"{self.name}: sensor: expected x, y and yaw as finite numbers, "
                f"found {self.sensor!r}"
            )
        if k > 0 and not 0 <= self.observation_pose[0] <= self.observation_pose[-1] <= t:
            raise LogError(f"{self.name}: observation_pose: expected numbers from 0 to {t}")

    @property
    def aligned_truth(self) -> Trajectory | None:
        """The truth, if it is in the frame of `start`: it covers the first pose, with headings."""
        if self.truth is None or not self.truth.covers(self.time[:1])[0]:
            return None
        return self.truth if np.isfinite(self.truth.pose[:, 2]).all() else None

    @property
    def names(self) -> npt.NDArray[Any]:
        """(k,) landmark name of each observation: `landmark`, or text if any name is text."""
        return name_texts(self.landmark, self.text_names)

    def __repr__(self) -> str:
        return (
            f"LandmarkLog({self.name}: {len(self.control)} controls, "
            f"{len(self.observation)} observations)"
        )


@dataclass(frozen=True, eq=False, repr=False)
class FixationTable(Table):
    """Human fixations, one row each."""

    image: npt.NDArray[np.str_]
    """(n,) file of the image, relative to the folder of the images, with slashes."""
    subject: IntArray
    """(n,) number of the subject."""
    index: IntArray
    """(n,) number of the fixation of a subject on an image, from 0."""
    xy: FloatArray
    """(n, 2) position in image pixels."""
    duration: FloatArray | None = None
    """(n,) in seconds; None if unknown."""
    trial: IntArray | None = None
    """(n,) number of the trial of a subject on an image, from 0; None if each has one."""
    name: npt.NDArray[np.str_] | None = None
    """(n,) name of the subject in the file; None if unknown."""

    @property
    def scanpath(self) -> IntArray:
        """(n,) number of the scanpath, of one image, subject and trial, in the order of these."""
        image = np.unique(self.image, return_inverse=True)[1]
        trial = np.zeros_like(self.subject) if self.trial is None else self.trial
        keys = np.stack([image, self.subject, trial], axis=1)
        return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)

    def __repr__(self) -> str:
        return f"FixationTable({len(self)} fixations on {len(np.unique(self.image))} images)"
