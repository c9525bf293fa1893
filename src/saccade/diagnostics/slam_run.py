"""Checks of a SLAM run: labels, unused observations, innovations, scale and duplicates."""

from collections.abc import Iterator, Sequence
from math import hypot

import numpy as np
from scipy.spatial import cKDTree

from saccade.diagnostics.findings import Finding
from saccade.diagnostics.landmark_log import shared_name_finding
from saccade.plane import in_robot_frame, rotated, to_points
from saccade.slam import SlamResult
from saccade.slam.consistency import chi_square_gate
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkLog

MAX_TIMES = 5
"""Maximum number of corrections whose times are listed."""
MAX_UNUSED_FRACTION = 0.3
"""Maximum fraction of unused observations without a warning."""
MAX_DUPLICATES = 0.1
"""Maximum fraction of duplicate landmarks (same label or position) without a warning."""
MIN_TESTED_OBSERVATIONS = 50
"""Minimum number of observations for a test for changed labels."""
MIN_REJECTED = 0.04
"""Minimum fraction of rejected or unused labeled observations for that test."""
MIN_CHANGED = 0.15
"""Minimum fraction after the labels have changed; 5 % of wrong labels reach 0.1 in such a part."""
MIN_FRACTION_RATIO = 3.0
"""Minimum ratio of that fraction after and before the change."""
MIN_LABEL_OBSERVATIONS = 16
"""Minimum number of observations of a label for a comparison of their positions."""
MIN_MOVED_FRACTION = 0.1
"""Minimum fraction of a label's observations at its second position."""
MIN_SECOND = 0.005
"""Minimum number of observations at the second position, as a fraction of all observations."""
MIN_LABEL_REJECTED = 0.1
"""Minimum fraction of rejected observations of a shared label."""
POSSIBLE = 0.9999
"""Probability of the NIS gate for outliers."""
MIN_INNOVATIONS = 200
"""Minimum number of innovations for a test of their mean NIS."""
ALL_SIDES_NIS = 1.15
"""Maximum mean NIS over its degrees of freedom without a warning; correct logs reach 1.03."""
ONE_SIDED_NIS = 1.05
"""Maximum mean NIS over its degrees of freedom without a warning, for one-sided innovations."""
MIN_ONE_SIDED_MEAN = 0.1
"""Minimum mean of one-sided innovations, in standard deviations."""
MAX_DISAGREEMENT = 0.02
"""Maximum relative error of odometry distances without a warning."""
SCALE_SIGMAS = 4.0
"""Minimum ratio of that error to its standard deviation."""
MIN_POSITION_SEPARATION = 4.0
"""Minimum distance of two positions of a label, relative to their spread and uncertainty."""
MAX_ORDER = 0.6
"""Maximum difference of the mean ranks in time between two positions of a shared label; for a label
that changed position once it is 1."""


def check_run(
    log: LandmarkLog, result: SlamResult, causes: Sequence[Finding] = ()
) -> tuple[Finding, ...]:
    """Checks a run over a log.

    Args:
        log: the log.
        result: the result of the run.
        causes: the findings of `check_log`.

    Returns:
        The causes or, if empty, defects of the labels; then defects of the run. Notes on what
        could not be compared are no causes, and left out.
    """
    log, found = in_robot_frame(log), [each for each in causes if each.severity != "note"]
    if not found and (log.landmark >= 0).any():
        found += _check_names(log, result)
    return (*found, *_symptoms(log, result, known=bool(found)))


def _symptoms(log: LandmarkLog, result: SlamResult, known: bool) -> Iterator[Finding]:
    """Symptoms of a defective run; hints at a cause only if no cause is known."""
    observations, used = len(result.association), int((result.association >= 0).sum())
    if result.warning:
        unused = float(observations - used)
        yield Finding.of("map", result.warning, unused)
    elif observations - used > MAX_UNUSED_FRACTION * observations:
        what = f"{observations - used} of {observations} observations are not used"
        yield Finding.of("unused", what, float(observations - used))
    if result.lost is not None and len(result.lost) and result.lost[-1]:
        last = np.flatnonzero(~result.lost).max(initial=0)
        seconds = float(log.time[-1] - log.time[last])
        what = f"the run ends lost: the last {seconds:.1f} s rely on odometry alone"
        yield Finding.of("lost", what, seconds)
    yield from _check_moved(log, result)
    yield from _check_corrections(log, result)
    yield from _check_innovations(log, result, known)
    if not known:
        yield from _check_scale(log, result)
    yield from _check_duplicates(log, result)


def _check_moved(log: LandmarkLog, result: SlamResult) -> Iterator[Finding]:
    """Reports each time that the robot was lost and found again."""
    lost = np.zeros(0, np.bool_) if result.lost is None else result.lost
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(np.int64)))
    for first, end in edges.reshape(-1, 2).tolist():
        if first == 0 or end == len(lost):  # an unknown start, or an end that is lost
            continue
        x, y = (result.filtered.pose[end] - result.filtered.pose[end - 1])[:2].tolist()
        begin, found = (float(log.time[i] - log.time[0]) for i in (first, end))
        what = (
            f"the robot was moved, or its pose was wrong: from {begin:.1f} s on the observations "
            f"contradict it, and at {found:.1f} s it was found {hypot(x, y):.1f} m away"
        )
        yield Finding.of("moved", what, hypot(x, y))


def _check_corrections(log: LandmarkLog, result: SlamResult) -> Iterator[Finding]:
    """Reports the poses that labels corrected."""
    if result.corrections is None or not result.corrections.any():
        return
    poses = np.flatnonzero(result.corrections.any(1))
    distance = np.hypot(*result.corrections[poses, :2].T)
    turn = np.rad2deg(np.abs(result.corrections[poses, 2]))
    times = [f"{seconds:.1f}" for seconds in (log.time[poses] - log.time[0])[:MAX_TIMES]]
    more = f" and later ({len(poses)} times)" if len(poses) > MAX_TIMES else ""
    what = (
        "odometry led to a wrong pose: the labels of landmarks corrected it at "
        f"{', '.join(times)} s{more}, by up to {distance.max():.1f} m and {turn.max():.0f} degrees"
    )
    yield Finding.of("corrected", what, float(distance.max()))


def _check_innovations(log: LandmarkLog, result: SlamResult, known: bool) -> Iterator[Finding]:
    """Checks for innovations that are too large or one-sided, without outliers."""
    what, dof, nis = result.consistency.warning, result.consistency.dof, result.consistency.nis
    used = nis < chi_square_gate(dof, POSSIBLE)  # False for NaN
    mean, innovation = float(nis[used].mean()) if used.any() else 0.0, result.innovation[used]
    sigma = np.sqrt(result.innovation_covariance[used].diagonal(axis1=1, axis2=2))
    sides = (innovation / sigma).mean(0) if used.any() else np.zeros(2)  # range, bearing
    limit = ONE_SIDED_NIS if np.abs(sides).max() > MIN_ONE_SIDED_MEAN else ALL_SIDES_NIS
    if not what and used.sum() >= MIN_INNOVATIONS and mean > limit * dof:
        what = (
            f"the innovations are too large for the noise: their mean NIS is {mean:.2f}, not {dof}"
        )
    if not what:
        return
    advice = None
    if known:
        advice = "First correct the cause above"
    elif abs(sides[1]) > max(MIN_ONE_SIDED_MEAN, abs(sides[0])):
        degrees, side = np.rad2deg(innovation[:, 1].mean()), ("right", "left")[int(sides[1] > 0)]
        what += f"; bearings are on average {abs(degrees):.1f} degrees {side} of the predicted"
        advice = "Check the yaw of the sensor (--sensor), and whether odometry turns to one side"
    elif abs(sides[0]) > MIN_ONE_SIDED_MEAN:
        percent = 100 * float(innovation[:, 0].mean() / log.observation[used, 0].mean())
        side = ("shorter", "longer")[int(percent > 0)]
        what += f"; ranges are on average {abs(percent):.1f} % {side} than predicted"
        advice = "Check the scale of the ranges and of the distances of odometry"
    yield Finding.of("consistency", what, mean, advice=advice)


def _check_scale(log: LandmarkLog, result: SlamResult) -> Iterator[Finding]:
    """Checks the scale of ranges against odometry, if the log declares no odometry bias."""
    found, bias, errors = result.scale_disagreement, result.odometry_bias, result.range_errors
    if found is None or bias is None or errors is None or log.odometry_bias[0] > 0:
        return
    difference, sigma = found
    if abs(difference) > max(MAX_DISAGREEMENT, SCALE_SIGMAS * sigma):
        side = "longer" if difference > 0 else "shorter"
        what = (
            f"ranges are {100 * abs(difference):.1f} ± {100 * sigma:.1f} % {side} than expected "
            f"from odometry: either they are wrong (estimated {100 * errors[0]:+.1f} %), or the "
            f"distances of odometry are (true ones {100 * bias[0]:+.1f} %)"
        )
        yield Finding.of("scale", what, 100 * difference)


def _check_duplicates(log: LandmarkLog, result: SlamResult) -> Iterator[Finding]:
    """Checks for landmarks with the same label or at the same position."""
    landmarks, count = result.map, len(result.map)
    if count < 2:
        return
    used = result.association >= 0
    named = used & (log.landmark >= 0)
    if named.any():
        names, name = np.unique(log.landmark[named], return_inverse=True)
        votes = np.zeros((count, len(names)), np.int64)
        np.add.at(votes, (result.association[named], name), 1)
        winners = votes.argmax(1)[votes.any(1)]
        twice = len(winners) - len(np.unique(winners))
        if twice > max(2.0, MAX_DUPLICATES * count):
            what = f"{twice} of {count} landmarks have the label of another landmark"
            yield Finding.of("duplicate labels", what, float(twice))
        return
    if not used.any():
        return
    noise = _spread(log.observation[used], log.observation_covariance[used])
    nearest = np.asarray(cKDTree(landmarks.xy).query(landmarks.xy, k=2)[0])[:, 1]
    near = nearest < np.nanmedian(noise) / 2
    if near.sum() > max(2.0, 2 * MAX_DUPLICATES * count):
        what = f"{near.sum()} of {count} landmarks are at the position of another landmark"
        yield Finding.of("duplicate positions", what, float(near.sum()))


def _check_names(log: LandmarkLog, result: SlamResult) -> Iterator[Finding]:
    """Checks for labels that change or that several landmarks share."""
    unused = (log.landmark >= 0) & (result.association < 0)
    for rejected in (result.rejected, result.rejected | unused):
        change = _change(rejected, log.landmark)
        if change is not None:
            time = float(log.time[log.observation_pose[change]] - log.time[0])
            before = 100 * rejected[:change].mean()
            after = 100 * float(rejected[change:].mean())
            what = (
                f"labels change, or the robot was carried away, about {time:.0f} s after the first "
                f"pose: {after:.0f} % of the labels are unused after it, {before:.1f} % before"
            )
            yield Finding.of("labels change", what, time)
            return
    shared = sorted(_shared_names(log, result), key=lambda each: -each[1])
    if shared:
        names = [name for name, _, _ in shared]
        yield shared_name_finding(log, names, shared[0][2], "in turn")


def _change(rejected: BoolArray, names: IntArray) -> int | None:
    """First observation after the labels of many landmarks have changed, or None.

    It maximizes the increase of the fraction of rejected labels in the next fifth of the log.
    """
    count = len(rejected)
    if rejected.mean() <= MIN_REJECTED:
        return None
    total = np.concatenate([[0], np.cumsum(rejected)])
    at = np.arange(count // 10, 9 * count // 10)
    if count < MIN_TESTED_OBSERVATIONS:
        return None
    end = np.minimum(at + count // 5, count)
    before, after = total[at] / at, (total[end] - total[at]) / (end - at)
    best = int(np.argmax(after - before))
    if after[best] < max(MIN_CHANGED, MIN_FRACTION_RATIO * before[best]):
        return None
    first, last = int(at[best]), int(end[best])
    where = names[first:last][rejected[first:last]]
    most = np.unique(where, return_counts=True)[1].max(initial=0)
    return first if most < 0.5 * len(where) else None


def _shared_names(log: LandmarkLog, result: SlamResult) -> list[tuple[int, int, float]]:
    """Labels at two alternating positions: label, observations at the second, meters between."""
    pose = result.trajectory.pose[log.observation_pose]
    position = pose[:, :2] + rotated(to_points(log.observation), pose[:, 2])
    variance = np.square(_spread(log.observation, log.observation_covariance))
    if result.trajectory.covariance is not None:
        C = result.trajectory.covariance[log.observation_pose]
        turned = C[:, 2, 2] * np.square(log.observation[:, 0])
        variance += C[:, 0, 0] + C[:, 1, 1] + turned
    found = []
    for name in np.unique(log.landmark[log.landmark >= 0]).tolist():
        rows = np.flatnonzero((log.landmark == name) & np.isfinite(position[:, 0]))
        if len(rows) < MIN_LABEL_OBSERVATIONS:
            continue
        if result.rejected[rows].mean() < MIN_LABEL_REJECTED:
            continue
        second = _split(position[rows])
        fraction = min(second.mean(), 1 - second.mean())
        if fraction < MIN_MOVED_FRACTION or fraction * len(rows) < MIN_SECOND * len(log.landmark):
            continue
        order = np.flatnonzero(second).mean() - np.flatnonzero(~second).mean()
        if abs(order) > MAX_ORDER * len(rows) / 2:
            continue
        groups = position[rows][~second], position[rows][second]
        middles = [np.median(group, 0) for group in groups]
        widths = [np.median(np.hypot(*(g - m).T)) for g, m in zip(groups, middles, strict=True)]
        distance = float(np.hypot(*(middles[0] - middles[1])))
        uncertainty = float(np.sqrt(np.median(variance[rows])))
        if distance > MIN_POSITION_SEPARATION * max(*widths, uncertainty):
            found.append((name, int(fraction * len(rows)), distance))
    return found


def _split(xy: FloatArray) -> BoolArray:
    """(n,) True for points (n, 2) beyond the widest gap along their principal axis."""
    centered = xy - xy.mean(0)
    along = centered @ np.linalg.eigh(centered.T @ centered)[1][:, -1]
    ordered = np.sort(along)
    margin = int(np.ceil(MIN_MOVED_FRACTION * len(xy)))
    gaps = np.diff(ordered)[margin - 1 : len(xy) - margin]
    return np.asarray(along > ordered[margin - 1 + int(np.argmax(gaps))])


def _spread(observation: FloatArray, R: FloatArray) -> FloatArray:
    """(k,) standard deviations in meters of observations (k, 2)."""
    return np.asarray(np.sqrt(R[:, 0, 0] + R[:, 1, 1] * np.square(observation[:, 0])))
