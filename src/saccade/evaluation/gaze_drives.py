"""The drives of the study of gaze policies, with a camera that turns."""

from collections.abc import Callable
from dataclasses import replace

from saccade import visual
from saccade.frames import Drive
from saccade.gaze import Policy
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.slam import Recorder
from saccade.visual import VisualConfig, VisualResult
from saccade.visual.config import EgomotionSource
from saccade.visual.gaze_control import GazeControl
from saccade.visual.second_camera import measure_odometry

SETTINGS = VisualConfig(recover=False)
"""Nobody moves the robot; before a blank wall the test whether somebody did sometimes fails."""
SECOND_FIELD_OF_VIEW = 70.0
"""Degrees of the second, fixed camera."""


def gaze_drive(
    config: DriveConfig,
    policy: str | Policy,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    recorder: Recorder | None = None,
    egomotion: EgomotionSource = "camera",
) -> tuple[Drive, VisualResult]:
    """Map a simulated drive whose camera is turned by a policy.

    Args:
        config: of the drive.
        policy: see `saccade.gaze.Gazer`.
        seed: of the world, of all noise, and of what the policy draws.
        progress: called with the number of frames done and of all frames.
        recorder: takes snapshots of the map while it grows.
        egomotion: what measures the motion.

    Returns:
        The drive, whose frames can now be loaded in any order, and its result.
    """
    pan = PanCamera(seed=seed)
    drive = simulate_drive(config, seed, pan)
    if egomotion == "second-camera":
        second = simulate_drive(replace(config, field_of_view=SECOND_FIELD_OF_VIEW), seed)
        drive = measure_odometry(drive, second, SETTINGS)
    control = GazeControl(policy, drive.camera, pan.limits, pan.turn_to, seed)
    settings = replace(SETTINGS, egomotion=egomotion)
    return drive, visual.run(drive, settings, progress, recorder=recorder, gaze=control)
