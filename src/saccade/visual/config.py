"""Settings of visual SLAM."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from saccade.errors import Settings, require, setting

Selection: TypeAlias = Literal["strength", "random", "contrast", "symmetry", "rematch-rate-range"]
"""Criteria by which points become landmarks."""
SELECTIONS = get_args(Selection)
EgomotionSource: TypeAlias = Literal["camera", "second-camera", "wheels"]
"""Sources of the motion of the robot."""
EGOMOTIONS = get_args(EgomotionSource)


@dataclass(frozen=True)
class VisualConfig(Settings):
    """Settings of visual SLAM: how camera frames and odometry become a map.

    By default landmarks are selected by their re-match rate while tracked and by how certain
    their range is. Saliency is used by the selections "contrast" and "symmetry" alone.

    Raises:
        ConfigError: a setting outside its range.
    """

    selection: Selection = "rematch-rate-range"
    """Which points become landmarks: those with the strongest response, any ("random"), the most
    salient by contrast or by symmetry, or those with the highest re-match rate while tracked and a
    certain range."""
    new_per_frame: int = setting(8, 0, 1e5)
    """Maximum number of new landmarks per frame, on average; 0 for odometry without a map."""
    max_tracked: int = setting(20, 4, 1e5)
    """Number of landmarks tracked at a time from which none is added."""
    max_landmarks: int = setting(500, 1, 1e5)
    """Maximum number of landmarks in the map."""
    detect_interval: int = setting(4, 1, 1e5)
    """Frames from one in which points are detected and described to the next."""
    max_points: int = setting(400, 1, 1e5)
    """Maximum number of points detected in a frame."""
    max_tracks: int = setting(200, 4, 1e5)
    """Maximum number of points tracked at a time: landmarks, and others for the egomotion."""
    egomotion: EgomotionSource = "camera"
    """Source of the motion: the camera, with odometry ("camera"), so that only re-identified
    landmarks correct the pose, since the pixels of the others have been used; or odometry alone,
    and every observation of a landmark corrects the pose. It is that of "wheels", whose systematic
    errors the filter estimates, or of a "second-camera" (see `measure_odometry`). Both ask for
    stereo or depth images."""
    window: int = setting(6, 2, 1000)
    """Number of frames whose poses and points are adjusted together; 2 estimates each motion from
    the last frame alone."""
    min_spacing: float = setting(12.0, above=0, maximum=1e6)
    """Pixels between tracked points."""
    range_limits: tuple[float, float] = setting((0.3, 100.0), 0)
    """Least and greatest range of a landmark when it is initialized, in meters."""
    relative_range_sigma: float = setting(0.15, above=0, maximum=1)
    """Largest standard deviation of a range that is used, as a fraction of the range."""
    pixel_sigma: float = setting(0.5, 1e-9, 1e6)
    """Standard deviation of a tracked point, in pixels."""
    disparity_sigma: float = setting(0.4, 1e-9, 1e6)
    """Standard deviation of a disparity, in pixels."""
    relative_depth_sigma: float = setting(0.02, 1e-9, 1e6)
    """Standard deviation of a depth image, as a fraction of the depth."""
    shared_range_sigma: float = setting(0.01, 0)
    """Standard deviation of the range error that all observations of a frame share, as a fraction
    of the range: pitch, roll and calibration."""
    shared_bearing_sigma_deg: float = setting(0.1, 0)
    """Standard deviation of the bearing error that they share, in degrees: calibration, clock."""
    correlation_time: float = setting(0.4, 1e-9, 1e6)
    """Seconds in which the correlation of motion errors falls to 1 / e."""
    relative_motion_sigma: tuple[float, float] = setting((0.003, 0.003), 0)
    """Standard deviations of errors of distance and turn, as fractions of them, constant over 10 m
    and 90 degrees, besides those constant over the drive (see `CalibrationDrift`)."""
    tilt_sigma_deg: float = setting(0.5, 0, 45)
    """Least standard deviation of the camera's pitch and roll, in degrees: the map is flat, and
    tilt displaces what is above or below the camera."""
    relative_height_sigma: float = setting(0.015, 1e-9, 1e6)
    """Standard deviation of the height of a single camera over the ground, as a fraction of it."""
    gate: float = setting(0.99, above=0, below=1)
    """Probability that a re-observed landmark is inside the validation gate."""
    ratio: float = setting(0.8, above=0, maximum=1)
    """Ratio test: distance to the nearest descriptor over that to the second."""
    acceleration_sigma: tuple[float, float] = setting((2.0, 0.35), 0)
    """Standard deviations of the change of speed (m/s) and turn rate (rad/s) in a second, of the
    constant-velocity prediction that is fused with odometry."""
    recover: bool = True
    """Whether a robot that is not where the filter believes it to be is noticed, and found again in
    the map."""
    huber: float = setting(2.0, 1e-9, 1e6)
    """Threshold of the Huber weight, as the root of the normalized innovation squared."""
    smooth: bool = True
    """Whether trajectory and map are smoothed at the end of a drive."""
    seed: int = setting(0, 0, 2**63)
    """Seed of the random order of equal candidates."""

    def __post_init__(self) -> None:
        super().__post_init__()
        near, far = self.range_limits
        require(near < far, "range_limits", "two ascending numbers", self.range_limits)
