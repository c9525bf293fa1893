"""Re-identification: the consistency of associations with one another."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from saccade.evaluation.runs import correct_associations
from saccade.frames import Camera, Frame
from saccade.simulation import DriveConfig, simulate_drive
from saccade.slam.filter.predictions import PredictedObservations
from saccade.visual.config import VisualConfig
from saccade.visual.depth import measure_depth
from saccade.visual.motion_estimator import MotionEstimator
from saccade.visual.optical_flow import PreparedFrame, prepare_frame
from saccade.visual.points import RangeBearings, TrackedPoints
from saccade.visual.reidentification import consistent_layout, consistent_set, reidentify
from saccade.visual.single_camera import SingleCameraMotionEstimator
from saccade.visual.visual_map import VisualMap


@given(st.integers(0, 10**6), st.integers(0, 4))
def test_landmarks_that_lie_as_they_are_observed_agree(seed, outliers):
    random = np.random.default_rng(seed)
    x, y, heading = random.uniform(-5, 5, 3)
    z = np.stack([random.uniform(1, 8, 10), random.uniform(-1.5, 1.5, 10)], 1)
    beta = heading + z[:, 1]
    places = np.stack([x + z[:, 0] * np.cos(beta), y + z[:, 0] * np.sin(beta)], 1)
    places[:outliers] += random.uniform(20, 90, (outliers, 2))
    assert consistent_layout(z, places).tolist() == [i >= outliers for i in range(10)]


@given(st.integers(0, 10**6), st.integers(0, 4))
def test_errors_that_landmarks_share_do_not_make_them_disagree(seed, outliers):
    """The bearings of all are off by one large error, those of outliers by another each."""
    random, k, k_in = np.random.default_rng(seed), 10, 10 - outliers
    expected = np.stack([random.uniform(3, 8, k), random.uniform(-0.4, 0.4, k)], 1)
    sigma = np.array([0.3, 0.003])
    covariance = np.zeros((k, 2, k, 2))
    covariance[:, 1, :, 1] = 0.1**2
    z = expected + 0.3 * sigma * random.choice([-1, 1], (k, 2)) + [0.0, random.uniform(-0.2, 0.2)]
    z[k_in:, 1] += random.choice([-1, 1], outliers) * np.linspace(0.03, 0.2, 4)[:outliers]
    R = np.tile(np.diag(sigma**2), (k, 1, 1))
    found = consistent_set(RangeBearings(z, R, np.zeros(k)), expected, covariance, np.ones(k), 0.99)
    assert found.tolist() == [i < k_in for i in range(k)]


def test_a_landmark_without_a_range_is_observed_by_its_bearing_alone():
    drive, config = simulate_drive(DriveConfig(frames=2)), VisualConfig()
    visual_map = VisualMap(drive, config, MotionEstimator(drive, config))
    points = TrackedPoints.zeros(
        2,
        xy=np.array([[100, 100], [220, 120]], np.float32),
        depth=np.array([3.0, np.nan]),
        depth_sigma=np.array([0.02, np.nan]),
    )
    z = np.array([[3.5, 0.2], [5.0, -0.1]])
    seen, usable = visual_map.observe(points, PredictedObservations(z, np.zeros((2, 2, 2))))
    assert usable.all()
    assert seen.z[1, 0] == pytest.approx(5.0)
    assert seen.z[1, 1] == pytest.approx(np.arctan2(drive.camera.cx - 220, drive.camera.fx))
    sigma = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
    assert sigma[0, 0] < 0.1
    assert sigma[1, 0] > 100
    assert sigma[1, 1] < 0.01


def test_depth_is_measured_at_the_left_edge_too(rng):
    """A plane whose disparity is 12 pixels everywhere: its texture is in both images."""
    texture = cv2.GaussianBlur(rng.integers(0, 256, (120, 212)).astype(np.float32), (0, 0), 1.5)
    left, right = (np.ascontiguousarray(texture[:, i : i + 200]) for i in (0, 12))
    camera = Camera(200, 120, 200, 200, 99.5, 59.5, 0.12)
    images = (np.rint(each).astype(np.uint8) for each in (left, right))
    prepared = prepare_frame(Frame(0.0, *images), camera)
    x = np.arange(24, 180, 12)
    xy = np.stack([x, np.full(len(x), 60)], 1).astype(np.float32)
    depth, _ = measure_depth(camera, prepared, xy, VisualConfig(range_limits=(0.5, 100)))
    assert depth == pytest.approx(200 * 0.12 / 12, rel=0.01)


@pytest.mark.parametrize(
    ("aside", "right"), [((0.5, 0.0), True), ((0.0, 0.5), False), ((0.0, 0.1), True)]
)
def test_a_place_may_be_off_along_the_line_of_sight_alone(aside, right):
    """At four meters a range is good to 0.2 m, a bearing to 8 mm."""
    z = np.array([[4.0, 0.0], [np.hypot(4 + aside[0], aside[1]), np.arctan2(aside[1], 4)]])
    sigma = np.array([[0.2, 0.002], [0.2, 0.002]])
    found = correct_associations(np.array([0, 1]), np.array([7, 7]), z, sigma, np.zeros((2, 3)))
    assert found.tolist() == [True, right]


def mapped_points(rng):
    """Six points in the first frame of a drive, its map, and their observations."""
    drive, config = simulate_drive(DriveConfig(frames=2)), VisualConfig()
    points = TrackedPoints.zeros(
        6,
        xy=rng.uniform(60, 180, (6, 2)).astype(np.float32),
        depth=np.linspace(2, 4, 6),
        depth_sigma=np.full(6, 0.02),
        landmark=np.full(6, -1),
        descriptor=rng.integers(0, 256, (6, 128), np.uint8),
    )
    visual_map = VisualMap(drive, config, MotionEstimator(drive, config))
    return drive, visual_map, points, visual_map.observe(points)[0]


@pytest.mark.parametrize(("meters", "found"), [(0.3, 6), (3.0, 0)])
def test_a_point_may_be_mapped_twice_but_not_hang_in_two_places(rng, meters, found):
    drive, visual_map, points, observations = mapped_points(rng)
    for behind in (0.0, meters):
        moved = replace(observations, z=observations.z + np.array([behind, 0.0]))
        visual_map.initialize(moved, points.descriptor, 0)
    frame, nothing = PreparedFrame(drive.load(0)), TrackedPoints()
    result = reidentify(points, visual_map, nothing, frame, VisualConfig())
    assert len(result.rows) == found


def test_points_that_are_no_landmarks_hide_none(rng):
    """Every lost landmark in view is found, whatever else is tracked."""
    drive, visual_map, points, observations = mapped_points(rng)
    config = VisualConfig()
    expected = PredictedObservations(observations.z + 1, observations.covariance)
    single = VisualMap(drive, config, SingleCameraMotionEstimator(drive, config))
    for each, added in ((visual_map, 0), (single, 1)):  # whose ranges are those of the map
        ranges = each.observe(points, expected)[0].z[:, 0]
        assert ranges == pytest.approx(observations.z[:, 0] + added)
    visual_map.initialize(observations, points.descriptor, 0)
    elsewhere = TrackedPoints.zeros(3, landmark=np.full(3, -1))
    frame = PreparedFrame(drive.load(0))
    found = reidentify(points, visual_map, elsewhere, frame, config)
    assert found.rows.tolist() == [0, 1, 2, 3, 4, 5]
    assert np.array_equal(found.points.xy, points.xy)
    assert len(found.missed) == found.elsewhere == 0
