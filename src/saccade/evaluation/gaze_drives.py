"""The drives of the study of gaze policies, with a camera that turns."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeAlias

from saccade import visual
from saccade.frames import Drive
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.simulation.drive_config import WorldName
from saccade.slam import Recorder
from saccade.visual import VisualConfig, VisualResult
from saccade.visual.gaze_control import GazeControl, pan_candidates
from saccade.visual.gaze_policies import POLICIES

PAN_DRIVE = DriveConfig(size=(7.0, 5.5), image_size=(240, 180), field_of_view=50.0)
"""A stereo camera that pans; the ring is smaller than by default."""
SETTINGS = VisualConfig(recover=False)
"""Nobody moves the robot; before a blank wall the test whether somebody did sometimes fails."""
LAPS: dict[WorldName, int] = {"ring": 2, "crossing": 1, "rooms": 1}
"""Of each drive; after each the robot is where it began."""
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
