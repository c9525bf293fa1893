"""The odometry noise of the MRCLAM robots by maximum likelihood.

    uv run python benchmarks/odometry_noise.py mrclam6.npz mrclam9.npz

The standard deviations of `OdometryNoise` under which the innovations of the filter, with names,
are the most likely (the prediction error decomposition, Schweppe 1965), with Huber's loss for
outliers; by coordinate search in steps of the root of two, over all robots of the logs. The noise
that the other logs give is tried on each log, and that of all logs, which is the default of the
loader. The loss is twice the negative log likelihood of an innovation.
"""

import argparse
from dataclasses import astuple
from functools import cache
from pathlib import Path

import numpy as np

from saccade import slam
from saccade.datasets.logs.conversions import OdometryNoise
from saccade.datasets.logs.published import MRCLAM_ODOMETRY, ROBOTS, read_mrclam
from withheld import rmse

HUBER = 1.345
STEP = 2**0.5


@cache
def loss(path: Path, noise: OdometryNoise) -> float:
    """Mean over the robots of a log; every name is believed, so that no observation is left out."""
    losses = []
    for robot in range(1, ROBOTS + 1):
        log = read_mrclam(path, robot, noise)
        result = slam.run(log, slam.EkfConfig(association="known", huber=HUBER))
        used = np.isfinite(result.consistency.nis)
        nis, S = result.consistency.nis[used], result.innovation_covariance[used]
        root = np.sqrt(nis)
        bounded = np.where(root < HUBER, nis, 2 * HUBER * root - HUBER**2)
        losses.append((bounded + np.linalg.slogdet(S)[1]).mean())
    return float(np.mean(losses))


def most_likely(paths: list[Path]) -> OdometryNoise:
    """The noise with the least loss over some logs, beginning with the default."""
    best, least, improved = MRCLAM_ODOMETRY, np.inf, True
    while improved:
        improved = False
        for i in range(3):
            for factor in (1 / STEP, STEP):
                values = list(astuple(best))
                values[i] *= factor
                tried = OdometryNoise(*(round(value, 6) for value in values))
                least = min(least, sum(loss(path, best) for path in paths))
                while (total := sum(loss(path, tried) for path in paths)) < least - 1e-3:
                    best, least, improved = tried, total, True
                    values[i] *= factor
                    tried = OdometryNoise(*(round(value, 6) for value in values))
    return best


def show(label: str, path: Path, noise: OdometryNoise) -> None:
    logs = [read_mrclam(path, robot, noise) for robot in range(1, ROBOTS + 1)]
    errors = [rmse(log, slam.run(log)) for log in logs]
    each = ", ".join(f"{error:.3f}" for error in errors)
    print(
        f"{path.stem:9} {label:12} {noise.distance:8.4f} {noise.turn:6.4f} {noise.drift:6.4f} "
        f"{loss(path, noise):8.3f}  {np.mean(errors):.3f} ({each})",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("logs", type=Path, nargs="+")
    paths = parser.parse_args().logs
    print("log       noise of     distance turn   drift      loss  position (m) of each robot")
    together = most_likely(paths)
    for path in paths:
        show("the default", path, MRCLAM_ODOMETRY)
        show("other logs", path, most_likely([other for other in paths if other != path]))
        show("all logs", path, together)


if __name__ == "__main__":
    main()
