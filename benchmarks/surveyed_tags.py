"""A robot among surveyed tags, one or two in view: pushed, lost at the start, with wrong labels.

    uv run python benchmarks/surveyed_tags.py [--seeds 24]      (docs/lost.md)

Sixteen tags at random places of a field of 16.5 x 8 m are known within a centimeter. The robot
drives along a smooth closed course with scans at 20 Hz, and a camera that sees tags within 5 m and
35 degrees to either side, the nearest two. Halfway it is pushed by 11 m; its odometry says nothing.
In the rows "half", eight of the tags are not in the map.
"noticed" counts runs that report the robot as lost; "found" those in which it is within 0.5 m and
0.2 rad, and not lost, at most 20 scans after a second tag was seen (of one tag alone, every pose on
a circle has the same observations); "scans" is their median number and the worst. The error is the
root mean square of the poses that do not count as lost, from then on: median and worst of the runs.
"sure, wrong" is the number of poses with a tag in view, not lost, more than half a meter off, and
more than four standard deviations, from the third scan with a tag on.
"""

from dataclasses import replace
from itertools import count
from typing import NamedTuple

import numpy as np

from measuring import arguments
from saccade import slam
from saccade.plane import steps_between
from saccade.slam.filter.robot_models import wrap
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkMap

FIELD, TAGS, STEPS, PUSH = (16.5, 8.0), 16, 600, 11.0
STEP_SIGMA, RANGE_SIGMA, BEARING_SIGMA = np.array([0.003, 0.003, 0.003]), 0.03, 0.01
FAULTS = ("none", "pushed", "1% wrong", "5% wrong", "moved tag", "repeated tag")
LOST = "unknown start"
HALF = TAGS // 2
"""Number of surveyed tags, where half of them are not in the map."""


class Drive(NamedTuple):
    """A drive of a robot among tags."""

    tags: FloatArray
    truth: FloatArray
    control: FloatArray
    scans: list[tuple[FloatArray, FloatArray, IntArray]]


def course(rng: np.random.Generator, begin: float, steps: int) -> FloatArray:
    """(steps, 3) poses on an ellipse within the field, at 1 m/s."""
    angle = begin + np.arange(steps) / 100 * 1.0
    a, b = rng.uniform(3.5, 6.5), rng.uniform(1.5, 3.0)
    x, y = 8.25 + a * np.cos(angle), 4 + b * np.sin(angle)
    return np.stack([x, y, np.arctan2(b * np.cos(angle), -a * np.sin(angle))], 1)


def pushed_to(rng: np.random.Generator, pose: FloatArray) -> FloatArray:
    """A pose in the field at a distance of 11 m, or less where no point is that far."""
    for attempt in count():
        angle = rng.uniform(-np.pi, np.pi)
        distance = PUSH * 0.99 ** (attempt // 100)
        xy = pose[:2] + distance * np.array([np.cos(angle), np.sin(angle)])
        if (xy > 0.5).all() and (xy < np.array(FIELD) - 0.5).all():
            return np.append(xy, rng.uniform(-np.pi, np.pi))
    raise AssertionError


def drive(seed: int, fault: str, max_tags: int = 2) -> Drive:
    """A drive with a fault; the robot goes on with the same motions after a push."""
    rng = np.random.default_rng(seed)
    tags = rng.uniform([0, 0], FIELD, (TAGS, 2))
    truth = course(rng, rng.uniform(-np.pi, np.pi), STEPS)
    steps = steps_between(truth)
    if fault == "pushed":
        half = STEPS // 2
        while True:
            truth[half] = pushed_to(rng, truth[half - 1])
            for k in range(half, STEPS - 1):
                truth[k + 1] = slam.compose(truth[k], steps[k])[0]
            if (np.abs(truth[:, :2] - np.array(FIELD) / 2) < np.array(FIELD) / 2 + 2).all():
                break
            steps[half:, 2] = rng.uniform(-0.05, 0.05)
    scans = [scan(rng, tags, pose, fault, max_tags) for pose in truth]
    return Drive(tags, truth, steps + STEP_SIGMA * rng.standard_normal(steps.shape), scans)


def scan(
    rng: np.random.Generator, tags: FloatArray, pose: FloatArray, fault: str, max_tags: int
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The observations from a pose, their covariances and labels."""
    places, labels = tags.copy(), np.arange(len(tags))
    if fault == "moved tag":
        places[0] += [2.0, 1.0]
    if fault == "repeated tag":
        places, labels = np.vstack([tags, FIELD - tags[:1]]), np.append(labels, 0)
    z, _ = slam.observe(pose, places)
    seen = np.flatnonzero((z[:, 0] < 5) & (z[:, 0] > 0.3) & (np.abs(z[:, 1]) < np.deg2rad(35)))
    seen = seen[np.argsort(z[seen, 0])][:max_tags]
    sigma = np.stack([RANGE_SIGMA * (1 + z[seen, 0]) / 2, np.full(len(seen), BEARING_SIGMA)], 1)
    noisy, label = z[seen] + sigma * rng.standard_normal((len(seen), 2)), labels[seen]
    if fault.endswith("wrong"):
        wrong = rng.random(len(seen)) < float(fault.split("%")[0]) / 100
        label = np.where(wrong, rng.integers(0, TAGS, len(seen)), label)
    return noisy, sigma[:, :, None] ** 2 * np.eye(2), label


class Followed(NamedTuple):
    """The estimates of a drive."""

    error: FloatArray
    """(t,) meters."""
    turn: FloatArray
    """(t,) radians."""
    wrong: BoolArray
    """(t,) sure and wrong."""
    lost: BoolArray
    observed: BoolArray


def follow(
    driven: Drive, start: FloatArray | None, config: slam.EkfConfig, surveyed: int = TAGS
) -> Followed:
    """Localizes a drive step by step in a map of the first tags."""
    covariance = np.tile(1e-4 * np.eye(2), (surveyed, 1, 1))
    known = LandmarkMap(np.arange(surveyed), driven.tags[:surveyed], covariance)
    config = replace(config, start_sigma=(0.05, 0.05, 0.02))
    robot = slam.Slam(config, map=known, start=start, mode="localize")
    rows, U = [], np.diag(STEP_SIGMA**2)
    for k, (z, R, labels) in enumerate(driven.scans):
        motion = (driven.control[k - 1], U) if k else ()
        step = robot.step(0.05 * k, *motion, z=z, R=R, labels=labels)
        e = step.pose - driven.truth[k]
        far = float(np.hypot(*e[:2]))
        sigma = float(np.sqrt(step.covariance[:2, :2].trace()))
        sure = not step.lost and far > 0.5 and far > 4 * sigma
        seen = bool((labels < surveyed).any())
        rows.append((far, abs(float(wrap(e[2]))), sure, step.lost, seen))
    error, turn, wrong, lost, observed = (np.array(each) for each in zip(*rows, strict=True))
    return Followed(error, turn, wrong, lost, observed)


def scans_until_found(
    driven: Drive, found: Followed, begin: int, surveyed: int = TAGS
) -> tuple[float, int]:
    """Scans from the second tag until the robot is found, infinite if it is not; and the pose."""
    seen, second = set[int](), begin
    for second in range(begin, STEPS):
        seen.update(each for each in driven.scans[second][2].tolist() if each < surveyed)
        if len(seen) > 1:
            break
    right = ~found.lost & (found.error < 0.5) & (found.turn < 0.2)
    after = np.flatnonzero(right[second:])
    if len(after) == 0:
        return np.inf, STEPS - 1
    return float(found.observed[second : second + after[0] + 1].sum()), second + int(after[0])


def main() -> None:
    options = arguments(__doc__, seeds=24, first=0)
    print(
        f"{'fault':20}rule   runs  noticed  found  scans  worst  error  worst  sure, wrong   lost"
    )
    rows_of = [(fault, TAGS) for fault in (*FAULTS, LOST)] + [("pushed", HALF), (LOST, HALF)]
    for fault, surveyed in rows_of:
        for rule in ("auto", "known"):
            begin, rows = STEPS // 2 if fault == "pushed" else 0, []
            for seed in range(options.first, options.first + options.seeds):
                driven = drive(seed, fault)
                start = None if fault == LOST else driven.truth[0]
                found = follow(driven, start, slam.EkfConfig(association=rule), surveyed)
                scans, at = scans_until_found(driven, found, begin, surveyed)
                error = found.error[at:][~found.lost[at:]]
                wrong = (found.wrong & found.observed)[np.cumsum(found.observed) > 2]
                if fault == "pushed":
                    third = np.flatnonzero(found.observed[begin:])[2] + begin
                    wrong = (found.wrong & found.observed)[third:]
                rms = np.sqrt(np.mean(error**2)) if len(error) else np.inf
                rows.append(
                    (found.lost.any(), scans <= 20, scans, rms, wrong.sum(), found.lost.sum())
                )
            noticed, right, scans, errors, wrong, lost = np.transpose(rows)
            print(
                f"{fault + ', half' * (surveyed < TAGS):20}{rule:6}{len(rows):5}"
                f"{int(noticed.sum()):9}{int(right.sum()):7}"
                f"{np.median(scans):7.0f}{scans.max():7.0f}{np.median(errors):7.2f}"
                f"{errors.max():7.2f}{int(wrong.sum()):13}{int(lost.sum()):7}",
                flush=True,
            )


if __name__ == "__main__":
    main()
