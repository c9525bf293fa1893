"""A large map of trees, against GTSAM's iSAM2 (docs/measured.md, docs/slam.md).

    OMP_NUM_THREADS=1 uv run python benchmarks/large_map.py [--steps 4000 --trees 400]

A robot with a laser of 30 m and 180 degrees sweeps a field of 5000 trees, lane by lane, and comes
back across the lanes: 50 000 steps of half a meter. The filter runs over the whole log and, where
GTSAM is installed, its iSAM2 does, with the same association.
"""

import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from measuring import arguments, require_one_thread
from saccade import slam
from saccade.evaluation.trajectory import point_rmse
from saccade.types import LandmarkLog, LandmarkMap, Trajectory

STEP, LANE, REACH = 0.5, 50.0, 30.0
"""Length of a step, distance between two lanes, and range of the laser in meters."""
DENSITY = 0.005
"""Trees per square meter."""
ODOMETRY = (0.01, np.deg2rad(0.1))
"""Standard deviations of the distance in meters and the turn in radians of a step."""
LASER = (0.1, np.deg2rad(0.5))
"""Standard deviations of range in meters and bearing in radians."""


def sweep(steps: int, side: float) -> np.ndarray:
    """Controls (steps, 2) of distance and turn: along lanes, then back across them."""
    corner = [np.pi / 2 / 20] * 20
    straight = int((side - LANE) / STEP)
    across = int(LANE / STEP) - 26  # the two corners are some 13 m to the side
    turns: list[float] = []
    while len(turns) < steps:
        left = 1.0
        for _ in range(int(side / LANE) - 1):
            turns += [0.0] * straight + [left * each for each in corner]
            turns += [0.0] * across + [left * each for each in corner]
            left = -left
        turns += [0.0] * straight
        turns += corner  # the next sweep is across this one
    return np.column_stack([np.full(steps, STEP), turns[:steps]])


def world(steps: int, trees: int, seed: int) -> LandmarkLog:
    """The log with identities and ground truth."""
    rng = np.random.default_rng(seed)
    side = (trees / DENSITY) ** 0.5
    control = sweep(steps, side)
    pose, truth = np.zeros(3), [np.zeros(3)]
    for u in control:
        pose = slam.turn_then_translate(pose, u)[0]
        truth.append(pose)
    path = np.array(truth)
    low, high = path[:, :2].min(0) - REACH / 2, path[:, :2].max(0) + REACH / 2
    xy = rng.uniform(low, high, (trees, 2))
    order = np.lexsort(np.floor((xy - low) / REACH).T[::-1])
    near = cKDTree(xy[order]).query_ball_point(path[:, :2], REACH, return_sorted=True)
    which, poses, seen = [], [], []
    for i, rows in enumerate(near):
        trees_near = order[np.array(rows, np.int64)]
        z = slam.observe(path[i], xy[trees_near])[0]
        visible = np.abs(z[:, 1]) < np.pi / 2
        which += trees_near[visible].tolist()
        poses += [i] * int(visible.sum())
        seen.append(z[visible])
    z = np.concatenate(seen)
    z = z + rng.normal(size=z.shape) * LASER
    z[:, 0] = np.abs(z[:, 0])  # a tree beside the laser has no negative range
    time_ = np.arange(steps + 1.0)
    return LandmarkLog(
        name="sweep",
        start=path[0],
        time=time_,
        motion="turn_then_translate",
        control=control + rng.normal(size=control.shape) * ODOMETRY,
        control_covariance=np.tile(np.diag(np.square(ODOMETRY)), (steps, 1, 1)),
        observation_pose=np.array(poses),
        observation=z,
        observation_covariance=np.tile(np.diag(np.square(LASER)), (len(z), 1, 1)),
        landmark=np.array(which),
        truth=Trajectory(time_, path),
        landmark_truth=LandmarkMap(np.arange(trees), xy),
    )


class Clock:
    """CPU seconds since it was made, at every call of `progress`."""

    def __init__(self) -> None:
        self._start = time.process_time()
        self.steps: list[int] = []
        self.seconds: list[float] = []

    def __call__(self, done: int, _: int) -> None:
        """Note the time after so many steps."""
        self.steps.append(done)
        self.seconds.append(time.process_time() - self._start)


def isam2(log: LandmarkLog, interval: int, limit: float) -> tuple[Clock, np.ndarray] | None:
    """Time and last estimate (n, 2) of the positions by GTSAM's iSAM2, updated every `interval`.

    It stops after `limit` CPU seconds. None where GTSAM is not installed.
    """
    try:
        import gtsam
    except ImportError:
        return None
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")  # by Cholesky, the default, the system is indeterminate
    solver = gtsam.ISAM2(parameters)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    exact = gtsam.noiseModel.Diagonal.Sigmas(np.full(3, 1e-4))
    sigmas = np.sqrt(log.control_covariance[0].diagonal())
    # turn then translation: the lateral error is that of the turn
    motion = gtsam.noiseModel.Diagonal.Sigmas(
        np.array([sigmas[0], STEP * sigmas[1] + 1e-4, sigmas[1]])
    )
    noise = gtsam.noiseModel.Diagonal.Sigmas(
        np.sqrt(log.observation_covariance[0].diagonal())[::-1]
    )
    pose, known, clock = gtsam.Pose2(*log.start), set(), Clock()
    graph.add(gtsam.PriorFactorPose2(0, pose, exact))
    values.insert(0, pose)
    edge = np.searchsorted(log.observation_pose, np.arange(len(log.time) + 1))
    first = 10**7
    for i in range(len(log.time)):
        if i > 0:
            d, turn = log.control[i - 1]
            step = gtsam.Pose2(d * np.cos(turn), d * np.sin(turn), turn)
            pose = pose.compose(step)
            graph.add(gtsam.BetweenFactorPose2(i - 1, i, step, motion))
            values.insert(i, pose)
        for k in range(edge[i], edge[i + 1]):
            name, (distance, bearing) = int(log.landmark[k]), log.observation[k]
            graph.add(
                gtsam.BearingRangeFactor2D(i, first + name, gtsam.Rot2(bearing), distance, noise)
            )
            if name not in known:
                known.add(name)
                at = np.array([distance * np.cos(bearing), distance * np.sin(bearing)])
                values.insert(first + name, pose.transformFrom(at))
        if (i + 1) % interval == 0 or i == len(log.time) - 1:
            solver.update(graph, values)
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            pose = solver.calculateEstimatePose2(i)
            clock(i + 1, 0)
            if clock.seconds[-1] > limit:
                break
    for _ in range(5):
        solver.update()
    clock(clock.steps[-1], 0)
    estimate = solver.calculateEstimate()
    done = clock.steps[-1]
    return clock, np.array([[(p := estimate.atPose2(i)).x(), p.y()] for i in range(done)])


def draw(path: Path, curves: dict[str, Clock]) -> None:
    """CPU seconds over the number of steps."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for name, clock in curves.items():
        axes.plot(clock.steps, clock.seconds, label=name)
    axes.set(xlabel="steps", ylabel="CPU seconds", yscale="log")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=110)


def main() -> None:
    given = arguments(
        __doc__,
        steps=50_000,
        trees=5000,
        seed=0,
        interval={"type": int, "default": 10, "help": "steps per update of iSAM2"},
        limit={"type": float, "default": 600, "help": "CPU seconds for iSAM2"},
        plot={"type": Path, "help": "PNG of the CPU time over the steps"},
    )
    require_one_thread()
    log = world(given.steps, given.trees, given.seed)
    truth, trees = log.truth.pose[:, :2], len(np.unique(log.landmark))
    print(f"{given.steps} steps, {trees} trees seen, {len(log.observation)} observations")
    config = slam.EkfConfig(association="known", smooth=False)
    slam.run(world(400, 100, 0), replace(config, submaps="always"))  # compiles
    clock = Clock()
    result = slam.run(log, config, clock)
    error = point_rmse(result.trajectory.pose[:, :2], truth, aligned=False)
    print(f"filter: {clock.seconds[-1]:.1f} CPU s, {len(result.map)} landmarks, {error:.2f} m")
    print(f"peak memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GB")
    curves = {"filter": clock}
    peer = isam2(log, given.interval, given.limit)
    if peer is not None:
        clock, xy = peer
        curves[f"iSAM2, every {given.interval} steps"] = clock
        error = point_rmse(xy, truth[: len(xy)], aligned=False)
        print(f"iSAM2: {clock.seconds[-1]:.1f} CPU s for {len(xy)} steps, {error:.2f} m")
    if given.plot is not None:
        draw(given.plot, curves)


if __name__ == "__main__":
    main()
