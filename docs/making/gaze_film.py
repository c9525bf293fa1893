"""The film of the README: a robot that decides where to look."""

from pathlib import Path

import cv2
import PIL.Image

from saccade import visual
from saccade.cli.drive import film_frames
from saccade.simulation import DriveConfig
from saccade.simulation.gaze_drive import SETTINGS, gaze_drive
from saccade.slam import Recorder

DRIVE = DriveConfig(
    world="rooms",
    frames=200,
    frames_per_lap=200,
    image_size=(320, 240),
    field_of_view_deg=50.0,
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
    drive, _ = gaze_drive(DRIVE, "active", SEED)
    recorder = Recorder(len(drive) // STRIDE)
    result = visual.run(drive, SETTINGS, recorder=recorder)
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
