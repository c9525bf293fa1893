"""Frames out of videos and into them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.files import whole_file
from saccade.image import quiet_opencv
from saccade.types import Image

VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".webm")


def is_video(path: str | Path) -> bool:
    """Whether the suffix of a file is that of a video."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES


def read_video(path: str | Path, every: int = 1) -> Iterator[tuple[float, npt.NDArray[np.uint8]]]:
    """The frames of a video one by one.

    Args:
        path: any video that OpenCV reads.
        every: take one frame of so many.

    Yields:
        Seconds since the start, and the (H, W, 3) RGB frame.

    Raises:
        ImageError: the file is missing, or is no video.
    """
    if not Path(path).is_file():
        raise ImageError(f"{path}: cannot be read: no such file")
    rate, number = video_rate(path), 0
    with quiet_opencv():
        capture = cv2.VideoCapture(str(path))
    try:
        while capture.grab():
            if number % every == 0:
                whole, frame = capture.retrieve()
                if not whole:
                    break
                yield number / rate, np.ascontiguousarray(frame[:, :, ::-1], np.uint8)
            number += 1
    finally:
        capture.release()
    if number == 0:
        raise ImageError(f"{path}: expected a video, found no frame that can be decoded")


def video_rate(path: str | Path) -> float:
    """Frames per second of a video; 25 where it does not say."""
    with quiet_opencv():
        capture = cv2.VideoCapture(str(path))
    try:
        return capture.get(cv2.CAP_PROP_FPS) or 25.0
    finally:
        capture.release()


@contextmanager
def video_writer(path: str | Path, rate: float) -> Iterator[Callable[[Image], None]]:
    """A function that adds an (H, W, 3) uint8 RGB frame to an MP4 file.

    The file appears when the block ends well. All frames have the shape of the first.

    Args:
        path: the file to write.
        rate: frames per second.

    Raises:
        OutputError: the file cannot be written.
    """
    writers: list[cv2.VideoWriter] = []
    with whole_file(path) as temporary:

        def write(frame: Image) -> None:
            if not writers:
                size = (frame.shape[1], frame.shape[0])
                code = cv2.VideoWriter.fourcc(*"mp4v")
                writers.append(cv2.VideoWriter(str(temporary), code, rate, size))
            writers[0].write(np.ascontiguousarray(frame[:, :, ::-1]))

        try:
            yield write
        finally:
            for writer in writers:
                writer.release()
