"""What a frame shows by itself: its image, points, tracks and saliency; needs no map."""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter
from typing import TypeVar

import numpy as np

from saccade.errors import ImageError
from saccade.frames import Drive, Frame
from saccade.pyramid import FloatMap
from saccade.types import Float32Array
from saccade.visual.config import VisualConfig
from saccade.visual.frontend import Detector, PreparedFrame, TrackedPoints, prepare_frame
from saccade.visual.optical_flow import BoolArray, ByteArray, track_points
from saccade.visual.selection import selection_saliency


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """A frame, read and perhaps searched for points."""

    frame: PreparedFrame
    detected: TrackedPoints | None
    """Points, none of which is a landmark yet; None where they were not searched for."""
    remarks: tuple[str, ...]
    """What was wrong with it, in sentences."""
    seconds: dict[str, float]
    """Where the time went, by step."""


class FeatureExtractor:
    """Reads the frames of a drive, and finds the points of one in `detect_interval`.

    Args:
        drive: the frames.
        config: how to look.
    """

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        self._drive, self._detect_interval = drive, config.detect_interval
        self._detect = Detector(config, drive.camera)

    def __call__(self, number: int) -> FrameFeatures:
        """A frame; empty where it cannot be read.

        Raises:
            DriveError: an image that is not of the size of the calibration.
        """
        drive, start = self._drive, perf_counter()
        remarks: tuple[str, ...] = ()
        try:
            frame = drive.load(number)
        except ImageError as error:
            frame, remarks = Frame(float(drive.time[number])), (str(error),)
        view, found = prepare_frame(frame, drive.camera), None
        read = perf_counter()
        if number % self._detect_interval == 0 and not view.is_blank:
            found = self._detect(view, number)
        seconds = {"read": read - start, "detect": perf_counter() - read}
        return FrameFeatures(view, found, remarks, seconds)


T = TypeVar("T")
Key = TypeVar("Key")
Flows = dict[bytes, tuple[Float32Array, bool]]
"""Where points of one image are in another and whether each was found, by where they begin."""


@dataclass
class FeatureCache:
    """What runs over the same frames, with other choices and budgets, need not work out anew.

    It holds all frames of the drive, and grows with what is looked at.
    """

    features: dict[tuple[str, int, int, int], FrameFeatures] = field(default_factory=dict)
    """By detector, number of points, frames between detections, and frame."""
    saliency: dict[tuple[str, int], FloatMap | None] = field(default_factory=dict)
    """By kind and frame."""
    flows: dict[tuple[int, int], Flows] = field(default_factory=dict)
    """By the identity of both images, which `glances` keep alive."""


class FrameAnalyzer:
    """Looks at frames, detects points, follows them, and attends to what is salient.

    Args:
        drive: the frames.
        config: how to look.
        memory: of earlier runs over the same frames with the same camera.
    """

    def __init__(
        self, drive: Drive, config: VisualConfig, cache: FeatureCache | None = None
    ) -> None:
        self._config, self._cache = config, cache
        self._extract = FeatureExtractor(drive, config)

    def features(self, number: int) -> FrameFeatures:
        """A frame, read and perhaps searched for points."""
        if self._cache is None:
            return self._extract(number)
        config = self._config
        key = config.detector, config.max_points, config.detect_interval, number
        return _cached(self._cache.features, key, lambda: self._extract(number))

    def saliency(self, view: PreparedFrame, number: int) -> FloatMap | None:
        """(h, w) saliency of a frame; None where the choice does not ask for it."""
        image = view.frame.image
        if image is None or self._cache is None:
            return None if image is None else selection_saliency(image, self._config)
        key = self._config.selection, number
        return _cached(self._cache.saliency, key, lambda: selection_saliency(image, self._config))

    def track(
        self, before: ByteArray, now: ByteArray, xy: Float32Array, guess: Float32Array | None = None
    ) -> tuple[Float32Array, BoolArray]:
        """As `optical_flow.follow`: each point for itself, so that each need be followed once."""
        if self._cache is None or len(xy) == 0:
            return track_points(before, now, xy, guess)
        known = self._cache.flows.setdefault((id(before), id(now)), {})
        start = np.concatenate([xy, xy if guess is None else guess], 1)
        keys = [row.tobytes() for row in start]
        new = [i for i, key in enumerate(keys) if key not in known]
        if new:
            there, found = track_points(before, now, xy[new], None if guess is None else guess[new])
            for i, place, ok in zip(new, there, found.tolist(), strict=True):
                known[keys[i]] = place, ok
        places, oks = zip(*(known[key] for key in keys), strict=True)
        return np.array(places), np.array(oks)


def _cached(stored: dict[Key, T], key: Key, compute: Callable[[], T]) -> T:
    """What is kept under a key, worked out where nothing is."""
    if key not in stored:
        stored[key] = compute()
    return stored[key]
