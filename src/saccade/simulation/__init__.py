"""Made worlds whose truth is known."""

from saccade.simulation.trials import Trials, run_trials
from saccade.simulation.world import WorldConfig, simulate_world

__all__ = ["Trials", "WorldConfig", "run_trials", "simulate_world"]
