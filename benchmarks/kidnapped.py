"""Kidnapping: a robot is moved along its course, and turned, while its odometry says nothing.

    uv run python benchmarks/kidnapped.py [--seeds 5] [--worlds robot park]      (docs/lost.md)

In the worlds of `relocalization.py`, after a lap or so: the robot goes on from another place of the
course, 0, 5, 15 or 50 m on (0 for an undisturbed run), every second time in the opposite direction.
It is recovered when it is not lost at the end and the pose is within three standard deviations or
0.3 m, and 0.15 rad, of the true one in at least 95 of the last 100 poses. Map errors are the
distances of mapped landmarks from the nearest true one (root mean square), relative to those of
the same run without kidnapping; "worst" is the largest ratio among the seeds.
"""

from dataclasses import replace

import numpy as np

from measuring import arguments, without_labels
from relocalization import WORLDS
from saccade import slam
from saccade.plane import steps_between
from saccade.simulation import WorldConfig, simulate_world
from saccade.types import FloatArray, LandmarkLog, Trajectory


def kidnapped(
    world: WorldConfig, seed: int, metres: float, turned: bool, laps: float = 1.2
) -> LandmarkLog:
    """A log in which the robot is moved after so many laps, and goes on for as many steps."""
    rng = np.random.default_rng([seed, 2])
    lap = round(world.course_length / world.step_length)
    step = round(laps * lap) + int(rng.integers(lap // 4))
    jump = round(metres / world.step_length)
    log = simulate_world(replace(world, steps=2 * step + lap + jump + 1), seed)
    course = log.truth.pose
    after = course[step + jump + 1 : 2 * step + jump + 1]
    if turned:
        after = course[step + jump : step + jump - lap : -1] + np.array([0, 0, np.pi])
    truth = np.concatenate([course[: step + 1], after])
    truth[:, 2] = slam.wrap(truth[:, 2])
    t = len(truth)
    control = steps_between(truth)
    control[step] = steps_between(course)[step]  # what the robot believes it did
    U = log.control_covariance[: t - 1]
    values, vectors = np.linalg.eigh(U)
    noise = np.sqrt(np.maximum(values, 0)) * rng.standard_normal((t - 1, 3))
    control = control + np.einsum("tij,tj->ti", vectors, noise)
    return replace(log, control=control, control_covariance=U, **scans(world, log, truth, rng))


def scans(
    world: WorldConfig, log: LandmarkLog, truth: FloatArray, rng: np.random.Generator
) -> dict[str, object]:
    """The observations from each pose (t, 3)."""
    z = np.array([slam.observe(pose, log.landmark_truth.xy)[0] for pose in truth])  # (t, n, 2)
    low, high = world.range_limits
    visible = (z[..., 0] >= low) & (z[..., 0] <= high)
    visible &= np.abs(z[..., 1]) <= np.deg2rad(world.field_of_view_deg / 2)
    visible[np.arange(len(truth)) % world.scan_interval > 0] = False
    pose, landmark = np.nonzero(visible)
    z = z[visible]
    bearing = np.full(len(z), np.deg2rad(world.bearing_sigma_deg))
    sigma = np.stack([world.range_percent / 100 * z[:, 0] + world.range_sigma, bearing], 1)
    time = world.step_time * np.arange(len(truth), dtype=np.float64)
    return {
        "time": time,
        "observation_pose": pose,
        "observation": z + sigma * rng.standard_normal(z.shape),
        "observation_covariance": sigma[:, :, None] ** 2 * np.eye(2),
        "landmark": landmark,
        "truth": Trajectory(time, truth),
    }


def recovered(log: LandmarkLog, result: slam.SlamResult) -> bool:
    """Whether the robot knows where it is at the end."""
    e = (result.trajectory.pose - log.truth.pose)[-100:]
    sigma = np.sqrt(result.trajectory.covariance[-100:, [0, 1], [0, 1]].sum(1))
    right = np.hypot(e[:, 0], e[:, 1]) < np.maximum(0.3, 3 * sigma)
    right &= np.abs(slam.wrap(e[:, 2])) < 0.15
    return bool(right.mean() >= 0.95) and not result.lost[-1]


def map_error(log: LandmarkLog, result: slam.SlamResult) -> float:
    """Root mean square distance of mapped landmarks from the nearest true one."""
    offset = result.map.xy[:, None] - log.landmark_truth.xy
    return float(np.sqrt((offset**2).sum(-1).min(1).mean()))


def main() -> None:
    options = arguments(
        __doc__,
        seeds=5,
        worlds={"nargs": "+", "choices": WORLDS, "default": list(WORLDS)},
        distances=[0.0, 5.0, 15.0, 50.0],
    )
    print(
        "world    names     metres  runs  lost  recovered  without   steps  map error, ratio  worst"
    )
    for name in options.worlds:
        for named in (True, False):
            clean: dict[tuple[int, bool], float] = {}
            for metres in options.distances:
                rows = []
                for seed in range(1, options.seeds + 1):
                    turned = seed % 2 == 0 and metres > 0
                    log = kidnapped(WORLDS[name], seed, metres, turned)
                    if not named:
                        log = without_labels(log)
                    result = slam.run(log, slam.EkfConfig(smooth=False))
                    key = seed, turned
                    error = map_error(log, result)
                    if metres == 0:
                        clean[seed, False] = clean[seed, True] = error
                    plain = slam.run(log, slam.EkfConfig(recover=False, smooth=False))
                    ratio = error / clean.get(key, np.nan)
                    rows.append(
                        (result.lost.any(), recovered(log, result), recovered(log, plain),
                         result.lost.sum(), error, ratio)
                    )  # fmt: skip
                lost, right, plain_right, steps, errors, ratios = np.transpose(rows)
                print(
                    f"{name:8} {'known' if named else 'unknown':8}{metres:8g}{len(rows):6}"
                    f"{int(lost.sum()):6}{int(right.sum()):11}{int(plain_right.sum()):9}"
                    f"{np.median(steps):8.0f}{np.mean(errors):9.3f}{np.median(ratios):8.2f}"
                    f"{ratios.max():7.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
