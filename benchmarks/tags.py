"""Tags in rendered rooms: maps, localization, kidnapping, noise and time (docs/tags.md).

    uv run python benchmarks/tags.py [--rooms 3] [--frames 351] [--halls 4]

Rooms of 9 x 7 m with 14 tags of 16.5 cm on their walls are rendered by homographies, independently
of `saccade.simulation`, with lens distortion, blur and noise (tests/support/tag_rooms.py): 640 x
480 px, odometry with 1 % scale error and a drift of .8 degrees per meter. RMSE of the position in
meters, without alignment: by odometry; of a map made from the tags; in the surveyed layout; in the
layout with a robot that is carried away once; and with a camera that pans by 30 degrees. `size` is
the estimated error of a tag size that is declared 3 % too large. `ms` is the time of a detection
in milliseconds of one processor. Halls of the gaze have six tags: `drive` without and with tags.
"""

import sys
from dataclasses import replace
from pathlib import Path
from time import process_time

import cv2
import numpy as np

from measuring import arguments
from saccade import Tags, slam, visual
from saccade.diagnostics.tag_calibration import calibrate_tags
from saccade.simulation import DriveConfig, simulate_drive
from saccade.tags import TagConfig, observe_tags
from saccade.types import Trajectory

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.tag_rooms import Room, camera_of, carried, drive_of

SIZE = 0.165
"""Side of the tags in meters."""


def rmse(trajectory: Trajectory, truth: Trajectory) -> float:
    """Root mean square of the position error in meters."""
    difference = trajectory.pose[:, :2] - truth.pose[:, :2]
    return float(np.sqrt(np.square(difference).sum(1).mean()))


def measure_room(seed: int, frames: int) -> dict[str, float]:
    """Figures of one room."""
    room = Room(seed=seed, frames=frames)
    log = observe_tags(drive_of(room), TagConfig(size=SIZE)).log
    made = slam.run(log)
    located = slam.run(log, initial=slam.Slam(map=room.survey, mode="localize"))
    moved = carried(log, frames // 2, frames // 2 + frames // 4)
    found = slam.run(moved, initial=slam.Slam(map=room.survey, mode="localize"))
    pan = tuple(np.full(frames, np.deg2rad(30)))
    turned = observe_tags(drive_of(replace(room, pan=pan)), TagConfig(size=SIZE)).log
    panned = slam.run(turned, initial=slam.Slam(map=room.survey, mode="localize"))
    wrong = observe_tags(drive_of(room), TagConfig(size=1.03 * SIZE))
    error = calibrate_tags(wrong.log, wrong.axis, room.survey)
    return {
        "odometry": rmse(made.dead_reckoning, room.truth),
        "map": rmse(made.trajectory, room.truth),
        "tags": len(made.map),
        "layout": rmse(located.trajectory, room.truth),
        "carried": rmse(found.trajectory, moved.truth),
        "pan": rmse(panned.trajectory, room.truth),
        "size %": float("nan") if error is None else 100 * float(error.value[0]),
        "ms": milliseconds(room),
    }


def milliseconds(room: Room) -> float:
    """Time of a detection."""
    cv2.setNumThreads(1)
    detector, camera = Tags(TagConfig(size=SIZE)), camera_of(room)
    images = [room.image(i) for i in range(0, 100, 10)]
    times = []
    for image in images * 2:
        start = process_time()
        detector(image, camera)
        times.append(process_time() - start)
    return 1000 * float(np.median(times))


def measure_hall(seed: int) -> dict[str, float]:
    """Errors of `drive` in a hall without and with the use of its six tags."""
    drive = simulate_drive(replace(DriveConfig.hall(), tags=6), seed)
    without = visual.run(drive)
    tags = visual.run(drive, tags=TagConfig(size=DriveConfig().tag_size))
    assert drive.truth is not None
    return {
        "drive": rmse(without.trajectory, drive.truth),
        "with tags": rmse(tags.trajectory, drive.truth),
        "tags": len(tags.tags),
    }


def main() -> None:
    """Print a table of rooms and one of halls."""
    given = arguments(__doc__, rooms=3, frames=351, halls=4)
    for name, count, measure in (
        ("room", given.rooms, lambda seed: measure_room(seed, given.frames)),
        ("hall", given.halls, measure_hall),
    ):
        rows = []
        for seed in range(1, count + 1):
            rows.append(measure(seed))
            if seed == 1:
                print(name, *rows[0], sep="\t")
            print(seed, *(f"{value:.3f}" for value in rows[-1].values()), sep="\t", flush=True)
        if rows:
            means = (np.mean([row[key] for row in rows]) for key in rows[0])
            print("mean", *(f"{value:.3f}" for value in means), sep="\t")


if __name__ == "__main__":
    main()
