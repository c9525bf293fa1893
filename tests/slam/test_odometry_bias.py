"""Wheels that are off in the same way all the time, in worlds where it is known by how much."""

import dataclasses
import re

import numpy as np
import pytest

from saccade import slam
from saccade.evaluation.runs import summarize_run
from saccade.motions import MOTIONS, RELATIVE
from support.biased_odometry import unbiased
from support.circular_log import simulate

BIAS = np.array([0.08, -0.04, 0.15])


def _biased(rng, motion, noise):
    """A log whose robot drove otherwise than it says."""
    log, truth, world = simulate(rng, motion, noise=noise, steps=200)
    said = log.control.copy()
    for _ in range(50):  # what must have been logged for `unbiased` to give the real way
        said += log.control - unbiased(said, BIAS)
    bias = (0.1, 0.1, 0.1)
    declared = {"odometry_bias": bias, "range_errors": (1e-3, 1e-3)}  # ranges measure the scale
    return dataclasses.replace(log, control=said, **declared), truth, world


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("kind", ["invariant", "standard"])
def test_what_the_wheels_are_off_by_is_found(rng, motion, kind):
    log, truth, _ = _biased(rng, motion, noise=0.0)
    result = slam.run(log, slam.EkfConfig(errors=kind))
    ignored = slam.run(log, slam.EkfConfig(errors=kind, estimate_systematic_errors=False))
    off = [np.hypot(*(r.trajectory.pose - truth)[:, :2].T).mean() for r in (result, ignored)]
    assert off[0] < 0.1 * off[1]
    assert ignored.odometry_bias is None
    turned = np.abs(log.control[0, -1]) / log.control[0, 0]  # on a circle the way lost in turning
    assert result.odometry_bias[0] - turned * result.odometry_bias[2] == pytest.approx(
        BIAS[0] - turned * BIAS[2], abs=0.005
    )
    assert result.odometry_bias[1] == pytest.approx(BIAS[1], abs=0.005)


@pytest.mark.parametrize("motion", MOTIONS)
def test_bias_changes_the_pose_as_its_slope_says(rng, motion):
    """A robot that is unsure of its wheels alone: its covariance is that of moving with them."""
    log, _, _ = simulate(rng, motion, steps=5)
    sigma, tiny = np.array([0.1, 0.2, 0.3]), 1e-6
    ekf = slam.EkfSlam(
        np.append(log.start, BIAS),
        np.diag([0, 0, 0, *sigma**2]),
    )

    def end(bias):
        pose = log.start
        for u in unbiased(log.control, bias):
            pose = getattr(slam, motion)(pose, u)[0]
        return pose

    for u in log.control:
        ekf.predict(u, np.zeros((len(u), len(u))))
    slope = np.array([end(BIAS + tiny * e) - end(BIAS - tiny * e) for e in np.eye(3)]).T / 2 / tiny
    exact = motion == RELATIVE  # others to first order
    np.testing.assert_allclose(ekf.pose, end(BIAS), atol=1e-12 if exact else 1e-3)
    found, expected = ekf.pose_covariance, slope @ np.diag(sigma**2) @ slope.T
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 if exact else 0.02)


def test_wheels_that_differ_are_found_by_a_log_that_declares_nothing(rng):
    """Turn of .03 rad per meter, as of wheels that differ by 1 % on an axle of .35 m."""
    log, truth, _ = simulate(rng, "compose", steps=300)
    said = log.control - log.control[:, :1] * [0.0, 0.0, 0.03]
    log = dataclasses.replace(log, control=said)
    result = slam.run(log)
    ignored = slam.run(log, slam.EkfConfig(estimate_systematic_errors=False))
    sigma = np.sqrt(result.bias_covariance[1, 1])
    assert 0 < sigma < 0.01
    assert abs(result.odometry_bias[1] - 0.03) < 3 * sigma
    one, two = (
        np.hypot(*(each.trajectory.pose - truth)[:, :2].T).mean() for each in (result, ignored)
    )
    assert one < two
    assert ignored.consistency.mean > result.consistency.mean
    words = summarize_run(log, result)["odometry_correction"]
    mean, std = re.search(r"(\+\S+) ± (\S+) degrees per meter", words).groups()
    assert len(std.lstrip("0.")) == 2  # significant digits
    assert float(std) == pytest.approx(np.degrees(sigma), rel=0.05)
    assert float(mean) == pytest.approx(np.degrees(result.odometry_bias[1]), abs=float(std) / 10)
