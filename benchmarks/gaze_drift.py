"""How visual odometry drifts with the direction in which the camera looks.

    uv run python benchmarks/gaze_drift.py [--world ring] [--seeds 2]

The drives of `saccade evaluate gaze` with a camera at a constant pan, and with one that alternates
between two directions. Drift is the root mean squared error of the motion over 2 s. The map is
limited to one landmark, so that no landmark corrects it.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from saccade import visual
from saccade.evaluation.gaze_drives import LAPS, PAN_DRIVE, SETTINGS
from saccade.frames import steps_between
from saccade.gaze import Gazer
from saccade.simulation import PanCamera, simulate_drive
from saccade.simulation.drive_config import WorldName
from saccade.types import FloatArray
from saccade.visual.gaze_control import GazeControl

FRAMES, STEPS = 200, 20
PANS = [(0,), (20,), (40,), (-40,), (80,), (-80,), (140,), (0, 20), (0, 40)]
"""Degrees to the left; of several each for a second in turn."""


def drift(world: WorldName, pans: Sequence[int], seed: int) -> FloatArray:
    """(2,) root mean squared error of position in metres and heading in radians."""
    lap = FRAMES // LAPS[world]
    config = replace(PAN_DRIVE, world=world, frames=FRAMES, frames_per_lap=lap)
    motor = PanCamera(seed=seed)
    drive = simulate_drive(config, seed, motor)

    def look(gazer: Gazer) -> float:
        return float(np.radians(pans[int(gazer.time) % len(pans)]))

    control = GazeControl(look, drive.camera, motor.limits, motor.turn_to)
    result = visual.run(drive, replace(SETTINGS, max_landmarks=1, new_per_frame=1), gaze=control)
    assert drive.truth is not None
    poses = result.trajectory.pose, drive.truth.pose
    errors = []
    for i in range(0, FRAMES - STEPS, 5):
        estimate, truth = (steps_between(each[[i, i + STEPS]])[0] for each in poses)
        errors.append(estimate - truth)
    error = np.array(errors)
    error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
    squared = np.square(error).mean(0)
    return np.asarray(np.sqrt([squared[:2].sum(), squared[2]]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--world", default="ring", choices=LAPS)
    parser.add_argument("--seeds", type=int, default=2)
    given = parser.parse_args()
    for pans in PANS:
        runs = [drift(given.world, pans, seed) for seed in range(given.seeds)]
        position, heading = 1e3 * np.sqrt(np.square(runs).mean(0))
        print(f"{given.world:9} {pans!s:9} {position:5.1f} mm {heading:5.1f} mrad", flush=True)


if __name__ == "__main__":
    main()
