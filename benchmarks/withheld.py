"""What a log is worth less when something in it is withheld.

    uv run python benchmarks/withheld.py mrclam6.npz mrclam9.npz cityTrees10000.txt [--jitter 12]

Quoted in docs/measured.md and docs/limits.md. For each log, and every robot in it, the filter runs
three times by its defaults: on the log as it is, without estimating systematic errors of the
odometry, and without the labels of the landmarks. A landmark of the map without labels counts as
the one that most of its observations were of; "found" is the number of different ones, and "wrong"
the fraction of observations of others. With --jitter, draws of 1 mm of noise are compared.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from measuring import arguments, without_labels
from saccade import datasets, slam
from saccade.datasets.logs.mrclam import ROBOTS
from saccade.errors import ConfigError
from saccade.evaluation.trajectory import position_rmse
from saccade.types import LandmarkLog


def robots(path: Path) -> Iterator[LandmarkLog]:
    """The log, or that of each robot where there are several."""
    try:
        for robot in range(1, ROBOTS + 1):
            yield datasets.load("auto", path, robot=robot)
    except ConfigError:
        yield datasets.load("auto", path)


def rmse(log: LandmarkLog, result: slam.SlamResult) -> float:
    """Metres from the truth, where there is one."""
    return float("nan") if log.truth is None else position_rmse(result.trajectory, log.truth)


def associated(log: LandmarkLog, result: slam.SlamResult) -> tuple[int, float]:
    """How many of the named landmarks are in the map, and the share of wrong associations."""
    used = np.flatnonzero(result.association >= 0)
    if len(used) == 0:
        return 0, float("nan")
    landmark, name = result.association[used], np.unique(log.landmark, return_inverse=True)[1][used]
    counts = np.zeros((len(result.map), int(name.max(initial=-1)) + 1), np.int64)
    np.add.at(counts, (landmark, name), 1)
    return len(np.unique(counts.argmax(1))), 1 - counts.max(1).sum() / len(used)


def print_draws(path: Path, draws: int, config: slam.EkfConfig) -> None:
    """Print what each draw of noise on the observations of a log without names gives."""
    rows = []
    for draw in range(1, draws + 1):
        for log in robots(path):
            rng = np.random.default_rng([draw, len(log.observation)])
            z = log.observation + 1e-3 * rng.normal(size=log.observation.shape)
            result = slam.run(without_labels(replace(log, observation=z)), config)
            rows.append((draw, rmse(log, result), len(result.map), associated(log, result)[1]))
        error, size, wrong = np.array([row[1:] for row in rows if row[0] == draw]).T
        print(
            f"{path.stem} draw {draw:2}: mean {error.mean():.3f} m, worst {error.max():.3f} m, "
            f"landmarks {size.min():.0f} to {size.max():.0f}, wrong {np.median(wrong):.1%}",
            flush=True,
        )
    _, error, size, wrong = np.array(rows).reshape(draws, -1, 4).transpose(2, 0, 1)
    means = error.mean(1)
    print(
        f"{path.stem}: mean over robots {np.median(means):.3f} m (worst draw {means.max():.3f}), "
        f"worst robot {error.max():.3f} m, landmarks {np.median(size):.0f} "
        f"({size.min():.0f} to {size.max():.0f}), wrong {np.median(wrong):.1%} "
        f"(worst {wrong.max():.1%})"
    )


def main() -> None:
    given = arguments(
        __doc__,
        logs={"flags": "logs", "type": Path, "nargs": "+"},
        association="auto",
        jitter={"type": int, "default": 0, "metavar": "DRAWS"},
    )
    config = slam.EkfConfig(association=given.association)
    if given.jitter > 0:
        for path in given.logs:
            print_draws(path, given.jitter, config)
        return
    print("                                  position (m)                 without names")
    print("log                    as it is  no bias  no names   map  found      wrong  used")
    for path in given.logs:
        for log in robots(path):
            plain = slam.EkfConfig(estimate_systematic_errors=False)
            result = slam.run(without_labels(log), config)
            found, wrong = associated(log, result)
            errors = [rmse(log, each) for each in (slam.run(log), slam.run(log, plain), result)]
            print(
                f"{log.name:22} {errors[0]:8.3f} {errors[1]:8.3f}  {errors[2]:8.3f} "
                f"{len(result.map):5}  {found:4} of {len(np.unique(log.landmark)):4} {wrong:5.1%}"
                f" {(result.association >= 0).mean():5.1%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
