"""Inconsistency of each filter in the SLAM playground (the table of docs/serve.md).

    uv run python benchmarks/playground.py [--seeds 100]

The playground of `saccade serve` drives three rounds between its two rings of landmarks, with its
initial settings and the noise of each seed.
"""

import numpy as np

from measuring import arguments
from saccade.serving.playground import PlaygroundNoise, Session, positions, rings
from saccade.slam.config import RETRACTIONS

ROUND = 126
"""Steps of a round."""
STEP = np.array([0.5, 0.05])
"""Distance in metres and turn in radians."""
COLUMNS = ("mean_nees", "inside_percent", "inside_landmarks")


def rounds(seed: int) -> list[list[list[float]]]:
    """After each of three rounds, the columns of each filter."""
    session, noise = Session(seed, positions(rings(), "landmarks")), PlaygroundNoise()
    session.step(None, noise)
    table = []
    for step in range(1, 3 * ROUND + 1):
        session.step(STEP, noise)
        if step % ROUND == 0:
            summaries = [session.summary(name) for name in RETRACTIONS]
            table.append([[float(each[column]) for column in COLUMNS] for each in summaries])
    return table


def main() -> None:
    """Print the mean over the seeds, with the 10 % and 90 % quantiles of the second column."""
    runs = np.array([rounds(seed) for seed in range(arguments(__doc__, seeds=100).seeds)])
    print(f"{'filter':16} {'round':>5} {'NEES':>7} {'inside':>7} {'10-90 %':>11} {'landmarks':>9}")
    for i, name in enumerate(RETRACTIONS):
        for lap in range(3):
            nees, inside, landmarks = runs[:, lap, i].mean(0)
            low, high = np.percentile(runs[:, lap, i, 1], [10, 90])
            spread = f"{low:.0f} to {high:.0f}"
            row = f"{nees:7.1f} {inside:5.0f} % {spread:>11} {landmarks:9.1f}"
            print(f"{name:16} {lap + 1:5} {row}")


if __name__ == "__main__":
    main()
