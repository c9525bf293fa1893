"""Observations of a sensor that is not at the robot's origin, or turned."""

from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.datasets import load, save
from saccade.errors import LogError
from saccade.plane import in_robot_frame, to_robot_frame
from saccade.simulation import WorldConfig, simulate_world
from support.logs import mounted

MOUNTINGS = [(0.3, 0.0, 0.0), (-0.1, 0.3, 0.0), (0.0, 0.0, np.deg2rad(5)), (0.3, -0.2, -0.1)]


@pytest.mark.parametrize("sensor", MOUNTINGS)
def test_a_mounted_sensor_maps_as_one_at_the_origin(sensor):
    """Known mounting: RMSE and NIS of a sensor at the origin; as if at the origin: worse."""
    log = mounted(simulate_world(WorldConfig(steps=400), 3), sensor)
    config = slam.EkfConfig(  # biases explain a part of the mounting
        estimate_systematic_errors=False, smooth=False
    )
    known, unknown = (slam.run(each, config) for each in (replace(log, sensor=sensor), log))
    assert known.consistency.mean == pytest.approx(2, abs=0.15)
    assert unknown.consistency.mean > known.consistency.mean + 0.1


def test_conversion_is_that_of_random_draws():
    """Mean and covariance of 400,000 draws of a sensor that is 0.5 m ahead and turned."""
    rng = np.random.default_rng(1)
    z, R, sensor = (
        np.array([[4.0, 0.8]]),
        np.array([[[0.03, 0.01], [0.01, 0.02]]]) / 10,
        (0.5, -0.3, 0.4),
    )
    found, covariance = to_robot_frame(z, R, sensor)
    drawn = rng.multivariate_normal(z[0], R[0], 400_000)
    x = 0.5 + drawn[:, 0] * np.cos(drawn[:, 1] + 0.4)
    y = -0.3 + drawn[:, 0] * np.sin(drawn[:, 1] + 0.4)
    polar = np.stack([np.hypot(x, y), np.arctan2(y, x)], 1)
    np.testing.assert_allclose(found[0], polar.mean(0), atol=5e-3)
    np.testing.assert_allclose(covariance[0], np.cov(polar.T), rtol=0.03, atol=1e-5)


def test_half_an_observation_needs_a_sensor_at_the_origin():
    z, R = np.array([[3.0, np.nan], [np.nan, 3.0]]), np.tile(np.eye(2), (2, 1, 1))
    turned, _ = to_robot_frame(z, R, (0.0, 0.0, 0.5))
    np.testing.assert_allclose(turned, [[3.0, np.nan], [np.nan, 3.5 - 2 * np.pi]])
    with pytest.raises(
        LogError, match="observation 0: expected range and bearing of a sensor away"
    ):
        to_robot_frame(z, R, (0.1, 0.0, 0.0))


def test_the_mounting_is_in_the_csv(tmp_path):
    log = replace(simulate_world(WorldConfig(steps=20), 1), sensor=(0.25, -0.125, 0.1))
    save(tmp_path / "log.csv", log)
    assert "# sensor: 0.25, -0.125, 0.1\n" in (tmp_path / "log.csv").read_text()
    again = load("auto", tmp_path / "log.csv")
    assert again.sensor == log.sensor
    np.testing.assert_array_equal(again.observation, log.observation)
    assert load("auto", tmp_path / "log.csv", sensor=(1, 2, 3)).sensor == (1, 2, 3)
    save(tmp_path / "log.g2o", log)  # which has no mounting
    np.testing.assert_allclose(
        load("auto", tmp_path / "log.g2o").observation, in_robot_frame(log).observation, atol=1e-9
    )


@pytest.mark.parametrize("line", ["# sensor: 1, 2", "# sensor: 1, 2, east", "# sensor:"])
def test_a_wrong_mounting_is_named(tmp_path, line):
    path = tmp_path / "log.csv"
    save(path, simulate_world(WorldConfig(steps=3), 1))
    path.write_text(f"# by hand\n{line}\n{path.read_text()}")
    with pytest.raises(LogError, match=r"log.csv, line 2: expected # sensor: x, y, yaw in meters"):
        load("auto", path)
