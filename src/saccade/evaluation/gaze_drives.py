"""The drives of the study of gaze policies: with a camera that turns, and with a fovea."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from time import perf_counter
from typing import TypeAlias

from saccade import datasets, visual
from saccade.errors import ImageError
from saccade.evaluation.out_and_back import OutAndBackConfig, out_and_back
from saccade.frames import Drive
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.simulation.drive_config import WorldName
from saccade.slam import Recorder
from saccade.visual import VisualConfig, VisualResult
from saccade.visual.fovea import Fovea, reduced_drive
from saccade.visual.frontend import dedicated_process
from saccade.visual.gaze_control import GazeControl, pan_candidates
from saccade.visual.gaze_policies import POLICIES

PAN_DRIVE = DriveConfig(size=(7.0, 5.5), image_size=(240, 180), field_of_view=50.0)
"""A stereo camera that pans; the ring is smaller than by default."""
WIDE_DRIVE = DriveConfig(size=(7.0, 5.5), image_size=(1226, 370), field_of_view=81.0)
"""A stereo camera with images as wide as those of KITTI."""
SETTINGS = VisualConfig(recover=False)
"""Nobody moves the robot; before a blank wall the test whether somebody did sometimes fails."""
LAPS: dict[WorldName, int] = {"ring": 2, "crossing": 1, "rooms": 1}
"""Of each drive; after each the robot is where it began."""
WITHOUT_FOVEA = "whole", "reduced", "window"
"""Instead of a policy: the whole images; these evenly reduced to the pixels of a fovea; or the
window in their middle alone."""

Run: TypeAlias = Callable[[str, int, int], tuple[Drive, VisualResult]]
"""A drive and its result by policy, seed, and number of frames."""


def gaze_drive(
    config: DriveConfig,
    policy: str,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    recorder: Recorder | None = None,
) -> tuple[Drive, VisualResult, GazeControl]:
    """Map a simulated drive whose camera is turned by a policy.

    Args:
        config: of the drive.
        policy: name of one of `POLICIES`.
        seed: of the world, of all noise, and of what the policy draws.
        progress: called with the number of frames done and of all frames.
        recorder: takes snapshots of the map while it grows.

    Returns:
        The drive, whose frames can now be loaded in any order; its result, and the decisions.
    """
    pan = PanCamera(seed=seed)
    drive = simulate_drive(config, seed, pan)
    candidates = pan_candidates(drive.camera, pan.limits)
    control = GazeControl(POLICIES[policy](seed), candidates, pan.limits, pan.turn_to)
    return drive, visual.run(drive, SETTINGS, progress, recorder=recorder, gaze=control), control


def _pan_run(world: WorldName, policy: str, seed: int, frames: int) -> tuple[Drive, VisualResult]:
    return gaze_drive(_in_laps(PAN_DRIVE, world, frames), policy, seed)[:2]


def _in_laps(config: DriveConfig, world: WorldName, frames: int) -> DriveConfig:
    """A drive in a world that ends where it began."""
    lap = max(2, frames // LAPS[world])
    return replace(config, world=world, frames=frames, frames_per_lap=lap)


WORLDS: dict[str, Run] = {
    "ring": partial(_pan_run, "ring"),
    "crossing": partial(_pan_run, "crossing"),
    "rooms": partial(_pan_run, "rooms"),
}
"""Drives of the study with a camera that turns, by name."""
WIDE_WORLD: WorldName = "ring"
"""The simulated drive of the study with a fovea."""


def fovea_run(world: str, policy: str, seed: int, frames: int) -> tuple[Drive, VisualResult, float]:
    """Map a drive with wide images of which a fovea sees a window in full.

    Args:
        world: `WIDE_WORLD`, or the folder of a recorded drive, which is driven out and back.
        policy: name of one of `POLICIES` or of `WITHOUT_FOVEA`.
        seed: of the simulated world, of all noise, and of what the policy draws.
        frames: largest number of frames.

    Returns:
        The drive, its result, and frames per second, reading and rendering excluded.
    """
    drive = _in_memory(world, seed, frames)
    fovea, control = Fovea(drive), None
    if policy == "window":
        drive = fovea.middle()
    elif policy == "reduced":
        drive = reduced_drive(drive, round(fovea.config.budget**-0.5))
    elif policy != "whole":
        drive, control = fovea.drive, fovea.control(POLICIES[policy](seed))
    with dedicated_process():
        start = perf_counter()
        result = visual.run(drive, SETTINGS, gaze=control)
        seconds = perf_counter() - start
    return drive, result, len(drive) / seconds


@lru_cache(maxsize=1)
def _in_memory(world: str, seed: int, frames: int) -> Drive:
    """A drive whose frames are loaded once; the last one is kept for the other policies."""
    if world == WIDE_WORLD:
        drive = simulate_drive(_in_laps(WIDE_DRIVE, WIDE_WORLD, frames), seed)
    else:
        recorded = datasets.load_drive("auto", Path(world))
        drive = out_and_back(recorded, OutAndBackConfig(frames), seed)
    drive = replace(drive, load=cache(drive.load))
    for number in range(len(drive)):
        with suppress(ImageError):  # reported as the frame is used
            drive.load(number)
    return drive
