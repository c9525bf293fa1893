"""Commands that take their frames from a live camera."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from saccade import visual
from saccade.attention.models import AttentionModel
from saccade.cli.batch_run import stop_on_interrupt
from saccade.cli.drive import write_results
from saccade.cli.look import VideoRecord
from saccade.cli.mapping import RunOutput
from saccade.cli.options import CameraOptions, SequenceOptions
from saccade.cli.output import Progress, print_message, progress_bar
from saccade.datasets import load_drive, write_table
from saccade.datasets.drives.writing import LiveDrive
from saccade.exchange import to_opencv
from saccade.frames import Frame
from saccade.io.video import LiveVideo, video_writer
from saccade.slam import Recorder
from saccade.types import FloatArray, Image, Regions
from saccade.viewing.live import LiveImages, LiveMap
from saccade.viewing.style import ORANGE, rgb_levels
from saccade.visual import VisualConfig

NAME = "camera"
"""Name of the files of a camera."""
KEPT_IMAGES = 8
"""Images kept for the viewer: some frames are read ahead of the map."""
COLOR, RICH = rgb_levels(ORANGE), cv2.DRAW_MATCHES_FLAGS_DRAW_RICH_KEYPOINTS
"""Color and style of keypoints in a film: with their sizes and angles."""


@contextmanager
def opened(camera: CameraOptions) -> Iterator[LiveVideo]:
    """The camera, which ends on Ctrl-C; says at the end how many frames were dropped."""
    with (
        stop_on_interrupt("stopping after this frame") as stopped,
        LiveVideo(str(camera.camera), stopped) as video,
    ):
        yield video
    if video.dropped:
        print_message(f"{video.name}: {video.dropped} frames came during others: dropped")


def look_at_camera(live: CameraOptions, out: Path, attention: AttentionModel) -> dict[str, Any]:
    """Write the saliency and the gaze as a film and as arrays; returns the row for --json."""
    record = VideoRecord(attention)

    def analyze(time: float, image: Image) -> tuple[Image, dict[str, Any]]:
        beside = record.add(time, image)
        return beside, {"heat": beside[:, image.shape[1] :]}

    file = out / f"{NAME}.look"
    _process(live, Path(f"{file}.mp4"), analyze)
    return record.write(f"camera {live.camera}", file)


def detect_in_camera(
    live: CameraOptions, out: Path, detect: Callable[[Image], Any]
) -> dict[str, Any]:
    """Write the keypoints of each frame as a film and a table; returns the row for --json."""
    rows = list[FloatArray]()

    def analyze(time: float, image: Image) -> tuple[Image, dict[str, Any]]:
        found = detect(image)
        found = found.keypoints if isinstance(found, Regions) else found
        columns = (found.xy, found.size, found.angle, found.response)
        count = np.full(len(found), len(rows)), np.full(len(found), time)
        rows.append(np.column_stack([*count, *columns]))
        drawn = cv2.drawKeypoints(image, to_opencv(found)[0], image.copy(), COLOR, RICH)
        return drawn, {"points": np.column_stack([found.xy, found.size / 2])}

    film = out / f"{NAME}.keypoints.mp4"
    _process(live, film, analyze)
    table = out / f"{NAME}.keypoints.csv"
    names = ("frame", "time", "x", "y", "size", "angle", "response")
    values = np.concatenate(rows).astype(np.float64)
    write_table(table, dict(zip(names, values.T, strict=True)))
    return {
        "image": f"camera {live.camera}",
        "frames": len(rows),
        "points": len(values),
        "film": str(film),
        "table": str(table),
    }


def map_camera(
    live: CameraOptions,
    source: SequenceOptions,
    settings: VisualConfig,
    output: RunOutput,
    progress: Progress,
) -> dict[str, Any]:
    """Map while the camera records into a folder; write the results, return run.json's content."""
    with opened(live) as video:
        recording = LiveDrive(video, source.sequence, source.calibration(), live.frames)
        drive, show = recording.drive, None
        if live.live or live.page:
            latest = _LatestImages(drive.load)
            drive = replace(drive, load=latest.load)
            show = LiveMap(
                video.name, drive.time, None, in_browser=live.page, image_at=latest.images.get
            )
        recorder = Recorder(max(output.snapshots, live.frames // 4), show)
        try:
            with visual.dedicated_process():
                report = partial(_report, progress)
                result = visual.run(drive, settings, report, recorder=recorder)
        finally:
            recording.close()
    recorded = load_drive("folder", source.sequence)
    return write_results(recorded, settings, output, progress, result, recorder.snapshots)


def _report(progress: Progress, done: int, _: int) -> None:
    progress(done, None, "map")  # nobody knows how many will come


class _LatestImages:
    """Keeps the images of the last frames that a drive has loaded."""

    def __init__(self, load: Callable[[int], Frame]) -> None:
        self._load = load
        self.images = dict[int, Image]()

    def load(self, number: int) -> Frame:
        """The frame of a number."""
        frame = self._load(number)
        if frame.image is not None:
            self.images[number] = frame.image
        self.images.pop(number - KEPT_IMAGES, None)
        return frame


def _process(
    live: CameraOptions, film: Path, analyze: Callable[[float, Image], tuple[Image, dict[str, Any]]]
) -> None:
    """Analyze each frame; write what is drawn of it, and show what the viewer gets of it."""
    with ExitStack() as stack:
        video = stack.enter_context(opened(live))
        shown = live.live or live.page
        show = LiveImages(video.name, in_browser=live.page) if shown else None
        progress = stack.enter_context(progress_bar(video.name))
        write = stack.enter_context(video_writer(film, video.rate))
        done = 0
        while done < live.frames and (taken := video.read()) is not None:
            drawn, layers = analyze(*taken)
            write(drawn)
            if show is not None:
                show(*taken, **layers)
            done += 1
            progress(done)
