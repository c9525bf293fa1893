"""The film of the README: a robot that decides where to look."""

from dataclasses import replace
from pathlib import Path

import cv2
import PIL.Image

from saccade.cli.drive import film_frames
from saccade.simulation import DriveConfig
from saccade.simulation.gaze_drive import gaze_drive
from saccade.viewing.snapshots import SnapshotRecorder

DRIVE = replace(
    DriveConfig.hall(),
    size=(13.0, 10.5),
    frames=160,
    frames_per_lap=80,
    image_size=(320, 240),
    color=True,
)
SEED = 0
"""Seed of the drive."""
STRIDE = 2
"""Interval in frames of the drive between frames of the film."""
SIZE = (1080, 405)
"""Width and height of the film in pixels."""
MILLISECONDS = 160
"""Duration of a frame of the film."""
QUALITY = 60
"""Quality of the WebP."""


def write_film(path: Path) -> None:
    """Simulate the drive, map it, and write the film as an animated WebP."""
    recorder = SnapshotRecorder(DRIVE.frames // STRIDE)
    drive, result = gaze_drive(DRIVE, "active", SEED, recorder=recorder, egomotion="wheels")
    frames = [
        PIL.Image.fromarray(cv2.resize(frame, SIZE, interpolation=cv2.INTER_AREA))
        for frame in film_frames(drive, recorder.snapshots, result)
    ]
    first, *others = frames[: len(recorder.snapshots) + 12]
    first.save(
        path,
        save_all=True,
        append_images=others,
        duration=MILLISECONDS,
        loop=0,
        quality=QUALITY,
        method=6,
    )
