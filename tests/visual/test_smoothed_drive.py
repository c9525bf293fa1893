"""The log of a drive's filter against the smoother of landmark logs."""

from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.slam import EkfConfig
from saccade.types import Trajectory
from saccade.visual.smoothing import MapLog
from support.circular_log import simulate

CONFIG = EkfConfig(association="known", smooth=False, estimate_systematic_errors=False)


def recorded(log):
    """What a `MapLog` records while a filter takes the steps of a log."""
    made = MapLog(CONFIG, log.start, (0.0, 0.0, 0.0))
    made.motions.extend(zip(log.control, log.control_covariance, strict=True))
    for pose in np.unique(log.observation_pose).tolist():
        rows = log.observation_pose == pose
        z, R = log.observation[rows], log.observation_covariance[rows]
        made.observations.append((pose, log.landmark[rows], z, R))
    return made


def by_labels(landmarks):
    """The map in the order of its labels, as that of a drive is."""
    order = np.argsort(landmarks.id)
    parts = {name: getattr(landmarks, name)[order] for name in ("id", "xy", "covariance")}
    return replace(landmarks, observations=None, **parts)


@pytest.mark.parametrize("factor", [1.0, 2.5])
def test_a_recorded_drive_is_smoothed_as_its_log(rng, factor):
    """In any unit of length."""
    log, _, _ = simulate(rng, "compose", steps=60)
    log = replace(log, start=np.zeros(3))
    filtered = slam.run(log, CONFIG)
    expected = slam.smooth(log, filtered, CONFIG)
    made, landmarks = recorded(log), by_labels(filtered.map)
    made.rescale(factor)
    unit = np.array([factor, factor, 1.0])
    start = Trajectory(log.time, filtered.trajectory.pose * unit)
    larger = replace(landmarks, xy=landmarks.xy * factor)
    found = made.smooth(start, larger, np.zeros(len(log.time), bool))
    np.testing.assert_allclose(found.trajectory.pose / unit, expected.trajectory.pose, atol=1e-5)
    np.testing.assert_allclose(found.map.xy / factor, by_labels(expected.map).xy, atol=1e-5)
    np.testing.assert_allclose(
        found.trajectory.covariance / np.outer(unit, unit),
        expected.trajectory.covariance,
        atol=1e-6,
    )


def test_landmarks_that_left_the_map_are_left_out(rng):
    log, _, _ = simulate(rng, "compose", steps=40)
    filtered = slam.run(log, CONFIG)
    landmarks = by_labels(filtered.map)
    kept = np.arange(len(landmarks)) != 2
    parts = {name: getattr(landmarks, name)[kept] for name in ("id", "xy", "covariance")}
    lost = np.zeros(len(log.time), bool)
    found = recorded(log).smooth(filtered.trajectory, replace(landmarks, **parts), lost)
    assert len(found.map) == len(landmarks) - 1
    gone = log.landmark == landmarks.id[2]
    assert np.isnan(found.weight[gone]).all()
    assert np.isfinite(found.weight[~gone]).all()
