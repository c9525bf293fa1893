"""Settings of visual SLAM."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from saccade.errors import Settings, require, setting

Selection: TypeAlias = Literal["strength", "random", "contrast", "symmetry", "rematch-rate-range"]
"""Criterion for the selection of landmarks."""
SELECTIONS = get_args(Selection)
EgomotionSource: TypeAlias = Literal["camera", "second-camera", "wheels"]
"""Source of the robot's motion."""
EGOMOTIONS = get_args(EgomotionSource)


@dataclass(frozen=True)
class VisualConfig(Settings):
    """Settings of visual SLAM.

    By default landmarks are selected by their re-match rate while tracked and by the certainty of
    their range. Only the selections "contrast" and "symmetry" use saliency.

    Raises:
        ConfigError: a setting outside its range.
    """

    selection: Selection = "rematch-rate-range"
    """Criterion by which tracked points become landmarks: detector response ("strength"), chance
    ("random"), saliency by contrast or by symmetry, or re-match rate while tracked, weighted by
    the certainty of the range."""
    new_per_frame: int = setting(8, 0, 1e5)
    """Maximum number of new landmarks per frame, on average; 0 for odometry without a map."""
    max_tracked: int = setting(20, 4, 1e5)
    """Maximum number of landmarks tracked at a time."""
    max_landmarks: int = setting(500, 1, 1e5)
    """Maximum number of landmarks in the map."""
    detect_interval: int = setting(4, 1, 1e5)
    """Interval of the detection of points, in frames."""
    max_points: int = setting(400, 1, 1e5)
    """Maximum number of points detected in a frame."""
    max_tracks: int = setting(200, 4, 1e5)
    """Maximum number of points tracked at a time, landmarks included."""
    egomotion: EgomotionSource = "camera"
    """Source of the robot's motion. "camera" combines visual and wheel odometry; tracked landmarks
    contribute to the motion, so only re-identified landmarks correct the pose. "wheels" and
    "second-camera" (see `measure_odometry`) use odometry alone, and every observation of a landmark
    corrects the pose; they need stereo or depth images. The filter estimates systematic errors of
    "wheels"."""
    window: int = setting(6, 2, 1000)
    """Number of frames in the sliding window of the bundle adjustment; with 2 each motion is
    estimated from two frames."""
    min_spacing: float = setting(12.0, above=0, maximum=1e6)
    """Minimum distance between tracked points, in pixels."""
    range_limits: tuple[float, float] = setting((0.3, 100.0), 0)
    """Minimum and maximum range of new landmarks, in meters."""
    relative_range_sigma: float = setting(0.15, above=0, maximum=1)
    """Maximum standard deviation of a usable range, as a fraction of the range."""
    pixel_sigma: float = setting(0.5, 1e-9, 1e6)
    """Standard deviation of a tracked point, in pixels."""
    disparity_sigma: float = setting(0.4, 1e-9, 1e6)
    """Standard deviation of a disparity, in pixels."""
    relative_depth_sigma: float = setting(0.02, 1e-9, 1e6)
    """Relative standard deviation of a depth image."""
    shared_range_sigma: float = setting(0.01, 0)
    """Standard deviation of the range error shared by all observations of a frame, as a fraction
    of the range; caused by pitch, roll and calibration."""
    shared_bearing_sigma_deg: float = setting(0.1, 0)
    """Standard deviation of the bearing error shared by all observations of a frame, in degrees;
    caused by calibration and clock offset."""
    correlation_time: float = setting(0.4, 1e-9, 1e6)
    """Correlation time of motion errors, in seconds."""
    relative_motion_sigma: tuple[float, float] = setting((0.003, 0.003), 0)
    """Relative standard deviations of distance and turn, for errors that are constant over 10 m and
    90 degrees. `CalibrationDrift` adds the errors that are constant over the drive."""
    tilt_sigma_deg: float = setting(0.5, 0, 45)
    """Minimum standard deviation of the camera's pitch and roll, in degrees. The map is flat, and
    tilt displaces points above or below the camera."""
    relative_height_sigma: float = setting(0.015, 1e-9, 1e6)
    """Relative standard deviation of the height of a single camera above the ground."""
    gate: float = setting(0.99, above=0, below=1)
    """Probability that a re-observed landmark is inside the validation gate."""
    ratio: float = setting(0.8, above=0, maximum=1)
    """Ratio of the distances to the nearest and second-nearest descriptor in the ratio test."""
    acceleration_sigma: tuple[float, float] = setting((2.0, 0.35), 0)
    """Standard deviations of the change of speed (m/s) and turn rate (rad/s) in a second, for the
    constant-velocity prior of the sliding window."""
    recover: bool = True
    """Whether kidnapping is detected, and a kidnapped robot is relocalized in its map."""
    huber: float = setting(2.0, 1e-9, 1e6)
    """Threshold of the Huber weight, in standard deviations of the innovation."""
    smooth: bool = True
    """Whether trajectory and map are smoothed at the end of a drive."""
    seed: int = setting(0, 0, 2**63)
    """Seed of the random order of candidates with equal scores."""

    def __post_init__(self) -> None:
        super().__post_init__()
        near, far = self.range_limits
        require(near < far, "range_limits", "two ascending numbers", self.range_limits)
