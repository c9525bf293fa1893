"""Images, and frames of a video or of a live camera, analyzed one by one."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

from saccade.cli.options import LiveOptions, SourceOptions
from saccade.cli.output import (
    INTERRUPTED,
    names_for,
    print_message,
    progress_bar,
    stop_on_interrupt,
    tracked,
)
from saccade.errors import OutputError, SaccadeError
from saccade.io.files import is_invalid_name
from saccade.io.video import LiveVideo, is_video, read_video, video_rate, video_writer
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


Row: TypeAlias = dict[str, Any]
"""Result of a file, for --json."""


def analyze_each(
    source: SourceOptions,
    out: Path,
    of_image: Callable[[Path, str], Row],
    of_frames: Callable[[Frames, str], Row],
    every: int = 1,
) -> tuple[list[Row], int]:
    """Analyze images and videos, or a camera; errors of single files do not stop the others.

    Ctrl-C stops after the image in progress.

    Args:
        source: the images and videos, or the camera.
        out: the output folder, for messages.
        of_image: gets an image and the unique name of its results, and returns its row.
        of_frames: the same for a video, or the camera.
        every: takes every nth frame of a video.

    Returns:
        The rows, and the exit code with which the command ends.

    Raises:
        SaccadeError: no file could be processed, or the results cannot be written.
    """

    def analyze(path: Path, name: str) -> Row:
        if not is_video(path):
            return of_image(path, name)
        frames = read_video(path, every)
        return of_frames(Frames(str(path), video_rate(path) / every, frames), name)

    paths = source.paths()
    if source.camera is not None:
        with camera_frames(source) as frames:
            return [of_frames(frames, CAMERA)], 0
    if len(paths) == 1:
        return [analyze(paths[0], paths[0].stem)], 0
    rows: list[Row] = []
    failed = 0
    with stop_on_interrupt("stopping after this image") as stopped:
        for path, name in tracked(names_for(paths).items(), f"{len(paths)} images", len(paths)):
            try:
                rows.append(analyze(path, name))
            except SaccadeError as error:
                if isinstance(error, OutputError) and not is_invalid_name(error):
                    raise
                failed += 1
                print_message(str(error))
            if stopped():
                break
    if failed and not rows:
        raise SaccadeError(f"none of {failed} images could be used")
    if failed:
        print_message(f"{failed} of {len(paths)} images left out; the others are in {out}")
    if stopped():
        print_message(f"stopped after {len(rows) + failed} of {len(paths)} images")
    return rows, INTERRUPTED if stopped() else int(failed > 0)


@contextmanager
def camera_frames(live: SourceOptions) -> Iterator[Frames]:
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
