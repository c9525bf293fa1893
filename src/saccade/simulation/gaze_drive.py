"""Simulated drives whose camera is turned by a gaze policy."""

from collections.abc import Callable
from dataclasses import replace

from saccade import visual
from saccade.frames import Drive
from saccade.gaze import Policy
from saccade.simulation.drive import PanCamera, simulate_drive
from saccade.simulation.drive_config import DriveConfig
from saccade.slam import Recorder
from saccade.visual import VisualConfig, VisualResult, measure_odometry
from saccade.visual.config import EgomotionSource
from saccade.visual.gaze_control import GazeControl

SETTINGS = VisualConfig(recover=False)
"""Settings of the mapping, without a kidnapping test, which a blank wall may trigger."""
SECOND_FIELD_OF_VIEW_DEG = 70.0
"""Field of view of the second, fixed camera in degrees."""


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
        config: settings of the drive.
        policy: see `saccade.gaze.Gazer`.
        seed: seed of the world, of all noise, and of random policies.
        progress: called with the number of frames done and of all frames.
        recorder: takes snapshots of the map while it grows.
        egomotion: source of the motion estimate.

    Returns:
        The drive, whose frames can now be loaded in any order, and its result.
    """
    pan = PanCamera(seed=seed)
    drive = simulate_drive(config, seed, pan)
    if egomotion == "second-camera":
        second = simulate_drive(replace(config, field_of_view_deg=SECOND_FIELD_OF_VIEW_DEG), seed)
        drive = measure_odometry(drive, second, SETTINGS)
    control = GazeControl(policy, drive.camera, pan.limits, pan.turn_to, seed)
    settings = replace(SETTINGS, egomotion=egomotion)
    return drive, visual.run(drive, settings, progress, recorder=recorder, gaze=control)
