"""Findings on a mapped drive: where neither images nor odometry determined its motion or scale."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.checks import check_drive
from saccade.diagnostics.findings import Finding, counted
from saccade.frames import Drive
from saccade.types import BoolArray
from saccade.visual import VisualResult
from saccade.visual.contradictions import StepSource

MIN_SECONDS = 0.5
"""Minimum duration without images that determine the motion, in seconds."""
MIN_STEP_FRACTION = 0.05
"""Minimum fraction of such steps in a drive, if all of them are short."""
MIN_CONTRADICTIONS = 0.02
"""Minimum fraction of steps in which images and odometry contradict each other."""
MIN_DIVIDED = 0.1
"""Minimum fraction of steps in which the image is divided, without odometry."""
MAX_SCALE_DRIFT = 0.1
"""Maximum relative standard deviation of a scale that is held."""
MIN_INSIDE = 0.9
"""Minimum fraction of true positions inside the 99.7 % ellipses."""
STANDING = 0.95
"""Minimum fraction of steps of a camera that does not move."""

CHECKED_FRAMES = 80
"""Number of images that are checked after a drive is mapped."""


def mapping_findings(drive: Drive, result: VisualResult, inside: float | None) -> list[Finding]:
    """Errors and warnings of a mapped drive and of `check_drive`; see `check_mapping`."""
    found = [*check_mapping(drive, result, inside)]
    if len(drive) > 1:
        found += check_drive(drive, CHECKED_FRAMES).findings
    return [each for each in found if each.severity != "note" and each.what not in drive.remarks]


def check_mapping(drive: Drive, result: VisualResult, inside: float | None) -> Iterator[Finding]:
    """Findings on a run.

    Args:
        drive: the drive.
        result: its map and trajectory.
        inside: fraction of true positions inside the 99.7 % ellipses; None without truth.
    """
    sources = result.sources
    dropped = sources == StepSource.DROPPED
    if dropped.any():
        what = f"{counted(int(dropped.sum()), 'image contradicts', 'images contradict')} "
        what += "the images before and after"
        yield Finding.in_frames("dropped frames", what, np.flatnonzero(dropped))
    blind = np.isin(sources, (StepSource.ODOMETRY, StepSource.UNKNOWN)) | dropped
    yield from _check_blind(drive, blind)
    if drive.has_odometry:
        yield from _check_contradictions(drive, result)
    yield from _check_divided(result)
    yield from _check_standstill(drive, result)
    drift = float(result.scale_drift.max(initial=0.0))
    if drift > MAX_SCALE_DRIFT:
        first = int(np.argmax(result.scale_drift > MAX_SCALE_DRIFT))
        seconds = float(drive.time[first] - drive.time[0])
        what = (
            f"the scale is not held: after {seconds:.1f} s its standard deviation exceeds "
            f"{100 * MAX_SCALE_DRIFT:.0f} %, at the end it is {100 * result.scale_drift[-1]:.0f} %"
        )
        yield Finding.of("scale drift", what, 100 * drift)
    if inside is not None and inside < MIN_INSIDE:
        what = f"only {100 * inside:.0f} % of the true positions are inside the 99.7 % ellipses"
        yield Finding.of("ellipses", what, 100 * inside)


def _check_blind(drive: Drive, blind: BoolArray) -> Iterator[Finding]:
    """Steps whose motion the images do not determine."""
    duration = np.append(0.0, np.diff(drive.time))[: len(blind)]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], blind, [False]])))
    spans = [float(duration[a:b].sum()) for a, b in edges.reshape(-1, 2)]
    longest = max(spans, default=0.0)
    fraction = float(blind[1:].mean()) if len(blind) > 1 else 0.0
    if longest < MIN_SECONDS and fraction < MIN_STEP_FRACTION:
        return
    name, rest = "motion unknown", "there is no odometry: the last speed is assumed to go on"
    if drive.has_odometry:
        name, rest = "motion by odometry", "odometry alone bridges them"
    what = (
        f"the images do not determine the motion for {sum(spans):.1f} s, {longest:.1f} s at a "
        f"time, and {rest}"
    )
    numbers = tuple(np.flatnonzero(blind).tolist())
    yield Finding.of(name, what, sum(spans), frames=numbers)


def _check_contradictions(drive: Drive, result: VisualResult) -> Iterator[Finding]:
    """Steps in which images and odometry contradict each other."""
    part = np.isin(result.sources, (StepSource.PART, StepSource.REJECTED))
    if part.mean() > MIN_CONTRADICTIONS:
        what = (
            f"a part of the image contradicts odometry in {100 * part.mean():.0f} % of the steps: "
            "something moves in it, such as a vehicle ahead"
        )
        yield Finding.in_frames("moving objects", what, np.flatnonzero(part))
    contradicted = result.sources == StepSource.CONTRADICTED
    if contradicted.mean() > MIN_CONTRADICTIONS:
        what = f"images and odometry contradict each other in {100 * contradicted.mean():.0f} % "
        what += "of the steps, and the images are used"
        yield Finding.in_frames("contradiction", what, np.flatnonzero(contradicted))


def _check_divided(result: VisualResult) -> Iterator[Finding]:
    """Steps in which the image is divided between two motions."""
    divided = result.sources == StepSource.DIVIDED
    if divided.mean() > MIN_DIVIDED:
        what = (
            f"a large part of the image moves otherwise than the rest in "
            f"{100 * divided.mean():.0f} % of the steps, and no odometry tells which is the world"
        )
        yield Finding.in_frames("divided images", what, np.flatnonzero(divided))


def _check_standstill(drive: Drive, result: VisualResult) -> Iterator[Finding]:
    """A camera that does not move, or not all the time."""
    still = result.sources[1:] == StepSource.STILL
    if drive.has_odometry:
        still = ~drive.control[: len(still)].any(1)
    if len(still) and still.mean() > STANDING:
        by = "odometry" if drive.has_odometry else "the images"
        what = f"the camera does not move, by {by}: there is no trajectory"
        yield Finding.of("no motion", what, 100 * float(still.mean()))
