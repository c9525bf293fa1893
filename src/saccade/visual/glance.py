"""What of a frame can be had before the frames before it are mapped."""

from dataclasses import dataclass
from time import perf_counter

from saccade.errors import ImageError
from saccade.frames import Drive, Frame
from saccade.visual.config import VisualConfig
from saccade.visual.frontend import Detector, Followed, View, look


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
