"""Gaze policies in simulated worlds, and simulated drives with a camera that turns."""

import numpy as np
import pytest

from gaze import Run, drive
from saccade.evaluation.trajectory import score_drive
from saccade.simulation import DriveConfig
from saccade.simulation.gaze_drive import gaze_drive
from saccade.visual.config import EGOMOTIONS
from support.nightly import nightly


@pytest.mark.parametrize("egomotion", [EGOMOTIONS[0], *nightly(*EGOMOTIONS[1:])])
def test_a_drive_whose_camera_is_turned_is_repeated_to_the_bit(egomotion):
    config = DriveConfig(world="rooms", frames=10, image_size=(240, 180), size=(7.0, 5.5))
    (simulated, first), (_, second) = (
        gaze_drive(config, "active", 1, egomotion=egomotion) for _ in range(2)
    )
    np.testing.assert_array_equal(first.trajectory.pose, second.trajectory.pose)
    assert score_drive(first.trajectory, simulated.truth).inside_3sigma > 0.8


@pytest.mark.parametrize("known", [False, *nightly(True)])
def test_active_gaze_halves_the_error_of_a_fixed_camera(known):
    fixed, active = (drive(Run("pond", policy, 100, known)) for policy in ("fixed", "active"))
    assert active[0] < 0.5 * fixed[0]
    assert active[1]
    assert active[2] > 0.8
