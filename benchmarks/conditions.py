"""Simulated drives as people film them: right, reported or wrong (docs/conditions.md).

    uv run python benchmarks/conditions.py [--only vehicle still] [--seeds 0 1] [--frames 120]

A drive is right if its error is at most twice that of the better one of odometry and 2 % of the
path, after alignment, and nine tenths of the true positions are inside their 99.7 % ellipses. It is
reported if it is not, and a warning or an error of `saccade drive` says why. Otherwise it is wrong
and silent. Without a known scale the alignment includes it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from measuring import arguments
from saccade import visual
from saccade.datasets.drives.folder import assume_speed
from saccade.diagnostics import drop_repeated, mapping_findings
from saccade.errors import ImageError
from saccade.evaluation.trajectory import path_length, score_drive
from saccade.frames import Drive, Frame
from saccade.simulation import DriveConfig, simulate_drive
from saccade.types import Image

MAX_ERROR = 0.02
"""Largest error of a drive that is right, as a fraction of its path."""
MIN_INSIDE = 0.9
"""Least fraction of its true positions inside their ellipses."""
Change = Callable[[Drive, np.random.Generator], Drive]


@cache
def lap(seed: int, frames: int, per_lap: int = 300, size: tuple[int, int] = (320, 240)) -> Drive:
    """A simulated lap, whose frames are rendered once."""
    drive = simulate_drive(
        DriveConfig(frames=frames, frames_per_lap=per_lap, image_size=size), seed
    )
    return replace(drive, load=cache(drive.load))


def images(change: Callable[[int, Image], Image]) -> Change:
    """Changes every image by its frame number."""

    def apply(drive: Drive, _: np.random.Generator) -> Drive:
        def load(i: int) -> Frame:
            frame = drive.load(i)
            right = None if frame.right is None else change(i, frame.right)
            return replace(frame, image=change(i, frame.image), right=right)

        return replace(drive, load=load)

    return apply


def during(first: float, last: float, change: Callable[[int, Image], Image]) -> Change:
    """Changes the images in a part of the drive, given by fractions of its frames."""

    def apply(drive: Drive, rng: np.random.Generator) -> Drive:
        a, b = (
            round(first * len(drive)),
            max(round(last * len(drive)), round(first * len(drive)) + 1),
        )
        return images(lambda i, image: change(i, image) if a <= i < b else image)(drive, rng)

    return apply


def noise(level: float, sigma: float) -> Callable[[int, Image], Image]:
    """An image of a gray level and noise alone."""

    def make(i: int, image: Image) -> Image:
        rng = np.random.default_rng(i)
        return rng.normal(level, sigma, image.shape).clip(0, 255).astype(np.uint8)

    return make


def garbled(i: int, image: Image) -> Image:
    """Random pixels."""
    return np.random.default_rng(i).integers(0, 256, image.shape, np.uint8)


def objects(left_edge: Callable[[int], int], disparity: int = 12) -> Change:
    """A textured square of 180 pixels, 2.9 m ahead, whose left edge depends on the frame."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.integers(0, 255, (180, 180), np.uint8), (0, 0), 2)
    texture = cv2.normalize(texture, None, 20, 235, cv2.NORM_MINMAX)

    def paste(image: Image, x: int) -> Image:
        image = image.copy()
        first, last = max(x, 0), min(x + 180, image.shape[1])
        if last > first:
            image[20:200, first:last] = texture[:, first - x : last - x]
        return image

    def apply(drive: Drive, _: np.random.Generator) -> Drive:
        def load(i: int) -> Frame:
            frame, x = drive.load(i), left_edge(i)
            right = None if frame.right is None else paste(frame.right, x - disparity)
            return replace(frame, image=paste(frame.image, x), right=right)

        return replace(drive, load=load)

    return apply


def single(drive: Drive, _: np.random.Generator) -> Drive:
    """The left camera alone."""
    camera = replace(drive.camera, baseline=0.0)
    return replace(drive, camera=camera, load=lambda i: replace(drive.load(i), right=None))


def no_odometry(drive: Drive, _: np.random.Generator) -> Drive:
    """The images alone."""
    seconds = np.diff(drive.time)
    sigma = np.outer(seconds, (2.0, 2.0, 1.0))
    drive = replace(
        drive,
        control=0 * drive.control,
        control_covariance=np.square(sigma)[:, :, None] * np.eye(3),
        has_odometry=False,
        odometry_bias=(0.0, 0.0, 0.0),
    )
    return assume_speed(drive)


def standing(first: float, last: float) -> Change:
    """Stands in a part of the drive, at its first pose."""

    def apply(drive: Drive, _: np.random.Generator) -> Drive:
        a, b = round(first * len(drive)), round(last * len(drive))
        order = np.r_[:a, np.full(b - a, a), a : len(drive) - (b - a)]
        control = drive.control[np.maximum(np.minimum(order[1:], len(drive) - 1) - 1, 0)].copy()
        covariance = drive.control_covariance[np.maximum(order[1:] - 1, 0)].copy()
        still = order[1:] == order[:-1]
        control[still], covariance[still] = 0.0, np.diag([1e-6, 1e-6, 1e-7])
        truth = replace(drive.truth, pose=drive.truth.pose[order])

        def load(i: int) -> Frame:
            frame = drive.load(int(order[i]))
            rng = np.random.default_rng(i)
            left, right = (
                None if each is None else (each + rng.normal(0, 2, each.shape)).clip(0, 255)
                for each in (frame.image, frame.right)
            )
            right = None if right is None else right.astype(np.uint8)
            return replace(
                frame, time=float(drive.time[i]), image=left.astype(np.uint8), right=right
            )

        made = {"control": control, "control_covariance": covariance, "truth": truth, "load": load}
        return replace(drive, **made)

    return apply


def thinned(kept: Callable[[int], bool]) -> Change:
    """Some frames cannot be read."""

    def apply(drive: Drive, _: np.random.Generator) -> Drive:
        def load(i: int) -> Frame:
            if not kept(i):
                raise ImageError(f"{i:06d}.png: cannot be read: no such file")
            return drive.load(i)

        return replace(drive, load=load)

    return apply


def late(frames: int) -> Change:
    """Odometry that is late by some frames."""

    def apply(drive: Drive, _: np.random.Generator) -> Drive:
        return replace(drive, control=np.roll(drive.control, frames, 0))

    return apply


def camera(**changes: Callable[[Drive], object]) -> Change:
    """Another calibration."""

    def apply(drive: Drive, _: np.random.Generator) -> Drive:
        values = {name: value(drive) for name, value in changes.items()}
        return replace(drive, camera=replace(drive.camera, **values))

    return apply


def yawed(drive: Drive) -> object:
    """The rotation of a camera that is turned by 8 degrees."""
    R = cv2.Rodrigues(np.array([0.0, 0.0, np.radians(8)]))[0]
    return R @ drive.camera.rotation


def swapped(drive: Drive, _: np.random.Generator) -> Drive:
    """The left and the right images are exchanged."""

    def load(i: int) -> Frame:
        frame = drive.load(i)
        return replace(frame, image=frame.right, right=frame.image)

    return replace(drive, load=load)


def slipping(drive: Drive, _: np.random.Generator) -> Drive:
    """The wheels turn twice as far in a fifth of the drive."""
    control, n = drive.control.copy(), len(drive)
    control[2 * n // 5 : 3 * n // 5, :2] *= 2
    return replace(drive, control=control)


def jumping(drive: Drive, _: np.random.Generator) -> Drive:
    """Odometry jumps once by 2 m."""
    control = drive.control.copy()
    control[len(control) // 2] += (2.0, 0.0, 0.5)
    return replace(drive, control=control)


def turned_sign(drive: Drive, _: np.random.Generator) -> Drive:
    """The turns of odometry have the other sign."""
    return replace(drive, control=drive.control * (1, 1, -1))


def wide(i: int, image: Image) -> Image:
    """16 bits."""
    return image.astype(np.uint16) * 256


def compressed(i: int, image: Image) -> Image:
    """JPEG of quality 20."""
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 20])[1]
    return cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)


def exposed(i: int, image: Image) -> Image:
    """The exposure sweeps by a factor of 4."""
    return cv2.convertScaleAbs(image, alpha=2.0 ** np.sin(i / 8))


@dataclass(frozen=True)
class Condition:
    """How a drive differs from an undisturbed one."""

    changes: tuple[Change, ...] = ()
    per_lap: int = 300
    """Frames per lap, by which the speed changes."""
    size: tuple[int, int] = (320, 240)
    """Width and height of the images in pixels."""


BLACK, WHITE = noise(8, 2), noise(200, 6)
CONDITIONS = {
    "undisturbed": Condition(),
    "one camera": Condition((single,)),
    "no odometry": Condition((no_odometry,)),
    "one camera, no odometry": Condition((single, no_odometry)),
    "exposure sweeps": Condition((images(exposed),)),
    "blur of 2 pixels": Condition((images(lambda i, image: cv2.GaussianBlur(image, (0, 0), 2)),)),
    "JPEG of quality 20": Condition((images(compressed),)),
    "16 bits": Condition((images(wide),)),
    "1280 x 960 pixels": Condition(size=(1280, 960)),
    "every third frame is missing": Condition((thinned(lambda i: i % 3 != 2),)),
    "1 s without frames": Condition((thinned(lambda i: not 40 <= i < 50),)),
    "covered lens": Condition((during(0.5, 0.67, BLACK),)),
    "covered lens, no odometry": Condition((no_odometry, during(0.5, 0.67, BLACK))),
    "covered lens, one camera": Condition((single, during(0.5, 0.67, BLACK))),
    "covered lens, one camera, no odometry": Condition(
        (single, no_odometry, during(0.5, 0.67, BLACK))
    ),
    "white wall, no odometry": Condition((no_odometry, during(0.3, 0.8, WHITE))),
    "garbled frame": Condition((during(0.5, 0.5, garbled),)),
    "garbled frame, no odometry": Condition((no_odometry, during(0.5, 0.5, garbled))),
    "garbled frame, one camera, no odometry": Condition(
        (single, no_odometry, during(0.5, 0.5, garbled))
    ),
    "standing": Condition((standing(0.3, 0.7),)),
    "standing, one camera": Condition((single, standing(0.0, 1.0))),
    "standing, one camera, no odometry": Condition((single, standing(0.0, 1.0), no_odometry)),
    "standing first, one camera, no odometry": Condition((single, standing(0, 0.3), no_odometry)),
    "vehicle ahead": Condition((objects(lambda i: 70),)),
    "vehicle ahead, one camera": Condition((single, objects(lambda i: 70))),
    "vehicle ahead, no odometry": Condition((no_odometry, objects(lambda i: 70))),
    "object passes": Condition((objects(lambda i: 320 - 8 * (i - 30) if i > 30 else 400),)),
    "object passes, no odometry": Condition(
        (no_odometry, objects(lambda i: 320 - 8 * (i - 30) if i > 30 else 400))
    ),
    "odometry .3 s late": Condition((late(3),)),
    "turns of odometry reversed": Condition((turned_sign,)),
    "wheels slip": Condition((slipping,)),
    "odometry jumps": Condition((jumping,)),
    "cameras swapped": Condition((swapped,)),
    "focal length 5 % too long": Condition(
        (camera(fx=lambda d: 1.05 * d.camera.fx, fy=lambda d: 1.05 * d.camera.fy),)
    ),
    "camera turned by 8 degrees": Condition((camera(rotation=yawed),)),
    "1 mm a frame": Condition(per_lap=30_000),
    "fast lap": Condition(per_lap=60),
    "fast lap, one camera, no odometry": Condition((single, no_odometry), per_lap=60),
}
"""Conditions by name."""


def conditioned(name: str, seed: int, frames: int) -> Drive:
    """The drive of a condition."""
    condition = CONDITIONS[name]
    drive = lap(seed, frames, condition.per_lap, condition.size)
    for change in condition.changes:
        drive = change(drive, np.random.default_rng(seed))
    return drop_repeated(replace(drive, name=name))


def verdict(name: str, seed: int, frames: int) -> tuple[str, str]:
    """Whether a drive is right, reported or wrong; and its row."""
    drive = conditioned(name, seed, frames)
    result = visual.run(drive)
    score = score_drive(result.trajectory, drive.truth, scale_known=drive.scale == "metric")
    inside = None if np.isnan(score.inside_3sigma) else score.inside_3sigma
    allowed = MAX_ERROR * float(path_length(drive.truth.pose[:, :2])[-1])
    wheels = "-"
    if drive.has_odometry:
        error = score_drive(result.odometry, drive.truth).ate_m
        allowed, wheels = max(allowed, 2 * error), f"{error:.3f}"
    findings = mapping_findings(drive, result, inside)
    moved = float(path_length(result.trajectory.pose[:, :2])[-1])
    good = score.ate_m <= max(allowed, 0.01) and (inside is None or inside >= MIN_INSIDE)
    found = "right" if good else "reported" if findings or result.remarks else "wrong"
    reports = ", ".join(dict.fromkeys(each.check for each in findings)) or "-"
    within = "-" if inside is None else f"{100 * inside:.0f} %"
    row = (
        f"| {name} | {found} | {score.ate_m:.3f} | {wheels} | {within} | {moved:.2f} | {reports} |"
    )
    return found, row


def main() -> None:
    given = arguments(__doc__, only={"nargs": "*", "default": [""]}, seeds=[0], frames=120)
    print("| drive | verdict | ATE, m | wheels, m | inside | path, m | findings |")
    print("|---|---|---|---|---|---|---|")
    count = {"right": 0, "reported": 0, "wrong": 0}
    with visual.dedicated_process():
        for name in CONDITIONS:
            for seed in given.seeds if any(each in name for each in given.only) else ():
                found, row = verdict(name, seed, given.frames)
                count[found] += 1
                print(row, flush=True)
    print(", ".join(f"{number} {name}" for name, number in count.items()))


if __name__ == "__main__":
    main()
