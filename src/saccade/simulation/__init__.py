"""Simulated worlds and camera drives with ground truth."""

from saccade.simulation.drive import PanCamera, simulate_drive, tag_layout
from saccade.simulation.drive_config import DriveConfig, LightConfig, OdometryConfig
from saccade.simulation.world import WorldConfig, simulate_world

__all__ = [
    "DriveConfig",
    "LightConfig",
    "OdometryConfig",
    "PanCamera",
    "WorldConfig",
    "simulate_drive",
    "simulate_world",
    "tag_layout",
]
