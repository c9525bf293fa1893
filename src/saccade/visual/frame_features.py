"""Features of single frames: gray images and detected points."""

from dataclasses import dataclass
from time import perf_counter

from saccade.errors import ImageError
from saccade.frames import Drive, Frame
from saccade.visual.config import VisualConfig
from saccade.visual.frontend import Detector
from saccade.visual.prepared_frame import PreparedFrame, prepare_frame
from saccade.visual.tables import TrackedPoints


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """A frame and the points detected in it."""

    frame: PreparedFrame
    detected: TrackedPoints | None
    """None where the frame is none of those in which points are detected."""
    remarks: list[str]
    """What was wrong with the frame, in sentences."""
    seconds: dict[str, float]
    """Time by step."""


class FeatureCache(dict[tuple[str, int, int, int], FrameFeatures]):
    """Features that runs over the same frames with other settings share; grows with the frames.

    By detector, number of points, detection interval, and frame.
    """


class FeatureExtractor:
    """Reads the frames of a drive, and detects points in one of `detect_interval`.

    Args:
        drive: the frames.
        config: which points.
        cache: of earlier runs over the same frames with the same camera.
    """

    def __init__(
        self, drive: Drive, config: VisualConfig, cache: FeatureCache | None = None
    ) -> None:
        self._drive, self._config, self._cache = drive, config, cache
        self._detect = Detector(config, drive.camera)

    def __call__(self, number: int) -> FrameFeatures:
        """A frame and its points; an empty frame where it cannot be read.

        Raises:
            DriveError: an image that is not of the size of the calibration.
        """
        if self._cache is None:
            return self._extract(number)
        config = self._config
        key = config.detector, config.max_points, config.detect_interval, number
        if key not in self._cache:
            self._cache[key] = self._extract(number)
        return self._cache[key]

    def _extract(self, number: int) -> FrameFeatures:
        start, remarks = perf_counter(), list[str]()
        try:
            frame = self._drive.load(number)
        except ImageError as error:
            frame, remarks = Frame(float(self._drive.time[number])), [str(error)]
        prepared, detected = prepare_frame(frame, self._drive.camera), None
        read = perf_counter()
        if number % self._config.detect_interval == 0 and not prepared.is_blank:
            detected = self._detect(prepared, number)
        seconds = {"read": read - start, "detect": perf_counter() - read}
        return FrameFeatures(prepared, detected, remarks, seconds)
