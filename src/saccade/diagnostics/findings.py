"""The findings of checks and runs: a table, and the results that refer to it."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

from saccade.types import IntArray

Severity: TypeAlias = Literal["error", "warning", "note"]
"""An "error" makes the map unusable, a "warning" degrades it, a "note" is harmless."""
MAX_LISTED = 6
"""Maximum number of frame numbers listed in a message."""


class Kind(NamedTuple):
    """A kind of finding."""

    severity: Severity
    """Usual severity."""
    unit: str
    """Unit of the value."""
    defect: str
    """The defect in general, for the documentation."""
    advice: str
    """General advice; a finding may have a more specific one."""


SEE_PAGE = "See the page 'My map is wrong' of the documentation"
ROTATION = (
    "Check camera.rotation: it rotates vectors of the camera (x right, y down, z along the optical "
    "axis) into the robot's frame (x ahead, y left, z up)"
)
AXES = "Bearings are 0 straight ahead and positive to the left"
SCALE = "Check the baseline or the unit of depth, the focal length, and the diameter of the wheels"
FINDINGS = {
    "unreadable frames": Kind(
        *("error", "frames", "frames that cannot be read"),
        "Replace the files or the calibration, or leave the frames out",
    ),
    "black frames": Kind(
        *("warning", "frames", "frames that are black or uniformly gray"),
        "Check for a covered lens or a camera dropout; odometry alone bridges these frames",
    ),
    "blurred frames": Kind(
        *("warning", "frames", "frames with less than .4 of the median sharpness"),
        "Use a shorter exposure, or drive more slowly",
    ),
    "empty frames": Kind(
        *("warning", "frames", "frames with too few points to track"),
        "They yield no observations; odometry alone bridges them",
    ),
    "repeated frames": Kind(
        *("error", "frames", "exact copies of the previous frame"),
        "A step is lost in each, and tracks may continue at other points: remove the copies, start "
        "new tracks after them, and let odometry bridge the step",
    ),
    "motion": Kind(
        *("warning", "%", "images that determine the motion of the camera in too few steps"),
        "Check that the frames belong to one drive and are in order; check frame rate, exposure, "
        "blur and focal length",
    ),
    "files": Kind(
        *("warning", "remark", "defects that were repaired when the files were read"),
        "It was repaired on reading; check the recording for other errors",
    ),
    "assumptions": Kind(
        *("note", "remark", "values that no file has and that are assumed"),
        "Provide the assumed values, if they are known",
    ),
    "gaps": Kind(
        *("warning", "s", "missing frames"),
        "Odometry alone bridges them; check for a camera dropout",
    ),
    "uneven clock": Kind(
        *("warning", "%", "intervals between frames that vary"),
        "Use the times of exposure instead of arrival",
    ),
    "principal point": Kind(
        *("warning", "%", "a principal point far from the center of the image"),
        "Check whether the calibration is for images of a different size or crop",
    ),
    "field of view": Kind(
        *("warning", "deg", "an implausible focal length"),
        "Check whether the calibration is for images of a different size",
    ),
    "focal lengths": Kind(
        *("warning", "ratio", "focal lengths in x and y that differ"),
        "Check whether the images were resized in one direction",
    ),
    "disparity sign": Kind(
        *("warning", "%", "points that are further right in the right image"),
        "Check the rectification, and whether both images are synchronous",
    ),
    "rows": Kind(
        *("warning", "px", "points at different rows of the left and the right image"),
        "Rectify the images, or calibrate again",
    ),
    "camera rotation": Kind(
        *("error", "deg", "exchanged or reversed axes of the camera"),
        ROTATION,
    ),
    "camera yaw": Kind(
        *("warning", "deg", "a camera that is turned to a side"),
        "Turn camera.rotation by this angle",
    ),
    "camera pitch": Kind(
        *("warning", "deg", "a camera that is turned up or down"),
        "Turn camera.rotation by this angle",
    ),
    "camera position": Kind(
        *("warning", "m", "a camera at another distance ahead of the robot's origin"),
        "Check camera.position: it is the position of the camera in the robot's frame, not of the "
        "robot in the camera's",
    ),
    "no odometry": Kind(
        *("note", "steps", "odometry without translations"),
        "Provide odometry.csv if odometry was recorded",
    ),
    "turn": Kind(
        *("error", "correlation", "turns of odometry that are unrelated to those of the images"),
        "Check camera.rotation, the axes, and whether both belong to the same drive",
    ),
    "turn sign": Kind(
        *("error", "correlation", "turns of odometry in the opposite direction"),
        "Turns are positive to the left; change the sign of the turn, or check whether the images "
        "are mirrored",
    ),
    "clock lag": Kind(
        *("warning", "s", "a clock of odometry that is late or early"),
        "Correct the times of odometry by this",
    ),
    "turn scale": Kind(
        *("warning", "times", "turns of odometry that are too large or too small"),
        "Check the unit of the turn, the wheel base, and the focal length",
    ),
    "turn bias": Kind(
        *("warning", "deg/s", "a constant turn of odometry"),
        "This is the bias of a gyroscope; subtract it if it is known",
    ),
    "turn noise": Kind(
        *("warning", "rad", "errors of the turn that its covariance does not explain"),
        "Make the standard deviations larger",
    ),
    "translation noise": Kind(
        *("warning", "m", "errors of the translation that its covariance does not explain"),
        "Make the standard deviations larger",
    ),
    "standstill": Kind(
        *("warning", "%", "images that stand still while odometry moves"),
        "Check for frozen images, slipping wheels, or frames from a different time",
    ),
    "translation sign": Kind(
        *("error", "fraction", "images that move opposite to odometry"),
        "Check whether the camera faces backward (camera.rotation), whether the frames are in "
        "reverse, and the sign of the translation",
    ),
    "translation scale": Kind(
        *("warning", "times", "translations of odometry that are too long or too short"),
        SCALE,
    ),
    "odometry jump": Kind(
        *("error", "steps", "single steps of odometry that are far too fast"),
        "Leave these steps out, or give them large covariances",
    ),
    "odometry reset": Kind(
        *("error", "steps", "odometry that returns to its origin in a single step"),
        "Leave these steps out, or give them large covariances",
    ),
    "truth turns": Kind(
        *("error", "correlation", "a truth whose turns contradict the images"),
        "Check camera.rotation, the axes, and whether both belong to the same drive",
    ),
    "truth clock": Kind(
        *("warning", "s", "a clock of the truth that is late or early"),
        "Correct the times of the truth by this",
    ),
    "truth length": Kind(
        *("warning", "times", "lengths of the truth that contradict the images"),
        "Check the baseline or the unit of depth, the focal length, camera.rotation, and the scale "
        "of the truth",
    ),
    "truth jumps": Kind(
        *("warning", "poses", "a truth that jumps"),
        "These poses are left out of the errors; remove them from the truth",
    ),
    "truth heading": Kind(
        *("warning", "deg", "a truth whose heading at the start contradicts its path"),
        "Check the heading of the truth, in radians to the left of x; until then compare the "
        "errors after alignment only",
    ),
    "ellipses": Kind(
        *("warning", "%", "a truth that lies mostly outside the ellipses of the estimate"),
        "The covariances are too small, or the truth belongs to another drive or clock",
    ),
    "dropped frames": Kind(
        *("warning", "frames", "images that contradict the images before and after"),
        "They are left out; check the recording for garbled frames",
    ),
    "motion unknown": Kind(
        *("warning", "s", "images that do not determine the motion of a drive without odometry"),
        "Check for a covered lens, blank walls, or a focal length that is wrong",
    ),
    "motion by odometry": Kind(
        *("warning", "s", "a part of a drive that is bridged by odometry alone"),
        "Check for a covered lens, blank walls, or a focal length that is wrong",
    ),
    "moving objects": Kind(
        *("warning", "frames", "a part of the image that contradicts odometry"),
        "Only what agrees with odometry is used there",
    ),
    "contradiction": Kind(
        *("warning", "frames", "images and odometry that contradict each other"),
        "Check for slipping wheels, the clocks, the axes and the focal length",
    ),
    "divided images": Kind(
        *("warning", "frames", "images that are divided between two motions, without odometry"),
        "Check for a vehicle ahead and objects that pass; record odometry",
    ),
    "scale drift": Kind(
        *("warning", "%", "a single camera whose scale is not held"),
        "Turn more slowly, at a higher frame rate; odometry or stereo measures the scale",
    ),
    "no motion": Kind(
        *("warning", "%", "a camera that does not move"),
        "Without motion a single camera maps no landmarks",
    ),
    "not compared": Kind(
        *("note", "comparisons", "comparisons that the recording does not allow"),
        "Labels, ranges and bearings of landmarks that are observed again allow them",
    ),
    "sensor mounting": Kind(
        *("error", "nats", "a sensor at another pose on the robot"),
        "Give its pose, --sensor x,y,yaw or `LandmarkLog.sensor`",
    ),
    "degrees": Kind(
        *("error", "nats", "turns in degrees"),
        "Multiply them by pi / 180",
    ),
    "millimeters": Kind(
        *("error", "nats", "ranges in millimeters"),
        "Divide them by 1000",
    ),
    "odometry in millimeters": Kind(
        *("error", "nats", "odometry in millimeters beside ranges that are not"),
        "Divide its distances by 1000",
    ),
    "mirrored bearings": Kind(
        *("error", "nats", "bearings and turns of opposite signs"),
        "Both are positive to the left (counter-clockwise): change the sign of the bearings",
    ),
    "swapped axes": Kind(
        *("error", "nats", "swapped axes of the observations"),
        f"{AXES}: pi / 2 minus these",
    ),
    "turned sensor": Kind(
        *("error", "nats", "a frame of observations that is turned by a quarter or a half"),
        AXES,
    ),
    "motion order": Kind(
        *("error", "nats", "turn and translation of a step in the wrong order"),
        "The columns distance, turn turn first and then drive; forward, left are in the frame of "
        "the previous pose, before the turn",
    ),
    "absolute bearings": Kind(
        *("error", "nats", "bearings relative to the map"),
        "Subtract the heading of the robot",
    ),
    "lost steps": Kind(
        *("error", "nats", "odometry with lost steps"),
        "Keep every step of odometry, or sum the steps between two poses",
    ),
    "odometry gap": Kind(
        *("warning", "s", "a single step of odometry over a long time"),
        "Record odometry without gaps, or map the parts separately",
    ),
    "far ranges": Kind(
        *("warning", "m", "ranges that are far for a sensor"),
        "If ranges and odometry are in millimeters, divide both by 1000",
    ),
    "clock offset": Kind(
        *("error", "nats", "a clock of the observations that is late or early"),
        "Correct the times of the observations by this",
    ),
    "noise": Kind(
        *("error", "times", "standard deviations that are far too large or too small"),
        "Multiply them by this factor",
    ),
    "shared label": Kind(
        *("error", "m", "several landmarks with one label"),
        "Give each landmark a unique label, or leave uncertain labels empty",
    ),
    "labels change": Kind(
        *("error", "s", "labels that change during the log"),
        "Give a landmark the same label in all of the log, or map its parts separately",
    ),
    "map": Kind("warning", "observations", "a map that contradicts itself", SEE_PAGE),
    "unused": Kind("warning", "observations", "many observations that are not used", SEE_PAGE),
    "lost": Kind("warning", "s", "a run that ends lost", SEE_PAGE),
    "moved": Kind(
        *("warning", "m", "a robot that was carried away and found again"),
        "Check what happened there; the trajectory in between is uncertain",
    ),
    "corrected": Kind(
        *("note", "m", "odometry that slipped or lost steps, by the labels of landmarks"),
        "Check the odometry before these times, where the trajectory is uncertain",
    ),
    "tag size": Kind(
        *("warning", "%", "tags of another size than declared"),
        "Measure the side of the black square",
    ),
    "focal length": Kind(
        *("warning", "%", "a focal length that contradicts the tags"),
        "Calibrate the camera",
    ),
    "consistency": Kind("warning", "NIS", "innovations that are too large or one-sided", SEE_PAGE),
    "scale": Kind(
        *("warning", "%", "odometry and ranges of different scales"),
        "Give a known distance: a surveyed map (--map); or declare the usual errors of the sensor "
        'in the log, as "# range_errors: 0.01, 0.02"',
    ),
    "duplicate labels": Kind(
        "warning", "landmarks", "landmarks with the label of another landmark", SEE_PAGE
    ),
    "duplicate positions": Kind(
        "warning", "landmarks", "landmarks at the position of another landmark", SEE_PAGE
    ),
}
"""Every kind of finding by its name."""


@dataclass(frozen=True)
class Finding:
    """A defect of a drive."""

    severity: Severity
    check: str
    """Name of the check that found it."""
    what: str
    """The defect in one sentence, with its value."""
    advice: str
    """Advice to the user."""
    value: float
    """Size of the defect."""
    unit: str
    """Unit of the value."""
    frames: tuple[int, ...] = ()
    """Affected frames; empty if the defect concerns the whole drive."""

    @classmethod
    def of(
        cls,
        check: str,
        what: str,
        value: float,
        *,
        advice: str | None = None,
        severity: Severity | None = None,
        unit: str | None = None,
        frames: tuple[int, ...] = (),
    ) -> "Finding":
        """A finding of a kind in `FINDINGS`, whose row has what is not given."""
        kind = FINDINGS[check]
        return cls(
            severity or kind.severity,
            check,
            what,
            advice or kind.advice,
            float(value),
            unit or kind.unit,
            frames,
        )

    @classmethod
    def in_frames(cls, check: str, what: str, frames: IntArray) -> "Finding":
        """A defect of single frames; its value is the number of frames."""
        numbers = tuple(frames.tolist())
        return cls.of(check, what, len(numbers), frames=numbers)

    def __str__(self) -> str:
        first, n = ", ".join(map(str, self.frames[:MAX_LISTED])), len(self.frames)
        more = f", ... {n} in all" if n > MAX_LISTED else ""
        frames = f" (frame{'s' if n > 1 else ''} {first}{more})" if n else ""
        return f"{self.what[:1].upper()}{self.what[1:]}{frames}. {self.advice}."


@dataclass(frozen=True)
class CheckReport:
    """Findings and measurements of a drive."""

    name: str
    """Name of the drive."""
    frames: int
    """Number of frames of the drive."""
    inspected: int
    """Number of frames inspected."""
    findings: tuple[Finding, ...]
    """Findings, most severe first."""
    figures: dict[str, Any]
    """Measurements by name; the suffix of a name is the unit."""

    @property
    def clean(self) -> bool:
        """Whether there are neither errors nor warnings."""
        return all(finding.severity == "note" for finding in self.findings)

    def __repr__(self) -> str:
        return f"CheckReport({self.name}: {len(self.findings)} findings)"


def counted(n: int, one: str, several: str) -> str:
    """A number and its noun in singular or plural: "1 frame is", "2 frames are"."""
    return f"{n} {one if n == 1 else several}"
