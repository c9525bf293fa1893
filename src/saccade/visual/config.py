"""How a drive is looked at and mapped."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from saccade.errors import require

Selection: TypeAlias = Literal[
    "strength",
    "random",
    "range",
    "contrast",
    "symmetry",
    "rematch-rate",
    "rematch-rate-range",
    "rematch-rate-spread",
]
"""How the points that become landmarks may be chosen."""
DetectorName: TypeAlias = Literal["sift", "must", "symroid"]
"""What finds them."""
SELECTIONS, DETECTORS = get_args(Selection), get_args(DetectorName)


@dataclass(frozen=True)
class VisualConfig:
    """How camera frames and odometry become a map."""

    detector: DetectorName = "sift"
    """What finds points that may become landmarks."""
    selection: Selection = "rematch-rate-range"
    """Which of them do: the strongest, any, those whose range is known best, the most salient by
    contrast or by symmetry, or those that were known again most surely while they were followed;
    of these with a sure range, or far from other landmarks in the image."""
    new_per_frame: int = 8
    """Landmarks that a frame may add, on average."""
    max_tracked: int = 20
    """Landmarks that are followed at a time; where as many are, none is added."""
    max_landmarks: int = 500
    """That the map holds at most."""
    detect_interval: int = 4
    """Frames from one in which points are detected and described to the next."""
    max_points: int = 400
    """Detected in such a frame at most."""
    max_tracks: int = 200
    """Points that are followed at a time: landmarks, and others that tell how the robot moves."""
    min_spacing: float = 12.0
    """Pixels between points that are followed."""
    range_limits: tuple[float, float] = (0.3, 100.0)
    """Metres within which a landmark is taken in."""
    relative_range_sigma: float = 0.15
    """A range is used if its standard deviation is under this share of it."""
    pixel_sigma: float = 0.5
    """Standard deviation of a followed point, in pixels."""
    disparity_sigma: float = 0.4
    """Standard deviation of a disparity, in pixels."""
    relative_depth_sigma: float = 0.02
    """Standard deviation of a depth image, as a share of the depth."""
    shared_error_sigma: tuple[float, float] = (0.01, 0.1)
    """What all sightings of a frame get wrong together, standard deviations: the share of
    the range, and degrees. Pitch, roll, calibration and the clock are in it."""
    persistence: float = 0.4
    """Seconds after which errors of the motion from frame to frame are forgotten (1 / e)."""
    relative_motion_sigma: tuple[float, float] = (0.01, 0.015)
    """Standard deviations of what the calibration gets wrong in the length of the way and in the
    turn, as shares of them: the same throughout a stretch of 10 m and a corner."""
    tilt_sigma: float = 0.5
    """Standard deviation of the pitch and roll of the camera, in degrees: the map is flat, and
    the bearing of what is far above or below the camera is wrong by a share of them."""
    height_sigma: float = 0.015
    """Standard deviation of the height of a single camera over the road, as a share of it."""
    gate: float = 0.99
    """Probability with which a landmark is met where the filter expects it; what is outside
    is another one, however much it looks like it."""
    ratio: float = 0.8
    """A landmark is recognized if its descriptor is nearer than this share of the next one's."""
    acceleration: tuple[float, float] = (2.0, 0.5)
    """Standard deviations of how the speed (m/s) and the turn rate (rad/s) change in a second:
    the last motion that was seen foretells the next one together with odometry."""
    huber: float = 2.0
    """Root of the normalized innovation squared beyond which a sighting counts less."""
    seed: int = 0
    """Of the selection at random."""

    def __post_init__(self) -> None:
        require(self.detector in DETECTORS, "detector", f"one of {DETECTORS}", self.detector)
        require(self.selection in SELECTIONS, "selection", f"one of {SELECTIONS}", self.selection)
        for name, least in (
            ("new_per_frame", 1),
            ("max_tracked", 4),
            ("max_tracks", 4),
            ("max_landmarks", 1),
            ("detect_interval", 1),
            ("max_points", 1),
        ):
            value = getattr(self, name)
            require(least <= value <= 10**5, name, f"{least} to 1e5", value)
        for name in (
            "min_spacing",
            "pixel_sigma",
            "disparity_sigma",
            "relative_depth_sigma",
            "huber",
            "height_sigma",
        ):
            value = getattr(self, name)
            require(0 < value < 1e6, name, "over 0, under 1e6", value)
        near, far = self.range_limits
        require(0 <= near < far, "range_limits", "two ascending numbers from 0", self.range_limits)
        require(
            0 < self.relative_range_sigma <= 1,
            "relative_range_sigma",
            "over 0, at most 1",
            self.relative_range_sigma,
        )
        require(0 < self.gate < 1, "gate", "a probability between 0 and 1", self.gate)
        require(0 < self.ratio <= 1, "ratio", "over 0, at most 1", self.ratio)
        for name in ("shared_error_sigma", "acceleration", "relative_motion_sigma"):
            value = getattr(self, name)
            require(min(value) >= 0 and len(value) == 2, name, "two numbers from 0", value)
        require(0 <= self.tilt_sigma < 45, "tilt_sigma", "0 to under 45", self.tilt_sigma)
        require(self.seed >= 0, "seed", "0 or more", self.seed)
