"""Reads and writes videos."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.io.files import VIDEO_SUFFIXES, atomic_write, check_file, reason_of, text_path
from saccade.io.image import quiet_opencv
from saccade.types import Image


def is_video(path: str | Path) -> bool:
    """Whether the suffix of a file is that of a video."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES


def read_video(path: str | Path, every: int = 1) -> Iterator[tuple[float, npt.NDArray[np.uint8]]]:
    """The frames of a video one by one.

    Args:
        path: any video that OpenCV reads.
        every: take one frame of this many.

    Yields:
        Seconds since the start, and the (H, W, 3) RGB frame.

    Raises:
        ImageError: the file is missing, or is no video.
    """
    rate, number = video_rate(path), 0
    capture = open_video(path)
    try:
        while capture.grab():
            if number % every == 0:
                decoded, frame = capture.retrieve()
                if not decoded:
                    break
                yield number / rate, np.ascontiguousarray(frame[:, :, ::-1], np.uint8)
            number += 1
    finally:
        capture.release()
    if number == 0:
        raise ImageError(f"{path}: expected a video, found no frame that can be decoded")


def video_rate(path: str | Path) -> float:
    """Frames per second of a video; 25 where unknown.

    Raises:
        ImageError: there is no such file.
    """
    capture = open_video(path)
    try:
        return capture.get(cv2.CAP_PROP_FPS) or 25.0
    finally:
        capture.release()


@contextmanager
def video_writer(path: str | Path, rate: float) -> Iterator[Callable[[Image], None]]:
    """A function that adds an (H, W, 3) uint8 RGB frame to an MP4 file.

    The file appears when the block ends without an error. All frames have the shape of the first.

    Args:
        path: the file to write.
        rate: frames per second.

    Raises:
        OutputError: the file cannot be written.
    """
    writers: list[cv2.VideoWriter] = []
    with atomic_write(path) as temporary:

        def write(frame: Image) -> None:
            if not writers:
                size = (frame.shape[1], frame.shape[0])
                code = cv2.VideoWriter.fourcc(*"mp4v")
                with quiet_opencv(), text_path(temporary) as name:
                    writers.append(cv2.VideoWriter(name, code, rate, size))
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
        self.path = Path(path)
        self.rate = video_rate(path)
        """Frames per second."""
        self._capture, self._next = open_video(path), 0
        self.declared = max(int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        """Number of frames in the header; too large in a truncated file."""
        while self._capture.grab():
            self._next += 1
        self._count = self._next
        self._next += 1  # past the end
        if self._count == 0:
            raise ImageError(f"{path}: expected a video, found no frame that can be decoded")

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, number: int) -> npt.NDArray[np.uint8]:
        """(H, W, 3) RGB.

        Raises:
            ImageError: there is no such frame, or it cannot be decoded.
        """
        if not 0 <= number < self._count:
            raise ImageError(f"{self.path}: expected a frame below {self._count}, found {number}")
        if number < self._next - 1:  # seeking backwards is not exact in every format
            self._capture.release()
            self._capture, self._next = open_video(self.path), 0
        while self._next <= number and self._capture.grab():
            self._next += 1
        decoded, frame = self._capture.retrieve()
        if not decoded or self._next != number + 1:
            raise ImageError(f"{self.path}, frame {number}: cannot be decoded")
        return np.ascontiguousarray(frame[:, :, ::-1], np.uint8)


def _check_written(path: Path) -> None:
    """Detect a full disk, which OpenCV does not report: it cannot open an unfinished video."""
    capture = open_video(path)
    if not capture.isOpened():
        raise OSError(None, "the video is cut short; is the disk full?", str(path))
    capture.release()


def open_video(path: str | Path) -> cv2.VideoCapture:
    """Open a file; OpenCV alone would open devices, and take a name for a pattern.

    Raises:
        ImageError: there is no such file.
    """
    try:
        check_file(Path(path))
    except (OSError, ValueError) as error:
        raise ImageError(f"{path}: cannot be read: {reason_of(error)}") from error
    with quiet_opencv(), text_path(Path(path)) as name:
        return cv2.VideoCapture(name)
