"""Frames of a video or of a live camera, analyzed one by one, and what is drawn of them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from saccade.cli.options import CameraOptions, LiveOptions
from saccade.cli.output import print_message, progress_bar, stop_on_interrupt
from saccade.io.video import LiveVideo, read_video, video_rate, video_writer
from saccade.types import Image
from saccade.viewing.live import LiveImages

CAMERA = "camera"
"""Name of the files of a camera."""


@dataclass(frozen=True)
class Frames:
    """Frames to be analyzed."""

    source: str
    """The file, or the camera."""
    rate: float
    """Frames per second."""
    frames: Iterator[tuple[float, Image]]
    """Seconds and (H, W, 3) uint8."""
    show: LiveImages | None = None
    """Viewer of the frames."""


@contextmanager
def video_frames(path: Path, every: int = 1) -> Iterator[Frames]:
    """Every nth frame of a video file."""
    yield Frames(str(path), video_rate(path) / every, read_video(path, every))


@contextmanager
def camera_frames(live: CameraOptions) -> Iterator[Frames]:
    """The frames of a camera, which may be shown."""
    with opened(live) as video:
        shown = live.live or live.page
        show = LiveImages(video.name, in_browser=live.page) if shown else None
        frames = islice(iter(video.read, None), live.frames)
        yield Frames(video.name, video.rate, frames, show)


@contextmanager
def opened(camera: LiveOptions) -> Iterator[LiveVideo]:
    """The camera, which ends on Ctrl-C; says at the end how many frames were dropped."""
    with (
        stop_on_interrupt("stopping after this frame") as stopped,
        LiveVideo(str(camera.camera), stopped) as video,
    ):
        yield video
    if video.dropped:
        print_message(f"{video.name}: {video.dropped} frames came during others: dropped")


def make_film(
    frames: Frames, film: Path, analyze: Callable[[float, Image], tuple[Image, dict[str, Any]]]
) -> int:
    """Analyze each frame; write what is drawn of it, and show what the viewer gets of it.

    Returns:
        Their number.
    """
    done = 0
    with (
        progress_bar(Path(frames.source).name) as progress,
        video_writer(film, frames.rate) as write,
    ):
        for done, (time, image) in enumerate(frames.frames, start=1):
            drawn, layers = analyze(time, image)
            write(drawn)
            if frames.show is not None:
                frames.show(time, image, **layers)
            progress(done)
    return done
