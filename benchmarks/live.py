"""Latency and memory of `slam.Slam` on a robot with odometry at 1000 Hz (docs/live.md).

    OMP_NUM_THREADS=1 uv run python benchmarks/live.py [--minutes 10] [--landmarks 100 500]

A robot drives round a course at 2 m/s among landmarks, each within 8 m of it observed forty times a
second. Time is simulated: steps are taken one after the other, and the time of the processor is
measured for each. "Over 1 ms" is the fraction of the steps that take longer than the robot has;
memory is that of the process, after the first minute and at the end. The last line is of a robot
with scans and odometry at 20 Hz in a map of 2000 landmarks, where steps enter and leave submaps.
"""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from measuring import arguments
from saccade import slam
from saccade.types import FloatArray, IntArray

RATE = 1000
"""Steps per second."""
SCAN_INTERVAL = 25
"""Steps from a scan to the next."""
SPEED = 2.0
"""Speed in meters per second."""
REACH = 8.0
"""Range in meters."""
SPACING = 1.2
"""Length of the course for each landmark in meters."""
U = np.diag([0.02, 0.01]) ** 2
"""Covariance of distance and turn of one meter: 2 cm and 0.01 rad."""
SIGMA = np.array([0.05, 0.01])
R = np.diag(SIGMA) ** 2


class Step(NamedTuple):
    """Arguments of `Slam.step`."""

    time: float
    control: FloatArray | None
    U: FloatArray | None
    z: FloatArray | None = None
    R: FloatArray | None = None
    labels: IntArray | None = None


def robot(
    steps: int, landmarks: int, rate: int = RATE, interval: int = SCAN_INTERVAL, seed: int = 0
) -> Iterator[Step]:
    """What a robot passes to `Slam.step`; it starts at the origin with heading 0."""
    rng = np.random.default_rng(seed)
    radius = landmarks * SPACING / (2 * np.pi)
    angle = rng.uniform(0, 2 * np.pi, landmarks)
    away = radius + rng.uniform(1, 5, landmarks) * rng.choice([-1, 1], landmarks)
    world = np.column_stack([away * np.sin(angle), radius - away * np.cos(angle)])
    control = np.array([SPEED / rate, SPEED / rate / radius])
    noise = np.sqrt(U.diagonal() * SPEED / rate)
    for i in range(steps):
        turn = SPEED * i / rate / radius
        pose = np.array([radius * np.sin(turn), radius * (1 - np.cos(turn)), turn])
        step = Step(i / rate, None, None)
        if i > 0:
            step = step._replace(control=control + noise * rng.normal(size=2), U=U * SPEED / rate)
        if i % interval == 0:
            near = np.flatnonzero(np.hypot(*(world - pose[:2]).T) < REACH)
            z = slam.observe(pose, world[near])[0] + SIGMA * rng.normal(size=(len(near), 2))
            step = step._replace(z=z, R=R, labels=near)
        yield step


def resident() -> float:
    """Megabytes of memory of this process; NaN where the system does not say."""
    status = Path("/proc/self/statm")
    return int(status.read_text().split()[1]) * 4096 / 1e6 if status.exists() else float("nan")


def soak(live: slam.Slam, steps: Iterator[Step], count: int) -> tuple[FloatArray, list[float]]:
    """Seconds (count,) of each step, and the memory after every minute."""
    seconds, memory = np.empty(count), []
    for i, step in enumerate(steps):
        start = time.thread_time()
        live.step(*step)
        seconds[i] = time.thread_time() - start
        if (i + 1) % (60 * RATE) == 0:
            memory.append(resident())
    return seconds, memory


def main() -> None:
    given = arguments(__doc__, minutes=10, landmarks=[100, 500])
    count = given.minutes * 60 * RATE
    print("                                 milliseconds of a step")
    print(
        "landmarks  association  mapped   median   99 %  99.9 %     max  over 1 ms  scans   memory"
    )
    for landmarks in given.landmarks:
        for name in ("known", "mutual"):
            config = slam.EkfConfig(association=name)
            live = slam.Slam(config)
            soak(slam.Slam(config), robot(100, landmarks), 100)  # compiles
            seconds, memory = soak(live, robot(count, landmarks), count)
            ms = 1e3 * seconds
            median, most, nearly, longest = np.quantile(ms, (0.5, 0.99, 0.999, 1.0))
            scans = np.median(ms[::SCAN_INTERVAL])
            print(
                f"{landmarks:9}  {name:11}{len(live.map):8}{median:9.3f}{most:7.3f}{nearly:8.3f}"
                f"{longest:8.2f}{(ms > 1).mean():11.4%}{scans:7.3f}"
                f"{memory[0]:7.0f} -> {memory[-1]:.0f} MB",
                flush=True,
            )
    large_map()


def large_map(landmarks: int = 2000, rate: int = 20, count: int = 4000) -> None:
    """Prints the steps of a robot in a large map, after a lap with two steps to the meter."""
    live = slam.Slam()
    lap = int(landmarks * SPACING * 2)
    soak(live, robot(lap + 1, landmarks, rate=4, interval=1), lap + 1)
    later = (step._replace(time=lap + step.time) for step in robot(count, landmarks, rate, 1))
    ms = 1e3 * soak(live, later, count)[0]
    median, most, longest = np.quantile(ms, (0.5, 0.99, 1.0))
    print(f"{len(live.map)} landmarks, {rate} Hz: {median:.2f}, 99 % {most:.2f}, max {longest:.1f}")


if __name__ == "__main__":
    main()
