"""Simulated worlds and camera drives with ground truth."""

from saccade.simulation.drive import simulate_drive
from saccade.simulation.drive_config import DriveConfig, LightConfig, OdometryConfig
from saccade.simulation.pan_camera import PanCamera
from saccade.simulation.world import MonteCarloRuns, WorldConfig, run_monte_carlo, simulate_world

__all__ = [
    "DriveConfig",
    "LightConfig",
    "MonteCarloRuns",
    "OdometryConfig",
    "PanCamera",
    "WorldConfig",
    "run_monte_carlo",
    "simulate_drive",
    "simulate_world",
]
