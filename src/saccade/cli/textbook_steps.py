"""The steps of the textbook as figures: what `saccade textbook` and the documentation show."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from saccade.errors import LogError
from saccade.types import FloatArray, LandmarkLog
from saccade.viewing.contrast_steps import contrast_figures, place_in_image
from saccade.viewing.filter_steps import Belief, filter_figures
from saccade.viewing.sift_steps import FATES, sift_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCANS = 8
"""Of a log: as many are shown."""


def made_of(
    appendix: str, offer: Any, image: Any, log: LandmarkLog, *, draw: bool = True
) -> "tuple[dict[str, Figure], dict[str, dict[str, str]]]":
    """The figures of an appendix by step, and what came of it by step and name.

    Args:
        appendix: "A", "B" or "C".
        offer: `contrast_saliency`, `sift` or `EkfSlam`.
        image: (H, W, 3) in [0, 1], for A and B.
        log: for C.
        draw: whether there are to be figures.
    """
    if appendix == "C":
        trace = filter_trace(log, offer)
        return filter_figures(trace.steps, trace.scans) if draw else {}, filter_facts(trace)
    figures, facts = {
        "A": (contrast_figures, contrast_facts),
        "B": (sift_figures, sift_facts),
    }[appendix]
    result = offer(image)
    return figures(image, result) if draw else {}, facts(result)


def contrast_facts(result: Any) -> dict[str, dict[str, str]]:
    """What came of the steps of appendix A, by step and name."""
    x, y = place_in_image(result.saliency, result.channels["intensity"].shape[1])
    weights = [each.normalized.weight for each in result.features.values()]
    most = max(result.features, key=lambda key: result.features[key].normalized.weight)
    return {
        "normalization": {
            "mean weight of the 42 maps": f"{np.mean(weights):.3f}",
            "largest weight": f"{max(weights):.3f}, of {most[0]}, c = {most[1]}, s = {most[2]}",
        },
        "conspicuity": {
            "maximum of the saliency": f"{result.saliency.max():.3f} at x = {x}, y = {y}",
            "mean of the saliency": f"{result.saliency.mean():.3f}",
        },
    }


def sift_facts(result: Any) -> dict[str, dict[str, str]]:
    """What came of the steps of appendix B, by step and name."""
    statuses = [candidate.status for candidate in result.candidates]
    kept = statuses.count("kept")
    share = f", {len(result.keypoints) / kept:.2f} for each candidate kept" if kept else ""
    return {
        "candidates": {"candidates": str(len(statuses))}
        | {name: str(statuses.count(name)) for name in FATES},
        "orientation": {"keypoints": f"{len(result.keypoints)}{share}"},
    }


@dataclass
class FilterTrace:
    """What a filter did in the first scans of a log."""

    steps: "dict[str, tuple[Belief, Belief, FloatArray | None]]" = field(default_factory=dict)
    """The last "predict" and "augment" and the "update" that lessened the covariance most: the
    state before and after, and where the observation puts its landmark."""
    scans: list[tuple[str, Belief]] = field(default_factory=list)
    """The state after each scan."""


def filter_trace(log: LandmarkLog, make: Any, scans: int = SCANS) -> FilterTrace:
    """Run the filter of the textbook over the first scans of a log.

    Args:
        log: names its landmarks.
        make: an `EkfSlam`, the class.
        scans: poses with observations, at most.

    Raises:
        LogError: the log names no landmarks, or has another motion.
    """
    if log.motion == "custom" or (log.landmark < 0).any() or len(log.landmark) == 0:
        raise LogError(
            f"{log.name}: expected observations that name their landmarks, and controls that are "
            "distance and turn, as appendix C has them"
        )
    ekf, trace, most = make(log.start), FilterTrace(), -np.inf
    known: dict[int, int] = {}
    for pose in range(len(log.time)):
        before = _belief(ekf)
        for u, U in _controls(log, pose - 1) if pose else ():
            ekf.predict(u, U)
            trace.steps["predict"] = before, _belief(ekf), None
        seen = np.flatnonzero(log.observation_pose == pose)
        for index in seen:
            before, name = _belief(ekf), int(log.landmark[index])
            z, R = log.observation[index], log.observation_covariance[index]
            bearing = ekf.x[2] + z[1]
            place = np.array(ekf.x[:2] + z[0] * np.array([np.cos(bearing), np.sin(bearing)]))
            if name in known:
                ekf.update(known[name], z, R)
                after = _belief(ekf)
                if (gain := float(np.trace(before.P - after.P))) > most:
                    most, trace.steps["update"] = gain, (before, after, place)
            else:
                ekf.augment(z, R)
                known[name] = len(known)
                trace.steps["augment"] = before, _belief(ekf), place
        if len(seen):
            count = "1 landmark" if len(known) == 1 else f"{len(known)} landmarks"
            trace.scans.append((f"scan {len(trace.scans) + 1}: {count}", _belief(ekf)))
        if len(trace.scans) == scans:
            break
    return trace


def filter_facts(trace: FilterTrace) -> dict[str, dict[str, str]]:
    """What came of the steps of appendix C, by step and name."""
    last = trace.scans[-1][1]
    x, y, theta = last.s[:3]
    sigma = np.sqrt(np.diagonal(last.P)[:3])
    return {
        "state": {
            f"pose after {len(trace.scans)} scans": f"x = {x:.3f} ± {sigma[0]:.3f} m, "
            f"y = {y:.3f} ± {sigma[1]:.3f} m, heading {np.degrees(theta):.2f} "
            f"± {np.degrees(sigma[2]):.2f}°",
        }
    }


def small_world() -> LandmarkLog:
    """A robot that drives once round a heptagon among landmarks, under large noise."""
    rng = np.random.default_rng(5)
    landmarks = np.array([[2.6, -0.9], [3.6, 2.4], [1.2, 4.4], [-2.3, 3.0], [-1.4, -0.4]])
    u = np.tile([1.6, 2 * np.pi / 7], (7, 1))
    U, R = np.diag([0.08, 0.06]) ** 2, np.diag([0.15, 0.05]) ** 2
    poses = [np.zeros(3)]
    for d, phi in u:
        heading = poses[-1][2] + phi
        step = np.array([d * np.cos(heading), d * np.sin(heading)])
        poses.append(np.array([*(poses[-1][:2] + step), heading]))
    seen = []
    for number, (x, y, theta) in enumerate(poses):
        for name, landmark in enumerate(landmarks):
            r = np.hypot(*(landmark - (x, y)))
            bearing = np.arctan2(landmark[1] - y, landmark[0] - x) - theta
            bearing = np.angle(np.exp(1j * bearing))
            if r < 3.2 and abs(bearing) < 1.6:
                seen.append((number, name, r, bearing))
    pose, name, *z = np.array(seen).T
    return LandmarkLog(
        name="small world",
        start=np.zeros(3),
        time=np.arange(len(poses), dtype=float),
        motion="drive",
        control=u + rng.multivariate_normal(np.zeros(2), U, len(u)),
        control_covariance=np.tile(U, (len(u), 1, 1)),
        observation_pose=pose.astype(np.int64),
        observation=np.transpose(z) + rng.multivariate_normal(np.zeros(2), R, len(seen)),
        observation_covariance=np.tile(R, (len(seen), 1, 1)),
        landmark=name.astype(np.int64),
    )


def _belief(ekf: Any) -> Belief:
    return Belief(np.array(ekf.s), np.array(ekf.P))


def _controls(log: LandmarkLog, step: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """A control as (d, phi) with its covariance.

    One that drives before it turns is two: what is known of it sideways is left out.
    """
    u, U = log.control[step], log.control_covariance[step]
    if log.motion == "drive":
        yield u, U
        return
    forward, left, turn = u
    phi = np.arctan2(left, forward)
    yield np.array([np.hypot(forward, left), phi]), np.diag([U[0, 0], 0.0])
    yield np.array([0.0, turn - phi]), np.diag([0.0, U[2, 2]])
