"""Frames of a camera as they come."""

from collections.abc import Callable
from threading import Condition, Thread
from time import monotonic
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.io.image import quiet_opencv
from saccade.io.video import is_video, open_video

USUAL_RATE = 30.0
"""Frames per second of a camera that does not tell its own."""
TIMEOUT = 10.0
"""Seconds without a frame after which a camera has ended."""
POLL = 0.1
"""Seconds between two looks at whether to stop."""


class LiveVideo:
    """A camera, or a video file in its place, whose frames are taken one by one.

    Of a camera the latest frame is taken, and those that came before it are dropped. Of a video
    file each frame is taken in turn.

    A context manager: the camera is released at its end.

    Args:
        source: number of a device, an address such as rtsp://..., or a video file.
        stopped: asked while waiting for a frame; once it is true, there are no more.

    Raises:
        ImageError: the source cannot be opened, or gives no frame.
    """

    def __init__(self, source: str, stopped: Callable[[], bool] = lambda: False) -> None:
        self.name = f"camera {source}"
        self.dropped = 0
        """Number of frames that came while others were processed."""
        self._is_file, self._stopped = is_video(source) and "://" not in source, stopped
        self._capture = open_video(source) if self._is_file else _open_device(source)
        decoded, frame = self._capture.read()
        if not decoded:
            self._capture.release()
            raise ImageError(
                f"{self.name}: expected a camera, an address or a video, found no frame"
            )
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.rate = rate if 0.1 <= rate <= 1000 else USUAL_RATE
        """Frames per second."""
        self._frame, self._time, self._number, self._taken = frame, 0.0, 0, -1
        self._begin, self._ended, self._arrived = monotonic(), False, Condition()
        self._reader = Thread(target=self._read_on, name="saccade-camera", daemon=True)
        if not self._is_file:
            self._reader.start()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame."""
        height, width = self._frame.shape[:2]
        return width, height

    def read(self) -> tuple[float, npt.NDArray[np.uint8]] | None:
        """The next frame.

        Returns:
            Seconds since the first frame, and the frame (H, W, 3) in RGB; None at the end.
        """
        if self._is_file and self._taken == self._number:
            self._advance()
        deadline = monotonic() + TIMEOUT
        with self._arrived:
            while self._taken == self._number:
                if self._ended or self._stopped() or monotonic() > deadline:
                    return None
                self._arrived.wait(POLL)
            if self._stopped():
                return None
            self.dropped += self._number - self._taken - 1
            self._taken = self._number
            return self._time, np.ascontiguousarray(self._frame[:, :, ::-1], np.uint8)

    def close(self) -> None:
        """Release the camera."""
        self._ended = True
        if self._reader.is_alive():
            self._reader.join(TIMEOUT)
        self._capture.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _advance(self) -> None:
        decoded, frame = self._capture.read()
        with self._arrived:
            if decoded:
                self._number += 1
                self._frame = frame
                seconds = monotonic() - self._begin
                self._time = self._number / self.rate if self._is_file else seconds
            else:
                self._ended = True
            self._arrived.notify_all()

    def _read_on(self) -> None:
        while not self._ended:
            self._advance()


def _open_device(source: str) -> cv2.VideoCapture:
    with quiet_opencv():
        if source.isascii() and source.isdecimal() and len(source) < 4:
            return cv2.VideoCapture(int(source))
        return cv2.VideoCapture(source)
