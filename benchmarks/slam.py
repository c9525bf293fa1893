"""EKF-SLAM by the size of the map (docs/measured.md, docs/slam.md).

    OMP_NUM_THREADS=1 uv run python benchmarks/slam.py [--logs data/logs]

For each size a steady state is timed, one prediction and one landmark's update after the other, by
`Slam.step` and by `EkfSlam` alone, against one pass over the covariance: reading and writing its
upper triangle at the bandwidth that is measured in the same run; then whole logs if they are given.
Everything takes turns; printed are medians. `large_map.py` times the compressed filter.
"""

import resource
import time
from pathlib import Path

import numpy as np

from measuring import arguments, require_one_thread, seconds
from saccade import datasets, slam
from saccade.slam import EkfSlam, observe
from saccade.slam.landmarks import LabelRecord

FLUSHES = 3
"""Additions of the delayed rows during the steps that are timed."""
DENSITY = 0.02
"""Landmarks to the square metre."""
CONTROL, U = np.array([0.05, 0.01]), np.diag([1e-4, 1e-5])
NOISE = np.diag([0.01, 0.0004])


def filled(landmarks: int, errors: slam.filter.state.Errors = "invariant") -> EkfSlam:
    """A filter in the middle of a map, all of which is correlated."""
    rng = np.random.default_rng(landmarks)
    half = (landmarks / DENSITY) ** 0.5 / 2
    ekf = EkfSlam(np.zeros(3), np.diag([0.01, 0.01, 0.001]), errors=errors)
    for xy in rng.uniform(-half, half, (landmarks, 2)):
        ekf.augment(observe(np.zeros(3), xy)[0], NOISE)
    return ekf


def stretch(ekf: EkfSlam, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Controls (t, 2), observations (t, 2) and their landmarks (t,) of a drive.

    It goes round in a small circle, and sees in turn the landmarks (k, 3): number, place.
    """
    pose, steps = ekf.pose, FLUSHES * len(ekf.active.downdates) // 2  # two rows in each step
    turned = pose[2] + CONTROL[1] * np.arange(1, steps + 1)
    path = np.column_stack(
        [
            pose[0] + CONTROL[0] * np.cumsum(np.cos(turned)),
            pose[1] + CONTROL[0] * np.cumsum(np.sin(turned)),
            turned,
        ]
    )
    which = seen[np.arange(steps) % len(seen)]
    z = [observe(at, xy)[0] for at, xy in zip(path, which[:, 1:], strict=True)]
    return np.tile(CONTROL, (steps, 1)), np.array(z), which[:, 0].astype(np.int64)


def stepped(ekf: EkfSlam, seen: np.ndarray) -> float:
    """Seconds that a step of such a drive takes."""
    control, z, landmark = stretch(ekf, seen)
    live = slam.Slam(slam.EkfConfig(association="known", submaps="never", recover=False))
    live.hypotheses.best.ekf = ekf
    live.landmarks.add(ekf.ids, confirmed=True)
    for number in ekf.ids.tolist():
        live.landmarks.labels[number] = LabelRecord(number)
    start = time.perf_counter()
    for i in range(len(z)):
        live.step(float(i), control[i], U, z[i : i + 1], NOISE[None], landmark[i : i + 1])
    return (time.perf_counter() - start) / len(z)


def called(ekf: EkfSlam, seen: np.ndarray) -> float:
    """Seconds that a step takes if each is called for by itself."""
    steps = list(zip(*stretch(ekf, seen), strict=True))
    start = time.perf_counter()
    for control, z, landmark in steps:
        ekf.predict(control, U)
        ekf.update(z, NOISE, int(landmark))
    return (time.perf_counter() - start) / len(steps)


def nearest(ekf: EkfSlam, count: int) -> np.ndarray:
    """Numbers and places (k, 3) of the landmarks that are nearest to the robot."""
    xy = ekf.landmarks
    order = np.argsort(np.hypot(*(xy - ekf.pose[:2]).T))[:count]
    return np.column_stack([order, xy[order]])


def bytes_a_second(array: np.ndarray) -> float:
    """Read and written of an array that fits no cache."""
    start = time.perf_counter()
    np.multiply(array, 0.999, out=array)
    return 2 * array.nbytes / (time.perf_counter() - start)


def contest(landmarks: int, rounds: int) -> None:
    ekf = filled(landmarks)
    seen = nearest(ekf, 20)
    large = np.ones(2**25)
    n = 3 + 2 * landmarks
    triangle = 16 * n * (n + 1) / 2  # bytes read and written
    stepped(ekf, seen)
    rows = []
    for _ in range(rounds):
        one_pass = triangle / bytes_a_second(large)
        ours = stepped(ekf, seen)
        rows.append((ours, called(ekf, seen), one_pass, ours / one_pass))
    ours, by_calls, one_pass, share = np.median(rows, 0)
    print(
        f"{landmarks:9d}  {ours * 1e3:8.3f}  {by_calls * 1e3:8.3f}  {one_pass * 1e3:8.3f}"
        f"  {share:9.2f}",
        flush=True,
    )


FILTER = slam.EkfConfig(smooth=False)


def logs(folder: Path, rounds: int) -> None:
    """Whole logs after they were read, and the smoothing of the same association."""
    paths = [(folder / "mrclam" / "mrclam6.npz", {"robot": robot}) for robot in range(1, 6)]
    paths.append((folder / "citytrees" / "cityTrees10000.txt", {}))
    paths.append((folder / "victoria_park" / "victoria_park_gtsam.txt", {}))
    print("log                  filter s  at best  smoothing s")
    for path, options in paths:
        log = datasets.load("auto", path, **options)
        result = slam.run(log, FILTER)
        times = [seconds(lambda log=log: slam.run(log, FILTER)) for _ in range(rounds)]
        smooth = seconds(lambda log=log, result=result: slam.smooth(log, result))
        print(
            f"{log.name:20s} {np.median(times):8.3f} {min(times):8.3f} {smooth:12.3f}",
            flush=True,
        )


def main() -> None:
    given = arguments(
        __doc__,
        sizes=[100, 500, 1000, 2000, 5000],
        rounds=9,
        logs={"type": Path, "help": "folder with mrclam, citytrees and victoria_park"},
    )
    require_one_thread()
    print("landmarks   ours ms  by calls   pass ms  ours/pass")
    for landmarks in given.sizes:
        contest(landmarks, given.rounds)
    if given.logs is not None:
        logs(given.logs, given.rounds)
    print(f"peak memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GB")


if __name__ == "__main__":
    main()
