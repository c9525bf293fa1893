"""Systematic errors of odometry, estimated from motions that do not include it."""

import numpy as np
import pytest

from saccade.visual.motion_prior import SideSlip

SECONDS, SPEED = 0.1, 10.0


def slipping(turn_rate, angle, per_acceleration):
    """A control without side-slip, and the metres to the left of a robot that slips."""
    control = np.array([SPEED * SECONDS, 0.0, turn_rate * SECONDS])
    return control, SPEED * SECONDS * (angle + per_acceleration * SPEED * turn_rate)


@pytest.mark.parametrize(("angle", "per_acceleration"), [(0.008, 0.0), (0.0, -0.012), (0.0, 0.0)])
def test_side_slip_is_learnt_on_the_drive(angle, per_acceleration):
    rng, slip = np.random.default_rng(1), SideSlip()
    control, _ = slipping(0.3, angle, per_acceleration)
    before = slip.variance(control, SECONDS)
    for i in range(400):
        control, left = slipping(0.4 * np.sin(i / 20), angle, per_acceleration)
        difference = left - slip.corrected(control, SECONDS)[1] + rng.normal(0, 0.01)
        slip.update(difference, control, SECONDS, 0.01**2)
    control, left = slipping(0.3, angle, per_acceleration)
    assert slip.corrected(control, SECONDS)[1] == pytest.approx(left, abs=0.003)
    assert slip.variance(control, SECONDS) < 0.05 * before


def test_a_sideways_jump_is_no_side_slip():
    slip = SideSlip()
    control, _ = slipping(0.0, 0.0, 0.0)
    slip.update(0.5, control, SECONDS, 0.01**2)
    assert (slip.corrected(control, SECONDS) == control).all()


def test_a_robot_that_stands_tells_nothing_of_side_slip():
    slip = SideSlip()
    slip.update(0.001, np.zeros(3), SECONDS, 0.01**2)
    control, _ = slipping(0.0, 0.0, 0.0)
    assert (slip.corrected(control, SECONDS) == control).all()
    assert slip.variance(control, SECONDS) == pytest.approx(0.01**2)
