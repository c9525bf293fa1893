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
from saccade.visual.frontend import Detector, Followed, View, look
from saccade.visual.optical_flow import BoolArray, ByteArray, follow
from saccade.visual.selection import attend


@dataclass(frozen=True, eq=False)
class Glance:
    """A frame, read and perhaps searched for points."""

    view: View
    found: Followed | None
    """Points, none of which is a landmark yet; None where they were not searched for."""
    remarks: tuple[str, ...]
    """What was wrong with it, in sentences."""
    seconds: dict[str, float]
    """Where the time went, by step."""


class Glancing:
    """Reads the frames of a drive, and finds the points of one in `every`.

    Args:
        drive: the frames.
        config: how to look.
    """

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        self._drive, self._every = drive, config.every
        self._detect = Detector(config, drive.camera)

    def __call__(self, number: int) -> Glance:
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
        view, found = look(frame, drive.camera), None
        read = perf_counter()
        if number % self._every == 0 and not view.blind:
            found = self._detect(view, number)
        seconds = {"read": read - start, "detect": perf_counter() - read}
        return Glance(view, found, remarks, seconds)


T = TypeVar("T")
Key = TypeVar("Key")
Ways = dict[bytes, tuple[Float32Array, bool]]
"""Where points of one image are in another and whether each was found, by where they begin."""


@dataclass
class Memory:
    """What runs over the same frames, with other choices and budgets, need not work out anew.

    It holds all frames of the drive, and grows with what is looked at.
    """

    glances: dict[tuple[str, int, int, int], Glance] = field(default_factory=dict)
    """By detector, number of points, frames between detections, and frame."""
    saliency: dict[tuple[str, int], FloatMap | None] = field(default_factory=dict)
    """By kind and frame."""
    ways: dict[tuple[int, int], Ways] = field(default_factory=dict)
    """By the identity of both images, which `glances` keep alive."""


class Senses:
    """Looks at frames, detects points, follows them, and attends to what is salient.

    Args:
        drive: the frames.
        config: how to look.
        memory: of earlier runs over the same frames with the same camera.
    """

    def __init__(self, drive: Drive, config: VisualConfig, memory: Memory | None = None) -> None:
        self._config, self._memory = config, memory
        self._glance = Glancing(drive, config)

    def glance(self, number: int) -> Glance:
        """A frame, read and perhaps searched for points."""
        if self._memory is None:
            return self._glance(number)
        config = self._config
        key = config.detector, config.points, config.every, number
        return _once(self._memory.glances, key, lambda: self._glance(number))

    def attend(self, view: View, number: int) -> FloatMap | None:
        """(h, w) saliency of a frame; None where the choice does not ask for it."""
        image = view.frame.image
        if image is None or self._memory is None:
            return None if image is None else attend(image, self._config)
        key = self._config.selection, number
        return _once(self._memory.saliency, key, lambda: attend(image, self._config))

    def follow(
        self, before: ByteArray, now: ByteArray, xy: Float32Array, guess: Float32Array | None = None
    ) -> tuple[Float32Array, BoolArray]:
        """As `optical_flow.follow`: each point for itself, so that each need be followed once."""
        if self._memory is None or len(xy) == 0:
            return follow(before, now, xy, guess)
        known = self._memory.ways.setdefault((id(before), id(now)), {})
        start = np.concatenate([xy, xy if guess is None else guess], 1)
        keys = [row.tobytes() for row in start]
        new = [i for i, key in enumerate(keys) if key not in known]
        if new:
            there, found = follow(before, now, xy[new], None if guess is None else guess[new])
            for i, place, ok in zip(new, there, found.tolist(), strict=True):
                known[keys[i]] = place, ok
        places, oks = zip(*(known[key] for key in keys), strict=True)
        return np.array(places), np.array(oks)


def _once(kept: dict[Key, T], key: Key, work_out: Callable[[], T]) -> T:
    """What is kept under a key, worked out where nothing is."""
    if key not in kept:
        kept[key] = work_out()
    return kept[key]
