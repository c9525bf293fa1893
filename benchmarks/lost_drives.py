"""Lost on a camera drive: kidnappings, and undisturbed drives (docs/lost.md).

    uv run python benchmarks/lost_drives.py [--seeds 100 101] [--presets ring dark]
    uv run python benchmarks/lost_drives.py --undisturbed --presets dark flicker --seeds 100 101 102

In the second lap of a simulated drive the robot is carried along its course, 0.3 to 5 m ahead or
back, while odometry reports nothing of it: at once, or during twelve black frames in which it
reports no motion. Or it is turned, by 35 or 90 degrees, and turns back by 9 degrees a frame. Each
time it drives on for 100 frames. It has noticed if it is lost in one of the frames from the first
black one to the tenth that sees the new place. It is recovered if, 50 frames after it sees its
course again, it is not lost, and the true position is in the 99.7 % ellipse or within 0.2 m, and
within 0.5 m or twice the error before. It is sure and wrong if the true position at the end is
neither in the ellipse nor within 0.2 m.

Undisturbed: the number of lost frames, and the fraction of the frames in the 99.7 % ellipse.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from measuring import arguments
from saccade import visual
from saccade.evaluation.trajectory import score_drive
from saccade.frames import Drive, Frame
from saccade.simulation import DriveConfig, simulate_drive
from saccade.simulation.drive import Illumination, render
from saccade.simulation.scene import floor_scene
from saccade.slam.consistency import normalized_squared
from saccade.types import THREE_SIGMA_2D, FloatArray, Trajectory

PRESETS = ("ring", "mono", "repeated", "mirror", "dark", "flicker")
KIDNAPPINGS = (
    *(("black", 0.5), ("jump", 0.35), ("turn", 35.0), ("black", 1.5), ("jump", 1.2)),
    *(("turn", -90.0), ("black", 3.5), ("jump", -2.5), ("jump", 5.0)),
)
"""Kinds, and metres along the course or degrees."""
FIRST, LAST = 306, 430
"""Frames between which a robot is kidnapped."""
AFTER, SOON, LATER = 100, 10, 50
"""Frames that it drives on, in which it must notice, and after which it must be recovered."""
BLACK, TURN_RATE = 12, 9.0
"""Black frames, and degrees a frame by which a turned robot turns back."""


class Source:
    """A simulated drive whose frames are rendered once, and views from other poses."""

    def __init__(self, preset: str, seed: int) -> None:
        self.config, self.seed = getattr(DriveConfig, preset)(), seed
        drive, self.has_right = simulate_drive(self.config, seed), self.config.baseline is not None
        self.drive = replace(drive, name=f"{preset} {seed}", load=cache(drive.load))
        scene, _, light, _ = np.random.SeedSequence(seed).spawn(4)
        self._scene = floor_scene(self.config, scene)
        camera = self.config.camera
        self._light = Illumination.sample(self.config.light, camera, drive.time, light)

    def view(self, pose: FloatArray, i: int) -> Frame:
        """The frame from a pose (3,) in the light of frame i."""
        left, right = (
            self._light.apply(render(self._scene, self.config.camera, pose, side), i, int(side))
            for side in (False, True)
        )
        return Frame(0.0, left, right if self.has_right else None)


@dataclass
class Course:
    """Poses, increments and frames of a robot that is kidnapped."""

    source: Source
    rows: list[tuple[FloatArray, FloatArray, FloatArray, Callable[[], Frame]]] = field(
        default_factory=list
    )
    """Pose, increment before it, covariance, and frame."""

    def follow(self, first: int, end: int) -> None:
        """Drive on as the recorded one; the first frame is reached by the increment before it."""
        drive = self.source.drive
        for i in range(first, min(end, len(drive))):
            step = max(i - 1, 0)
            self.add(i, drive.truth.pose[i], drive.control[step], drive.control_covariance[step])

    def add(
        self,
        i: int,
        pose: FloatArray,
        control: FloatArray,
        covariance: FloatArray,
        load: Callable[[], Frame] | None = None,
    ) -> None:
        """A frame at a pose (3,), by default frame i of the drive."""
        self.rows.append((pose, control, covariance, load or (lambda: self.source.drive.load(i))))

    def drive(self, name: str) -> Drive:
        """The drive."""
        time = self.source.drive.time[0] + 0.1 * np.arange(len(self.rows))
        pose, control, covariance, load = zip(*self.rows, strict=True)
        return replace(
            self.source.drive,
            name=name,
            time=time,
            control=np.array(control[1:]),
            control_covariance=np.array(covariance[1:]),
            load=lambda i: replace(load[i](), time=float(time[i])),
            truth=Trajectory(time, np.array(pose)),
        )


@dataclass(frozen=True)
class Kidnapping:
    """A drive, and the frames at which it happens."""

    drive: Drive
    last: int
    """The last frame before."""
    seen: int
    """The first frame that sees the new place."""
    back: int
    """The first frame on the course."""


def kidnap(source: Source, kind: str, amount: float, last: int) -> Kidnapping:
    """Kidnap the robot after a frame: metres along the course, or degrees."""
    truth, course = source.drive.truth, Course(source)
    assert truth is not None
    pose = truth.pose
    course.follow(0, last + 1)
    step = float(np.hypot(*np.diff(pose[:, :2], axis=0).T).mean())
    control, covariance = source.drive.control[last], source.drive.control_covariance[last]
    still, nothing = np.zeros(3), np.zeros((3, 3))
    following, seen = last + 1, last + 1
    if kind == "black":
        camera = source.drive.camera
        black = np.zeros((camera.height, camera.width), np.uint8)
        frame, moved = Frame(0.0, black, black if source.has_right else None), round(amount / step)
        for i in range(BLACK):
            place = pose[last + round(moved * (i + 1) / (BLACK + 1))]
            course.add(0, place, still, nothing, lambda: frame)
        following, seen = last + moved, last + BLACK + 1
        course.add(following, pose[following], still, nothing)
    elif kind == "jump":
        following += round(amount / step)
        course.add(following, pose[following], control, covariance)
    else:
        turns = np.radians(np.linspace(amount, 0, int(np.ceil(abs(amount) / TURN_RATE)) + 1))
        for number, turn in enumerate(turns.tolist()):
            turned = pose[following] + [0, 0, turn]
            back = np.array([0, 0, turns[number] - turns[number - 1]])
            course.add(
                following,
                turned,
                control if number == 0 else back,
                covariance if number == 0 else nothing,
                lambda turned=turned: source.view(turned, following),
            )
    back = len(course.rows) - 1
    course.follow(following + 1, following + 1 + AFTER)
    name = f"{source.drive.name}, {kind} {amount:g}"
    return Kidnapping(course.drive(name), last, seen, back)


def kidnappings(source: Source) -> Iterator[Kidnapping]:
    """All kinds of kidnapping at random frames."""
    rng = np.random.default_rng([source.seed, *map(ord, source.drive.name)])
    last = np.sort(rng.integers(FIRST, LAST, len(KIDNAPPINGS)))
    kinds = rng.permutation(len(KIDNAPPINGS))
    for number, kind in zip(last.tolist(), kinds.tolist(), strict=True):
        yield kidnap(source, *KIDNAPPINGS[kind], number)


def judge(each: Kidnapping, result: visual.VisualResult) -> tuple[bool, bool, bool]:
    """Whether the robot noticed, was recovered, and was sure and wrong at the end."""
    truth, estimate = each.drive.truth, result.trajectory
    assert truth is not None
    assert estimate.covariance is not None
    error = (estimate.pose - truth.pose)[:, :2]
    distance = np.hypot(*error.T)
    inside = normalized_squared(error[1:], estimate.covariance[1:, :2, :2]) < THREE_SIGMA_2D
    right = np.append(True, inside) | (distance < 0.2)
    noticed = result.lost[each.last + 1 : each.seen + SOON + 1].any()
    later = min(each.back + LATER, len(each.drive) - 1)
    near = distance[later] < max(0.5, 2 * distance[each.last])
    recovered = right[later] and near and not result.lost[later]
    return bool(noticed), bool(recovered), not right[-1]


def report_kidnappings(presets: Sequence[str], seeds: Sequence[int]) -> None:
    """Print a row for each preset, and one for all."""
    print("preset     kidnapped  noticed  recovered  sure and wrong")
    everything = []
    for preset in presets:
        rows = []
        for seed in seeds:
            for each in kidnappings(Source(preset, seed)):
                rows.append(judge(each, visual.run(each.drive)))
                if rows[-1] != (True, True, False):
                    print("    ", each.drive.name, "frame", each.last, *rows[-1])
        everything += rows
        _print_row(preset, rows)
    _print_row("all", everything)


def _print_row(name: str, rows: Sequence[tuple[bool, bool, bool]]) -> None:
    noticed, recovered, wrong = np.sum(rows, 0)
    print(f"{name:9}{len(rows):11}{noticed:9}{recovered:11}{wrong:16}", flush=True)


def report_undisturbed(drives: Iterator[Drive]) -> None:
    """A row for each drive, and how many were ever lost."""
    print("drive                      lost   ATE    unaligned  inside 3 sigma")
    rows = []
    for drive in drives:
        result = visual.run(drive)
        score = score_drive(result.trajectory, drive.truth)
        rows.append((result.lost.any(), score.inside_3sigma))
        print(
            f"{drive.name:26} {int(result.lost.sum()):4}{score.ate_m:7.3f}"
            f"{score.ate_unaligned_m:10.3f}{score.inside_3sigma:12.3f}",
            flush=True,
        )
    lost, inside = np.transpose(rows)
    print(f"{len(rows)} drives, {int(lost.sum())} ever lost; inside: {inside.mean():.3f}, "
          f"at least {inside.min():.3f}")  # fmt: skip


def main() -> None:
    given = arguments(
        __doc__,
        seeds=[100, 101],
        presets={"nargs": "+", "choices": PRESETS, "default": list(PRESETS)},
        undisturbed=False,
    )
    if given.undisturbed:
        pairs = ((preset, seed) for preset in given.presets for seed in given.seeds)
        report_undisturbed(Source(*pair).drive for pair in pairs)
    else:
        report_kidnappings(given.presets, given.seeds)


if __name__ == "__main__":
    main()
