"""Figures and films hold what was drawn, and pages escape every text."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch
from scipy.stats import chi2

from saccade.errors import ConfigError
from saccade.types import (
    Keypoints,
    LandmarkMap,
    MapSnapshot,
    Regions,
    Scanpath,
    SymmetricPairs,
    Trajectory,
)
from saccade.viewing import (
    attention_figure,
    chart_figure,
    keypoint_figure,
    map_figure,
    map_frames,
    match_figure,
    pair_figure,
    region_figure,
    save_figure,
)
from saccade.viewing.attention import weighted_by
from saccade.viewing.charts import innovation_charts, uncertainty_charts
from saccade.viewing.live import LiveMap
from saccade.viewing.style import BLUE, ORANGE, RED
from support.processes import run_python

IMAGE = np.random.default_rng(1).random((60, 90, 3), np.float32)
SCANPATH = Scanpath(np.array([[10.0, 20.0], [70.0, 40.0]]), np.array([0.1, 0.2]), np.ones(2))
KEYPOINTS = Keypoints(
    xy=np.array([[20, 30], [60, 10]], np.float32),
    size=np.array([8, 20], np.float32),
    angle=np.array([0, np.pi / 2], np.float32),
    response=np.ones(2, np.float32),
    octave=np.zeros(2, np.int32),
)


def test_a_scanpath_is_numbered_at_its_fixations():
    figure = attention_figure(IMAGE, {"saliency": IMAGE[::4, ::4, 0]}, SCANPATH)
    numbers = {text.get_text(): text.get_position() for text in figure.axes[0].texts}
    assert numbers == {"1": (10, 20), "2": (70, 40)}


def test_an_image_is_bright_where_its_map_is_high():
    values = np.zeros((6, 9), np.float32)
    values[:, 6:] = 3
    bright = weighted_by(np.ones((60, 90, 3), np.float32), values)
    assert bright[:, :40].max() < 0.2
    assert bright[:, 75:].min() == 1


PAIRS = SymmetricPairs(
    first=np.array([[20.0, 30.0], [45.0, 20.0], [0.0, 0.0]]),
    second=np.array([[60.0, 30.0], [45.0, 50.0], [9.0, 9.0]]),
    first_angle=np.array([0, np.pi / 2, 0]),
    second_angle=np.array([np.pi, -np.pi / 2, 0]),
    strength=np.array([1.0, 0.5, 0.01]),
    level=np.zeros(3, np.int64),
)


def test_strong_pairs_are_joined_between_strokes_along_their_edges():
    (axes,) = pair_figure(IMAGE, [PAIRS, PAIRS[:0]]).axes
    drawn = [each for each in axes.collections if len(each.get_segments())]
    joined, first, second = (np.array(each.get_segments()) for each in drawn)
    np.testing.assert_allclose(joined, [[[20, 30], [60, 30]], [[45, 20], [45, 50]]])
    np.testing.assert_allclose(first.mean(axis=1), PAIRS.first[:2])
    np.testing.assert_allclose(second.mean(axis=1), PAIRS.second[:2])
    along = first[:, 1] - first[:, 0]
    np.testing.assert_allclose(along[0] * (1, 0), 0, atol=1e-9)  # across a gradient along x
    np.testing.assert_allclose(along[1] * (0, 1), 0, atol=1e-9)


@pytest.mark.parametrize("direction", np.linspace(-1.5, 1.5, 7))
def test_the_axis_bisects_its_pairs(direction):
    across = direction + np.pi / 2 + np.array([-0.2, 0.0, 0.2])
    half, n = 7 * np.stack([np.cos(across), np.sin(across)], axis=1), len(across)
    middle, level = np.array([50.0, 40.0]), np.zeros(n, np.int64)
    pairs = SymmetricPairs(middle + half, middle - half, across, across, np.ones(n), level)
    (line,) = pair_figure(IMAGE, [pairs]).axes[0].lines
    (x, y), (dx, dy) = np.mean(line.get_data(), axis=1), np.diff(line.get_data())[:, 0]
    np.testing.assert_allclose((x, y), middle)
    assert np.cos(2 * (np.arctan2(dy, dx) - direction)) == pytest.approx(1)


def test_pairs_in_all_directions_have_no_axis():
    across = np.linspace(0, np.pi, 8, endpoint=False)
    half, level = np.stack([np.cos(across), np.sin(across)], axis=1), np.zeros(8, np.int64)
    pairs = SymmetricPairs(40 + half, 40 - half, across, across, np.ones(8), level)
    assert not pair_figure(IMAGE, [pairs]).axes[0].lines


def test_regions_are_boxes_about_their_centers():
    boxes = np.array([[10, 20, 30, 50], [40, 5, 80, 15]], np.float32)
    (axes,) = region_figure(IMAGE, Regions(KEYPOINTS, boxes)).axes
    found = [each.get_bbox().extents for each in axes.patches]
    np.testing.assert_allclose(found, boxes)
    largest_first = KEYPOINTS[np.argsort(-KEYPOINTS.size, kind="stable")]
    np.testing.assert_allclose(axes.collections[0].get_offsets(), largest_first.xy)


def test_keypoints_are_circles_of_their_size_with_a_line_along_their_angle():
    (axes,) = keypoint_figure(IMAGE, KEYPOINTS).axes
    (circles,) = [each for each in axes.collections if isinstance(each, EllipseCollection)]
    np.testing.assert_allclose(circles.get_widths(), [20, 8])
    np.testing.assert_allclose(circles.get_offsets(), [[60, 10], [20, 30]])
    (lines,) = [each for each in axes.collections if isinstance(each, LineCollection)]
    points = dict(zip(map(tuple, KEYPOINTS.xy.tolist()), range(2), strict=True))
    for start, end in lines.get_segments():
        k = points[tuple(start.tolist())]
        along = np.subtract(end, start)
        assert np.hypot(*along) == pytest.approx(KEYPOINTS.size[k] / 2)
        assert np.arctan2(*along[::-1]) == pytest.approx(KEYPOINTS.angle[k], abs=1e-6)


def test_ellipses_have_the_axes_of_the_covariance():
    tilt = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    covariance = tilt @ np.diag([4.0, 1.0]) @ tilt.T
    drive = Trajectory(np.arange(2.0), np.zeros((2, 3)))
    landmarks = LandmarkMap(np.array([7]), np.array([[1.0, 2.0]]), covariance[None])
    figure = map_figure(drive, landmarks)
    (axes,) = figure.axes
    (legend,) = figure.legends
    handles = dict(zip([t.get_text() for t in legend.texts], legend.legend_handles, strict=True))
    assert isinstance(handles["3 sigma (99.7 %)"], Patch)
    (ellipses,) = [each for each in axes.collections if isinstance(each, PolyCollection)]
    corners = (ellipses.get_paths()[0].vertices - np.array([1.0, 2.0])) @ tilt
    squared_distance = (corners**2 / [4, 1]).sum(1)
    np.testing.assert_allclose(chi2.cdf(squared_distance, 2), 0.9973, atol=1e-5)
    radius = np.sqrt(chi2.ppf(0.9973, 2))
    np.testing.assert_allclose(np.abs(corners).max(0), [2 * radius, radius], rtol=1e-3)


def _growing_map():
    """A robot that drives to the right past two landmarks; the second is seen at the end."""
    place = np.array([[0.0, 4.0], [10.0, 4.0]])
    return [
        MapSnapshot(
            step=step,
            path=np.array([[x, 0.0, 0.0] for x in range(step - 4, step + 1)], float),
            covariance=np.diag([0.01, 0.01, 0.01]),
            landmarks=place[:n],
            landmark_covariance=np.tile(np.eye(2) * 0.04, (n, 1, 1)),
            observed=np.arange(n),
            ids=np.arange(n),
        )
        for step, n in ((4, 1), (9, 2))
    ]


def test_a_film_shows_the_map_so_far():
    frames = list(map_frames(_growing_map(), np.arange(10.0)))
    first, last = frames[0], frames[1]
    assert first.shape == (720, 1280, 3)
    assert len(frames) > 2
    assert all((frame == last).all() for frame in frames[2:])
    columns = {}
    for name, color in (("drive", BLUE), ("landmark", ORANGE), ("robot", RED)):
        value = 255 * np.array(to_rgb(color))
        for frame in (first, last):
            near = (np.abs(frame[80:] - value) < 30).all(2).nonzero()[1]  # below the legend
            columns.setdefault(name, []).append((near.min(), near.max()))
    assert columns["drive"][0][1] < columns["drive"][1][1]
    assert columns["robot"][0][1] < columns["robot"][1][0]
    assert columns["landmark"][0][1] < columns["landmark"][1][1]


def test_a_film_says_when_the_robot_is_lost():
    snapshots = _growing_map()
    snapshots[1] = replace(snapshots[1], hypotheses=np.zeros((1, 4)))
    red = 255 * np.array(to_rgb(RED))
    first, last = (
        (np.abs(frame[80:100, 90:140] - red) < 40).all(2).sum()
        for frame in list(map_frames(snapshots, np.arange(10.0)))[:2]
    )
    assert first == 0
    assert last > 20


def test_innovations_are_drawn_against_their_band(rng):
    time, nis = np.arange(400.0), rng.chisquare(2, 400)
    nis[:7] = np.nan
    drive = Trajectory(time, np.zeros((400, 3)), np.tile(np.diag([4.0, 1.0, 0.25]), (400, 1, 1)))
    innovation, S = rng.normal(size=(400, 2)), np.tile(np.eye(2) * 4, (400, 1, 1))
    charts = innovation_charts(time, innovation, S, nis, (1.4, 2.7), 20)
    figure = chart_figure([*charts, *uncertainty_charts(drive, None)])
    over_time, distance, _, place, heading = figure.axes[:5]
    dots, mean = over_time.lines
    assert len(dots.get_xdata()) == 393
    np.testing.assert_allclose(mean.get_ydata()[-1], nis[-20:].mean())
    np.testing.assert_allclose(distance.lines[0].get_ydata(), innovation[7:, 0] / 2)
    assert place.lines[0].get_ydata()[0] == pytest.approx(6)
    assert heading.lines[0].get_ydata()[0] == pytest.approx(3 * np.degrees(0.5))


def _entities(path):
    done = run_python("-m", "rerun", "rrd", "print", path, check=True)
    return done.stdout


@pytest.mark.peer
def test_a_live_viewer_gets_each_snapshot_once(monkeypatch, tmp_path):
    rerun = pytest.importorskip("rerun")
    path = tmp_path / "live.rrd"
    paths = [os.environ["PATH"]]

    def spawn(stream):
        paths.append(os.environ["PATH"])
        stream.save(path)

    monkeypatch.setattr(rerun.RecordingStream, "spawn", spawn)
    logged = []
    monkeypatch.setattr(
        rerun.RecordingStream, "set_time", lambda self, line, **at: logged.append((line, at))
    )
    snapshots = _growing_map()
    show = LiveMap("a drive", np.arange(10.0), Trajectory(np.arange(10.0), np.zeros((10, 3))))
    assert paths[1] == os.pathsep.join([paths[0], str(Path(sys.executable).parent)])
    assert os.environ["PATH"] == paths[0]
    show(snapshots[:1])
    show(snapshots)
    assert [at["sequence"] for line, at in logged if line == "pose"] == [4, 9]
    del show
    found = _entities(path)
    for entity in ("trajectory", "odometry", "observed", "landmarks", "robot", "landmarks/sigma"):
        assert f"/map/{entity}" in found


@pytest.mark.peer
def test_a_viewer_that_does_not_start_is_a_one_line_error(monkeypatch):
    rerun = pytest.importorskip("rerun")

    def spawn(stream):
        raise RuntimeError("no display\nand much advice")

    monkeypatch.setattr(rerun.RecordingStream, "spawn", spawn)
    with pytest.raises(ConfigError, match=r"cannot be started: no display$"):
        LiveMap("a drive", np.zeros(1), Trajectory(np.zeros(1), np.zeros((1, 3))))


def test_an_empty_result_can_still_be_drawn(tmp_path):
    nothing = KEYPOINTS[:0]
    nowhere = Scanpath(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    empty_map = LandmarkMap(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    still = Trajectory(np.zeros(0), np.zeros((0, 3)))
    figures = [
        attention_figure(IMAGE, {"saliency": IMAGE[:, :, 0]}, nowhere),
        keypoint_figure(IMAGE, nothing),
        match_figure((IMAGE, IMAGE), (nothing, nothing), np.zeros((0, 2), np.int64)),
        map_figure(still, empty_map, still, still, empty_map, still),
        chart_figure([]),
    ]
    for number, figure in enumerate(figures):
        assert save_figure(figure, tmp_path / f"{number}.png").stat().st_size > 1000
