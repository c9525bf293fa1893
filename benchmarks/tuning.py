"""`--tune` before and after: recorded logs, and simulated worlds whose noise is declared wrong.

    uv run python benchmarks/tuning.py [--runs 20] [--worlds loop,car] [LOG ...]

Of each log and every robot in it: the estimated scales, the position RMSE (aligned; where the log
has the truth) with the declared and with the tuned noise, and what `--tune` says. Of each world the
declared deviations of controls and observations are the true ones times 1/4 to 4; with and without
names of the landmarks. The change is that of the mean squared error over the runs, which have the
same noise before and after, with its standard error.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade import datasets, slam
from saccade.datasets.logs.mrclam import ROBOTS
from saccade.errors import ConfigError, LogError
from saccade.evaluation.trajectory import position_rmse
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.consistency import pose_nees
from saccade.slam.tuning import Tuning, tune
from saccade.types import LandmarkLog

FACTORS = (
    *((1.0, 1.0), (0.25, 1.0), (4.0, 1.0), (1.0, 0.25), (1.0, 4.0)),
    *((0.25, 0.25), (4.0, 4.0), (0.25, 4.0), (4.0, 0.25)),
)
"""On the true deviations of the controls and of the observations."""
WORLDS = {
    "loop": WorldConfig(steps=800),
    "coarse": replace(WorldConfig.coarse(), steps=800),
    "car": replace(WorldConfig.car(), steps=5334),
}
CONFIG = slam.EkfConfig()


def robots(path: Path) -> Iterator[LandmarkLog]:
    """The log, or that of each robot where there are several."""
    try:
        for robot in range(1, ROBOTS + 1):
            yield datasets.load("auto", path, robot=robot)
    except ConfigError:
        yield datasets.load("auto", path)


def without_names(log: LandmarkLog) -> LandmarkLog:
    """The log with landmarks that are unknown."""
    return replace(log, landmark=np.full_like(log.landmark, -1))


def errors(log: LandmarkLog, config: slam.EkfConfig) -> tuple[float, float]:
    """Position RMSE and mean NEES; NaN without truth."""
    result = slam.run(log, config)
    if log.truth is None:
        return float("nan"), float("nan")
    rmse = position_rmse(result.trajectory, log.truth)
    if len(log.truth) != len(log.time):
        return rmse, float("nan")
    return rmse, float(np.nanmean(pose_nees(result.trajectory, log.truth, slam.INVARIANT)))


def before_and_after(log: LandmarkLog) -> tuple[np.ndarray, np.ndarray, Tuning]:
    """RMSE and NEES with the declared and with the tuned noise."""
    tuned = tune(log, CONFIG)
    before = np.array(errors(log, CONFIG))
    return before, before if tuned.objection else np.array(errors(log, tuned.config)), tuned


def recorded(paths: list[Path]) -> None:
    """Print a row for every log, with its names and without them."""
    for path in paths:
        for log in robots(path):
            hidden = [without_names(log)] if (log.landmark >= 0).any() else []
            for each, names in zip((log, *hidden), ("", ", no names"), strict=False):
                try:
                    before, after, tuned = before_and_after(each)
                except LogError as error:
                    print(f"{log.name}{names}: {error}", flush=True)
                    continue
                scales = "{:.2f} {:.2f}".format(*tuned.estimated)
                said = tuned.objection or "confirmed"
                rmse = f"{before[0]:.3f} -> {after[0]:.3f} m"
                print(f"{log.name + names:32}{rmse}  scales {scales}  {said}", flush=True)


def simulated(names: list[str], runs: int) -> None:
    """Print a row for every world and every wrong declaration."""
    print("world, names        declared      RMSE (m)          change       NEES          used")
    for name in names:
        logs = [simulate_world(WORLDS[name], seed) for seed in range(runs)]
        for hidden in (False, True):
            for motion, sensor in FACTORS:
                rows, used = [], 0
                for log in logs:
                    wrong = replace(
                        log,
                        control_covariance=motion**2 * log.control_covariance,
                        observation_covariance=sensor**2 * log.observation_covariance,
                    )
                    try:
                        before, after, tuned = before_and_after(
                            without_names(wrong) if hidden else wrong
                        )
                    except LogError:
                        continue
                    rows.append((before, after))
                    used += not tuned.objection
                (rmse, nees), (tuned_rmse, tuned_nees) = np.array(rows).transpose(1, 2, 0)
                change = (tuned_rmse**2 - rmse**2) / (2 * (rmse**2).mean())
                print(
                    f"{name:7} {'no names' if hidden else 'names':10}"
                    f"{motion:6.2f}{sensor:6.2f}"
                    f"{np.sqrt((rmse**2).mean()):9.3f} -> {np.sqrt((tuned_rmse**2).mean()):.3f}"
                    f"{change.mean():+10.1%} +- {change.std() / len(change) ** 0.5:.1%}"
                    f"{nees.mean():9.1f} -> {tuned_nees.mean():.1f}"
                    f"{used:6} of {len(rows)} of {runs}",
                    flush=True,
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("logs", type=Path, nargs="*")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--worlds", default=",".join(WORLDS))
    options = parser.parse_args()
    recorded(options.logs)
    if options.worlds:
        simulated(options.worlds.split(","), options.runs)


if __name__ == "__main__":
    main()
