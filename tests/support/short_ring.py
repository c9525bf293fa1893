"""A short simulated drive out and back, whose images are rendered once."""

from dataclasses import replace

from out_and_back import OutAndBackConfig, out_and_back
from saccade.simulation import DriveConfig, simulate_drive


def short_ring(frames):
    """Out and back along the first meters of the ring."""
    made = out_and_back(simulate_drive(DriveConfig(frames=frames)), OutAndBackConfig(frames))
    pictures = [made.load(number) for number in range(len(made))]
    return replace(made, load=pictures.__getitem__)
