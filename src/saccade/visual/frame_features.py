"""Features of a frame that need no map: its points and its saliency."""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter
from typing import TypeVar

from saccade.errors import ImageError
from saccade.frames import Drive, Frame
from saccade.pyramid import FloatMap
from saccade.visual.config import VisualConfig
from saccade.visual.frontend import Detector
from saccade.visual.prepared_frame import PreparedFrame, prepare_frame
from saccade.visual.selection import selection_saliency
from saccade.visual.tracked_points import TrackedPoints

T = TypeVar("T")
Key = TypeVar("Key")


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


@dataclass
class FeatureCache:
    """Features that runs over the same frames with other settings share; grows with the frames."""

    features: dict[tuple[str, int, int, int], FrameFeatures] = field(default_factory=dict)
    """By detector, number of points, detection interval, and frame."""
    saliency: dict[tuple[str, int], FloatMap | None] = field(default_factory=dict)
    """By selection and frame."""


class FrameAnalyzer:
    """Reads the frames of a drive, detects points, and computes saliency.

    Args:
        drive: the frames.
        config: which points and which saliency.
        cache: of earlier runs over the same frames with the same camera.
    """

    def __init__(
        self, drive: Drive, config: VisualConfig, cache: FeatureCache | None = None
    ) -> None:
        self._drive, self._config, self._cache = drive, config, cache
        self._detect = Detector(config, drive.camera)

    def features(self, number: int) -> FrameFeatures:
        """A frame and its points; an empty frame where it cannot be read.

        Raises:
            DriveError: an image that is not of the size of the calibration.
        """
        if self._cache is None:
            return self._features(number)
        config = self._config
        key = config.detector, config.max_points, config.detect_interval, number
        return _cached(self._cache.features, key, lambda: self._features(number))

    def saliency(self, prepared: PreparedFrame, number: int) -> FloatMap | None:
        """(h, w) saliency of a frame; None where the selection does not use it."""
        image = prepared.frame.image
        if image is None:
            return None
        if self._cache is None:
            return selection_saliency(image, self._config)
        key = self._config.selection, number
        return _cached(self._cache.saliency, key, lambda: selection_saliency(image, self._config))

    def _features(self, number: int) -> FrameFeatures:
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


def _cached(stored: dict[Key, T], key: Key, compute: Callable[[], T]) -> T:
    if key not in stored:
        stored[key] = compute()
    return stored[key]
