"""Figures and films hold what was drawn, and pages escape every text."""

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch
from scipy.stats import chi2

from saccade.types import (
    Keypoints,
    LandmarkMap,
    MapSnapshot,
    Scanpath,
    SymmetricPairs,
    Trajectory,
)
from saccade.viewing import (
    attention_figure,
    keypoint_figure,
    map_figure,
    map_frames,
    match_figure,
    pair_figure,
    save_figure,
)
from saccade.viewing.live import LiveMap
from saccade.viewing.style import BLUE
from support.processes import run_python

IMAGE = np.random.default_rng(1).random((60, 90, 3), np.float32)
KEYPOINTS = Keypoints(
    xy=np.array([[20, 30], [60, 10]], np.float32),
    size=np.array([8, 20], np.float32),
    angle=np.array([0, np.pi / 2], np.float32),
    response=np.ones(2, np.float32),
    octave=np.zeros(2, np.int32),
)


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


def test_keypoints_are_circles_of_their_size_with_a_line_along_their_angle():
    figure = keypoint_figure(IMAGE, KEYPOINTS)
    (axes,) = figure.axes
    (circles,) = [each for each in axes.collections if isinstance(each, EllipseCollection)]
    figure.draw_without_rendering()
    radius = circles.get_transforms()[:, 0, 0] * axes.viewLim.width / axes.bbox.width
    np.testing.assert_allclose(2 * radius, [20, 8])
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
    first, last, *rest = map_frames(_growing_map(), np.arange(10.0))
    assert first.shape == (720, 1280, 3)
    blue = 255 * np.array(to_rgb(BLUE))
    early, late = ((np.abs(f[80:] - blue) < 30).all(2).nonzero()[1] for f in (first, last))
    assert early.max() < late.max()  # the drive goes on to the right
    assert all((frame == last).all() for frame in rest)


@pytest.mark.peer
def test_a_recording_for_rerun_has_each_part_of_the_map(tmp_path):
    pytest.importorskip("rerun")
    path = tmp_path / "live.rrd"
    odometry = Trajectory(np.arange(10.0), np.zeros((10, 3)))
    image = np.zeros((48, 64, 3), np.uint8)
    show = LiveMap("a drive", np.arange(10.0), odometry, lambda _: image, file=path)
    show(_growing_map()[:1])
    show(_growing_map())
    show.close()
    found = run_python("-m", "rerun", "rrd", "print", path, check=True).stdout
    parts = ("trajectory", "odometry", "observed", "landmarks", "robot", "landmarks/sigma")
    assert all(f"/map/{part}" in found for part in parts)
    assert "/camera" in found


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
    ]
    for number, figure in enumerate(figures):
        assert save_figure(figure, tmp_path / f"{number}.png").stat().st_size > 1000
