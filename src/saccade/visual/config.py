"""Settings of visual SLAM."""

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
"""Criteria by which points become landmarks."""
DetectorName: TypeAlias = Literal["sift", "must", "symroid"]
"""Interest point detectors."""
SELECTIONS, DETECTORS = get_args(Selection), get_args(DetectorName)
REMATCH_SELECTIONS = frozenset({"rematch-rate", "rematch-rate-range", "rematch-rate-spread"})
"""Those that need the re-match rate of the tracked points."""

_MIN_COUNTS = {
    **dict.fromkeys(("new_per_frame", "max_landmarks", "detect_interval", "max_points"), 1),
    **dict.fromkeys(("max_tracked", "max_tracks"), 4),
}
_POSITIVE = (
    *("min_spacing", "pixel_sigma", "disparity_sigma", "relative_depth_sigma"),
    *("huber", "relative_height_sigma"),
)
_PAIRS = ("shared_error_sigma", "acceleration_sigma", "relative_motion_sigma")


@dataclass(frozen=True)
class VisualConfig:
    """Settings of visual SLAM: how camera frames and odometry become a map.

    By default landmarks are chosen by their re-match rate while they are tracked and by how
    certain their range is; saliency takes no part. It does with the selections "contrast" and
    "symmetry".

    Raises:
        ConfigError: a setting outside its range.
    """

    detector: DetectorName = "sift"
    """Interest point detector."""
    selection: Selection = "rematch-rate-range"
    """Which points become landmarks: those with the strongest response, any ("random"), those with
    the most certain range, the most salient by contrast or by symmetry, or those with the highest
    re-match rate while tracked; of these with a certain range, or far from other landmarks in the
    image ("spread")."""
    new_per_frame: int = 8
    """New landmarks per frame, on average, at most."""
    max_tracked: int = 20
    """Landmarks that are tracked at a time; none is added where as many are."""
    max_landmarks: int = 500
    """Landmarks in the map, at most."""
    detect_interval: int = 4
    """Frames from one in which points are detected and described to the next."""
    max_points: int = 400
    """Points detected in a frame, at most."""
    max_tracks: int = 200
    """Points tracked at a time, at most: landmarks, and others from which the motion follows."""
    min_spacing: float = 12.0
    """Pixels between tracked points."""
    range_limits: tuple[float, float] = (0.3, 100.0)
    """Metres within which a landmark is initialized."""
    relative_range_sigma: float = 0.15
    """Largest standard deviation of a range that is used, as a fraction of it."""
    pixel_sigma: float = 0.5
    """Standard deviation of a tracked point, in pixels."""
    disparity_sigma: float = 0.4
    """Standard deviation of a disparity, in pixels."""
    relative_depth_sigma: float = 0.02
    """Standard deviation of a depth image, as a fraction of the depth."""
    shared_error_sigma: tuple[float, float] = (0.01, 0.1)
    """Standard deviations of the error that all observations of a frame share, as a fraction of
    the range and in degrees: pitch, roll, calibration and clock."""
    correlation_time: float = 0.4
    """Seconds in which the correlation of motion errors falls to 1 / e."""
    relative_motion_sigma: tuple[float, float] = (0.01, 0.015)
    """Standard deviations of calibration errors of distance and turn, as fractions of them,
    constant over 10 m and 90 degrees."""
    tilt_sigma: float = 0.5
    """Least standard deviation of the camera's pitch and roll, in degrees: the map is flat, and
    tilt displaces what is above or below the camera."""
    relative_height_sigma: float = 0.015
    """Standard deviation of the height of a single camera over the ground, as a fraction of it."""
    gate: float = 0.99
    """Probability of the validation gate: a re-observed landmark is inside with it."""
    ratio: float = 0.8
    """Ratio test: distance to the nearest descriptor over that to the second."""
    acceleration_sigma: tuple[float, float] = (2.0, 0.5)
    """Standard deviations of the change of speed (m/s) and turn rate (rad/s) in a second, of the
    constant-velocity prediction that is fused with odometry."""
    huber: float = 2.0
    """Threshold of the Huber weight, as the root of the normalized innovation squared."""
    seed: int = 0
    """Of the random order of equal candidates."""

    def __post_init__(self) -> None:
        require(self.detector in DETECTORS, "detector", f"one of {DETECTORS}", self.detector)
        require(self.selection in SELECTIONS, "selection", f"one of {SELECTIONS}", self.selection)
        for name, least in _MIN_COUNTS.items():
            value = getattr(self, name)
            require(least <= value <= 10**5, name, f"{least} to 1e5", value)
        for name in _POSITIVE:
            value = getattr(self, name)
            require(0 < value < 1e6, name, "over 0, under 1e6", value)
        for name in ("relative_range_sigma", "ratio"):
            value = getattr(self, name)
            require(0 < value <= 1, name, "over 0, at most 1", value)
        for name in _PAIRS:
            value = getattr(self, name)
            require(min(value) >= 0 and len(value) == 2, name, "two numbers from 0", value)
        near, far = self.range_limits
        require(0 <= near < far, "range_limits", "two ascending numbers from 0", self.range_limits)
        require(0 < self.gate < 1, "gate", "a probability between 0 and 1", self.gate)
        require(0 <= self.tilt_sigma < 45, "tilt_sigma", "0 to under 45", self.tilt_sigma)
        require(self.seed >= 0, "seed", "0 or more", self.seed)

    @property
    def counts_rematches(self) -> bool:
        """Whether the selection needs the re-match rate of tracked points."""
        return self.selection in REMATCH_SELECTIONS
