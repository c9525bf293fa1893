"""EKF-SLAM traced through a few scans of a log (appendix C), with figures of its steps."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from saccade.errors import LogError
from saccade.motions import RelativePoses
from saccade.plane import relative_poses_of
from saccade.textbook.ekf_slam import Augmentation, Prediction, Update, f, g, h
from saccade.types import FloatArray, LandmarkLog
from saccade.viewing.slam import (
    ELLIPSE_LABEL,
    ELLIPSE_SCALE,
    bounds,
    ellipse_outlines,
    map_axes,
)
from saccade.viewing.style import BLUE, DIVERGING, GRAY, ORANGE, RED, hide_ticks

MAX_SHOWN_SCANS = 8
"""Maximum number of scans shown."""
MIN_ELLIPSE_FRACTION = 0.08
"""Minimum size of the largest ellipse after magnification, as a fraction of the map's width."""
MAX_LABELS = 6
"""Maximum number of labeled landmark rows beside a matrix."""


class State(NamedTuple):
    """State and covariance of the filter."""

    s: FloatArray
    """(3 + 2N,) pose (x, y, heading) and landmarks."""
    P: FloatArray
    """(3 + 2N, 3 + 2N) covariance."""

    @property
    def positions(self) -> FloatArray:
        """(N + 1, 2) of robot and landmarks."""
        return np.concatenate([self.s[None, :2], self.s[3:].reshape(-1, 2)])

    @property
    def covariances(self) -> FloatArray:
        """(N + 1, 2, 2) of those positions."""
        return np.array([self.P[i : i + 2, i : i + 2] for i in (0, *range(3, len(self.s), 2))])


class Transition(NamedTuple):
    """One step of the filter."""

    scan: int
    """Scan in which it happens, or that follows it, from 1."""
    before: State
    after: State
    result: Prediction | Update | Augmentation
    """Intermediate results of the textbook."""
    landmark: int | None = None
    """Row of the observed landmark in the map; None for a prediction."""
    observed: FloatArray | None = None
    """(2,) landmark position by the observation alone; None for a prediction."""


class FilterTrace(NamedTuple):
    """The states of a filter in consecutive scans of a log."""

    steps: dict[str, list[Transition]]
    """Every "predict", "update" and "augment" of the scans; at least the last before them."""
    scans: list[tuple[str, State]]
    """Title and state after each scan."""

    @property
    def drawn(self) -> dict[str, Transition]:
        """The last augmentation, and the prediction and update that change P the most."""
        return {
            name: steps[-1] if name == "augment" else max(steps, key=_change)
            for name, steps in self.steps.items()
            if steps
        }


def trace_filter(log: LandmarkLog, ekf_slam: Any, last_scan: int | None = None) -> FilterTrace:
    """Run the filter of the textbook, and keep its last `MAX_SHOWN_SCANS` scans.

    Args:
        log: with landmark labels.
        ekf_slam: the class `EkfSlam`.
        last_scan: number of the last scan, from 1; by default `MAX_SHOWN_SCANS`, or the last of
            the log.

    Raises:
        LogError: the log has no landmark labels, or fewer scans.
    """
    if (log.landmark < 0).any() or len(log.landmark) == 0:
        raise LogError(f"{log.name}: expected labels for all observations, as in appendix C")
    ekf, index_of = ekf_slam(log.start), dict[int, int]()
    trace = FilterTrace({"predict": [], "update": [], "augment": []}, [])
    number, last = 1, last_scan or MAX_SHOWN_SCANS
    moves = relative_poses_of(log)

    def current() -> State:
        return State(np.array(ekf.s), np.array(ekf.P))

    def keep(name: str, before: State, result: Any, *observation: Any) -> None:
        trace.steps[name].append(Transition(number, before, current(), result, *observation))

    for pose in range(len(log.time)):
        for u, U in _controls(log, moves, pose - 1) if pose else ():
            keep("predict", current(), ekf.predict(u, U))
        observations = np.flatnonzero(log.observation_pose == pose)
        for i in observations:
            before, label = current(), int(log.landmark[i])
            z, R = log.observation[i], log.observation_covariance[i]
            row, observed = index_of.setdefault(label, len(index_of)), g(ekf.x, z)
            if row < ekf.N:
                keep("update", before, ekf.update(row, z, R), row, observed)
            else:
                keep("augment", before, ekf.augment(z, R), row, observed)
        if len(observations):
            count = "1 landmark" if len(index_of) == 1 else f"{len(index_of)} landmarks"
            trace.scans.append((f"scan {number}: {count}", current()))
            del trace.scans[:-MAX_SHOWN_SCANS]
            for steps in trace.steps.values():
                steps[:] = [
                    each for each in steps if each.scan > number - MAX_SHOWN_SCANS
                ] or steps[-1:]
            number += 1
        if number > last:
            break
    if last_scan is not None and number <= last_scan:
        raise LogError(f"{log.name}: expected a scan from 1 to {number - 1}, found {last_scan}")
    return trace


def _change(step: Transition) -> float:
    return float(abs(np.trace(step.before.P - step.after.P)))


def simulated_log() -> LandmarkLog:
    """A robot that drives once around a heptagon among landmarks, under large noise."""
    rng = np.random.default_rng(5)
    landmarks = np.array([[2.6, -0.9], [3.6, 2.4], [1.2, 4.4], [-2.3, 3.0], [-1.4, -0.4]])
    u = np.tile([1.6, 2 * np.pi / 7], (7, 1))
    U, R = np.diag([0.08, 0.06]) ** 2, np.diag([0.15, 0.05]) ** 2
    poses = [np.zeros(3)]
    for control in u:
        poses.append(f(poses[-1], control))
    observations = [
        (pose, landmark, *z)
        for pose, x in enumerate(poses)
        for landmark, m in enumerate(landmarks)
        if (z := h(x, m))[0] < 3.2 and abs(z[1]) < 1.6
    ]
    pose_of, landmark_of, *z_of = np.array(observations).T
    return LandmarkLog(
        name="small world",
        start=np.zeros(3),
        time=np.arange(len(poses), dtype=float),
        motion="turn_then_translate",
        control=u + rng.multivariate_normal(np.zeros(2), U, len(u)),
        control_covariance=np.tile(U, (len(u), 1, 1)),
        observation_pose=pose_of.astype(np.int64),
        observation=np.transpose(z_of) + rng.multivariate_normal(np.zeros(2), R, len(observations)),
        observation_covariance=np.tile(R, (len(observations), 1, 1)),
        landmark=landmark_of.astype(np.int64),
    )


def filter_figures(trace: FilterTrace) -> dict[str, Figure]:
    """The figures of the steps of a filter, by name."""
    figures = {name: _transition_figure(each) for name, each in trace.drawn.items()}
    return {"state": _correlation_figure(trace.scans), **figures}


def filter_results(trace: FilterTrace) -> dict[str, dict[str, str]]:
    """The results of the steps of a filter, by step and name."""
    title, state = trace.scans[-1]
    x, y, theta = state.s[:3]
    sigma = np.sqrt(np.diagonal(state.P)[:3])
    return {
        "state": {
            f"pose after {title.partition(':')[0]}": f"x = {x:.3f} ± {sigma[0]:.3f} m, "
            f"y = {y:.3f} ± {sigma[1]:.3f} m, heading {np.degrees(theta):.2f} "
            f"± {np.degrees(sigma[2]):.2f}°",
        }
    }


def _controls(
    log: LandmarkLog, moves: RelativePoses, step: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """The control of a step as (d, phi) with its covariance.

    A relative pose, which translates before it turns, becomes two, without its lateral uncertainty.
    """
    if log.motion == "turn_then_translate":
        yield log.control[step], log.control_covariance[step]
        return
    (forward, left, turn), U = moves.step[step], moves.covariance[step]
    phi = np.arctan2(left, forward)
    yield np.array([np.hypot(forward, left), phi]), np.diag([U[0, 0], 0.0])
    yield np.array([0.0, turn - phi]), np.diag([0.0, U[2, 2]])


def _transition_figure(transition: Transition) -> Figure:
    """The map, and the correlations before and after a step of the filter."""
    before, after, observed = transition.before, transition.after, transition.observed
    figure = Figure(figsize=(11.5, 4.3), layout="compressed", dpi=110)
    ground, left, right = figure.subplots(1, 3, width_ratios=(1.35, 1, 1))
    magnification = _magnification(transition)
    points = [
        _draw_state(ground, before, GRAY, GRAY, magnification),
        _draw_state(ground, after, BLUE, ORANGE, magnification),
    ]
    if observed is not None:
        points.append(observed[None])
        ground.plot(*np.array([before.s[:2], observed]).T, "--", color="black", linewidth=1)
        ground.plot(*observed, "x", color="black", markersize=7)
    map_axes(ground, bounds(np.concatenate(points), 0.06))
    magnified = "" if magnification == 1 else f", drawn {magnification} times as large"
    ground.set_title(f"{ELLIPSE_LABEL}{magnified}", fontsize=10)
    size = len(after.s)
    _draw_correlations(left, before.P, size, "correlations before")
    _draw_scale(figure, _draw_correlations(right, after.P, size, "and after"), right)
    if size > len(before.s):
        low = len(before.s) - 0.5
        new = Rectangle((-0.5, low), size, 2, fill=False, edgecolor=RED, linewidth=2, clip_on=False)
        right.add_patch(new)
    return figure


def _correlation_figure(scans: Sequence[tuple[str, State]]) -> Figure:
    """The correlations after each scan, all on one grid."""
    columns = min(len(scans), 4)
    rows = -(-len(scans) // columns)
    figure = Figure(figsize=(2.9 * columns, 3.1 * rows), layout="compressed", dpi=110)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(scans) :]:
        axes.set_axis_off()
    size = max(len(state.s) for _, state in scans)
    for axes, (title, state) in zip(panels, scans, strict=False):
        drawn = _draw_correlations(axes, state.P, size, title)
    _draw_scale(figure, drawn, panels.tolist())
    return figure


def _draw_scale(figure: Figure, drawn: AxesImage, beside: Axes | list[Axes]) -> None:
    """The color bar of correlations."""
    bar = figure.colorbar(drawn, ax=beside, ticks=[-1, 0, 1], fraction=0.05, aspect=30)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0, labelsize=8)
    bar.set_label("correlation", fontsize=9)


def _draw_correlations(axes: Axes, P: FloatArray, size: int, title: str) -> AxesImage:
    """The correlation matrix of a covariance, in the corner of a size x size grid."""
    sigma = np.sqrt(np.diagonal(P).clip(1e-300))
    correlation = P / sigma / sigma[:, None]
    correlation[:, np.diagonal(P) <= 0] = 0
    drawn = axes.imshow(correlation, cmap=DIVERGING, vmin=-1, vmax=1, interpolation="nearest")
    axes.set_xlim(-0.5, size - 0.5)
    axes.set_ylim(size - 0.5, -0.5)
    hide_ticks(axes)
    axes.add_patch(Rectangle((-0.5, -0.5), len(P), len(P), fill=False, edgecolor="0.3"))
    for draw_lines in (axes.hlines, axes.vlines):
        draw_lines(np.arange(2.5, len(P) - 1, 2), -0.5, len(P) - 0.5, color="0.6", linewidth=0.5)
    if size <= 3 + 2 * MAX_LABELS:
        landmarks = (len(P) - 3) // 2
        axes.set_yticks([1, *(3.5 + 2 * i for i in range(landmarks))])
        axes.set_yticklabels(["pose", *(f"m{i + 1}" for i in range(landmarks))], fontsize=8)
        axes.tick_params(length=0)
    axes.set_title(title, fontsize=10, loc="left")
    return drawn


def _draw_state(
    axes: Axes, state: State, robot: str, landmark: str, magnification: int
) -> FloatArray:
    """Pose and landmarks with their ellipses; returns the points (k, 2) that must be visible."""
    xy = state.positions
    outlines = ellipse_outlines(xy, state.covariances, magnification)
    for color, shapes in ((robot, outlines[:1]), (landmark, outlines[1:])):
        style: Any = {"facecolor": (color, 0.15), "edgecolor": (color, 0.95), "linewidth": 1.2}
        axes.add_collection(PolyCollection([*shapes], **style), autolim=False)
    axes.plot(*xy[1:].T, ".", color=landmark, markersize=5)
    axes.plot(*xy[0], marker=(3, 0, np.degrees(state.s[2]) - 90), color=robot, markersize=11)
    return np.concatenate([xy, outlines.reshape(-1, 2)])


def _magnification(transition: Transition) -> int:
    """Magnification that makes the largest ellipse visible."""
    before, after, observed = transition.before, transition.after, transition.observed
    points = [
        before.positions,
        after.positions,
        np.empty((0, 2)) if observed is None else observed[None],
    ]
    width = float(np.ptp(np.concatenate(points), axis=0).max())
    variance = np.linalg.eigvalsh(np.concatenate([before.covariances, after.covariances])).max()
    largest = 2 * ELLIPSE_SCALE * float(np.sqrt(variance.clip(1e-300)))
    factor = MIN_ELLIPSE_FRACTION * width / largest
    return next((each for each in (1, 2, 5, 10, 20, 50, 100) if each >= factor), 100)
