"""Re-identification: the consistency of associations with one another."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from saccade.evaluation.runs import correct_associations
from saccade.simulation import DriveConfig, simulate_drive
from saccade.slam.filter.models import PredictedObservations
from saccade.visual.config import VisualConfig
from saccade.visual.motion_estimator import MotionEstimator
from saccade.visual.reidentification import consistent_layout, reidentify
from saccade.visual.single_camera import SingleCameraMotionEstimator
from saccade.visual.tables import TrackedPoints
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


@pytest.mark.parametrize(
    ("aside", "right"), [((0.5, 0.0), True), ((0.0, 0.5), False), ((0.0, 0.1), True)]
)
def test_a_place_may_be_off_along_the_line_of_sight_alone(aside, right):
    """At four meters a range is good to 0.2 m, a bearing to 8 mm."""
    z = np.array([[4.0, 0.0], [np.hypot(4 + aside[0], aside[1]), np.arctan2(aside[1], 4)]])
    sigma = np.array([[0.2, 0.002], [0.2, 0.002]])
    found = correct_associations(np.array([0, 1]), np.array([7, 7]), z, sigma, np.zeros((2, 3)))
    assert found.tolist() == [True, right]


def test_points_that_are_no_landmarks_hide_none(rng):
    """Every lost landmark in view is found, whatever else is tracked."""
    drive, config = simulate_drive(DriveConfig(frames=2)), VisualConfig()
    xy = rng.uniform(60, 180, (6, 2)).astype(np.float32)
    points = TrackedPoints.zeros(
        6,
        xy=xy,
        depth=np.linspace(2, 4, 6),
        depth_sigma=np.full(6, 0.02),
        landmark=np.full(6, -1),
        descriptor=rng.integers(0, 256, (6, 128), np.uint8),
    )
    visual_map = VisualMap(drive, config, MotionEstimator(drive, config))
    observations, usable = visual_map.observe(points)
    assert usable.all()
    expected = PredictedObservations(observations.z + 1, observations.covariance)
    single = VisualMap(drive, config, SingleCameraMotionEstimator(drive, config))
    for each, added in ((visual_map, 0), (single, 1)):  # whose ranges are those of the map
        ranges = each.observe(points, expected)[0].z[:, 0]
        assert ranges == pytest.approx(observations.z[:, 0] + added)
    visual_map.initialize(observations, points.descriptor, 0)
    elsewhere = TrackedPoints.zeros(3, landmark=np.full(3, -1))
    found = reidentify(points, visual_map, elsewhere, config)
    assert found.points.tolist() == found.rows.tolist() == [0, 1, 2, 3, 4, 5]
    assert len(found.missed) == found.elsewhere == 0
