"""Made worlds whose truth is known."""

from saccade.simulation.drive import simulate_drive
from saccade.simulation.drive_config import DriveConfig, LightConfig, OdometryConfig
from saccade.simulation.monte_carlo import Trials, run_trials
from saccade.simulation.world import WorldConfig, simulate_world

__all__ = [
    "DriveConfig",
    "LightConfig",
    "OdometryConfig",
    "Trials",
    "WorldConfig",
    "run_trials",
    "simulate_drive",
    "simulate_world",
]
