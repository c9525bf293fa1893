"""Reads and writes videos, and reads live cameras."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Condition, Thread
from time import monotonic
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.io.files import VIDEO_SUFFIXES, atomic_write, check_file, open_file, reading
from saccade.io.image import quiet_opencv
from saccade.types import FloatArray, Image

if TYPE_CHECKING:
    import cv2

USUAL_RATE = 30.0
"""Frames per second of a camera or video without a known rate."""
IMAGE_SIGNATURES = {
    b"\x89PNG": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"BM": "BMP",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
}
"""First bytes of images, which OpenCV would read as videos of one frame."""


def is_video(path: str | Path) -> bool:
    """Whether a file has the suffix of a video."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES


def read_video(path: str | Path, every: int = 1) -> Iterator[tuple[float, npt.NDArray[np.uint8]]]:
    """Iterates over the frames of a video.

    Args:
        path: any video that OpenCV reads.
        every: interval of the frames.

    Yields:
        Seconds since the first frame, and the (H, W, 3) RGB frame.

    Raises:
        ImageError: the file is missing, or is no video.
    """
    capture, number = open_video(path), 0
    clock = FrameClock(capture)
    try:
        while capture.grab():
            time = clock.read()
            if number % every == 0:
                decoded, frame = capture.retrieve()
                if not decoded:
                    break
                yield time, _as_rgb(frame)
            number += 1
    finally:
        capture.release()
    if number == 0:
        raise ImageError(f"{path}: expected a video, found no frame that can be decoded")


class FrameClock:
    """Times of the frames of a capture, from the time stamps of the container.

    A frame without a later time stamp than the frame before it follows at the mean rate.
    """

    def __init__(self, capture: "cv2.VideoCapture") -> None:
        import cv2  # slow to import

        self._capture, self._rate = capture, capture.get(cv2.CAP_PROP_FPS) or USUAL_RATE
        self._stamp = cv2.CAP_PROP_POS_MSEC
        self._first = self._last = -np.inf

    def read(self) -> float:
        """Seconds since the first frame, of the frame that was grabbed last."""
        stamp = self._capture.get(self._stamp) / 1000
        if not self._last < stamp < np.inf:
            stamp = self._last + 1 / self._rate if self._last > -np.inf else 0.0
        if self._first == -np.inf:
            self._first = stamp
        self._last = stamp
        return float(round(stamp - self._first, 9))


def frame_times(path: str | Path) -> FloatArray:
    """(n,) seconds since the first frame, of each frame of a video.

    Raises:
        ImageError: the file is missing, or is no video.
    """
    capture, times = open_video(path), list[float]()
    clock = FrameClock(capture)
    try:
        while capture.grab():
            times.append(clock.read())
    finally:
        capture.release()
    if not times:
        raise ImageError(f"{path}: expected a video, found no frame that can be decoded")
    return np.array(times)


def rate_of(times: FloatArray) -> float:
    """Frames per second of frames at times (n,), by their median interval."""
    return 1 / float(np.median(np.diff(times))) if len(times) > 1 else USUAL_RATE


@contextmanager
def video_writer(path: str | Path, rate: float) -> Iterator[Callable[[Image], None]]:
    """Yields a function that appends an (H, W, 3) uint8 RGB frame to an MP4 file.

    The file appears when the block ends without an error. All frames must have equal shapes.

    Args:
        path: the file to write.
        rate: frames per second.

    Raises:
        OutputError: the file cannot be written.
    """
    import cv2  # slow to import

    writers: list[cv2.VideoWriter] = []
    with atomic_write(path) as temporary:

        def write(frame: Image) -> None:
            if not writers:
                size = (frame.shape[1], frame.shape[0])
                code = cv2.VideoWriter.fourcc(*"mp4v")
                with quiet_opencv():
                    writers.append(cv2.VideoWriter(str(temporary), code, rate, size))
            writers[0].write(np.ascontiguousarray(frame[:, :, ::-1]))

        try:
            yield write
        finally:
            for writer in writers:
                writer.release()
        if writers:
            _check_written(temporary)


class VideoFrames:
    """Random access to the frames of a video; fast in ascending order.

    Raises:
        ImageError: the file is missing, or is no video.
    """

    def __init__(self, path: str | Path) -> None:
        import cv2  # slow to import

        self.path = Path(path)
        self.times = frame_times(path)
        """(n,) seconds since the first frame, of each frame."""
        self.rate = rate_of(self.times)
        """Frames per second, by the median interval."""
        self._capture, self._next = open_video(path), 0
        self.declared = max(int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        """Number of frames in the header, which is too large in a truncated file."""
        self._count = len(self.times)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, number: int) -> npt.NDArray[np.uint8]:
        """(H, W, 3) RGB.

        Raises:
            ImageError: there is no such frame, or it cannot be decoded.
        """
        if not 0 <= number < self._count:
            raise ImageError(f"{self.path}: expected a frame below {self._count}, found {number}")
        if number < self._next - 1:  # backward seeking is inexact in some formats
            self._capture.release()
            self._capture, self._next = open_video(self.path), 0
        while self._next <= number and self._capture.grab():
            self._next += 1
        decoded, frame = self._capture.retrieve()
        if not decoded or self._next != number + 1:
            raise ImageError(f"{self.path}, frame {number}: cannot be decoded")
        return _as_rgb(frame)


def _as_rgb(frame: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    return np.ascontiguousarray(frame[:, :, ::-1], np.uint8)


def _check_written(path: Path) -> None:
    """Detects a full disk, which OpenCV does not report, by opening the finished video."""
    capture = open_video(path)
    if not capture.isOpened():
        raise OSError(None, "the video is cut short; is the disk full?", str(path))
    capture.release()


def open_video(path: str | Path) -> "cv2.VideoCapture":
    """Opens a file safely; OpenCV alone would open devices and expand name patterns.

    Raises:
        ImageError: there is no such file, or it is an image.
    """
    import cv2  # slow to import

    with reading(path, ImageError, "the name of a file", ValueError):
        check_file(Path(path))
        with open_file(Path(path)) as file:
            start = file.read(max(map(len, IMAGE_SIGNATURES)))
        for signature, kind in IMAGE_SIGNATURES.items():
            if start.startswith(signature):
                raise ImageError(f"{path}: expected a video, found a {kind} image of that name")
        with quiet_opencv():
            return cv2.VideoCapture(str(path))


FRAME_TIMEOUT = 10.0
"""Maximum time without a frame before a camera counts as ended, in seconds."""
POLL = 0.1
"""Interval between checks of the stop condition, in seconds."""


class LiveVideo:
    """A live camera, or a video file in its place.

    A camera yields its latest frame and drops earlier frames; a video file yields every frame. As a
    context manager, it releases the camera at the end.

    Args:
        source: number of a device, an address such as rtsp://..., or a video file.
        stopped: function polled while waiting; reading ends when it returns True.

    Raises:
        ImageError: the source cannot be opened, or yields no frame.
    """

    def __init__(self, source: str, stopped: Callable[[], bool] = lambda: False) -> None:
        self.name = f"camera {source}"
        self.dropped = 0
        """Number of frames dropped while others were processed."""
        import cv2  # slow to import

        self._is_file, self._stopped = is_video(source) and "://" not in source, stopped
        self._capture = open_video(source) if self._is_file else _open_device(source)
        self._clock = FrameClock(self._capture)
        decoded, frame = self._capture.read()
        self._clock.read()
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
        deadline = monotonic() + FRAME_TIMEOUT
        with self._arrived:
            while self._taken == self._number:
                if self._ended or self._stopped() or monotonic() > deadline:
                    return None
                self._arrived.wait(POLL)
            if self._stopped():
                return None
            self.dropped += self._number - self._taken - 1
            self._taken = self._number
            return self._time, _as_rgb(self._frame)

    def close(self) -> None:
        """Release the camera."""
        self._ended = True
        if self._reader.is_alive():
            self._reader.join(FRAME_TIMEOUT)
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
                self._time = self._clock.read() if self._is_file else seconds
            else:
                self._ended = True
            self._arrived.notify_all()

    def _read_on(self) -> None:
        while not self._ended:
            self._advance()


def _open_device(source: str) -> "cv2.VideoCapture":
    import cv2  # slow to import

    with quiet_opencv():
        if source.isascii() and source.isdecimal() and len(source) < 4:
            return cv2.VideoCapture(int(source))
        return cv2.VideoCapture(source)
