"""Gaze in visual SLAM: the loop from a decision to the next frame, and what drifts to the side."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from saccade import visual
from saccade.frames import Camera, CameraTurn, Gaze, GazeLimits
from saccade.plane import steps_between
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.visual.camera import to_pixels
from saccade.visual.egomotion import correspondences_of, estimate_motion
from saccade.visual.gaze_control import MAX_ASIDE, GazeControl
from saccade.visual.robot_motion import camera_motion


def panning(frames, image_size):
    """A camera that pans, and the drive that it records."""
    pan = PanCamera()
    config = {"world": "rooms", "frames": frames, "image_size": image_size}
    return pan, simulate_drive(DriveConfig(frames_per_lap=200, **config), 0, pan)


def test_a_view_to_the_side_tells_an_advance_from_a_turn_worse_than_one_ahead():
    camera = Camera(320, 240, 340, 340, 160, 120, 0.15)
    angle, rng = np.arctan2(camera.cx, camera.fx), np.random.default_rng(0)
    prior = np.array([0.08, 0.0, 0.01]), np.diag(np.square([0.004, 0.001, 0.004]))
    error = []
    for pan in (0.0, np.pi / 2):
        turned = camera.turned(CameraTurn(pan))
        bearing = pan + rng.uniform(-0.9 * angle, 0.9 * angle, 150)
        r = 1 / np.maximum(np.abs(np.sin(bearing)) / 1.1, np.cos(bearing) / 5)  # a corridor
        z = rng.uniform(-0.2, 0.2, 150)
        points = np.stack([r * np.cos(bearing), r * np.sin(bearing), z], 1)
        xy, depth = to_pixels(turned, points)
        R, t = camera_motion(turned, prior[0])
        in_camera = (points - turned.position) @ turned.rotation
        now = np.asarray(in_camera @ R.T + t)
        moved = np.stack([340 * now[:, 0] / now[:, 2] + 160, 340 * now[:, 1] / now[:, 2] + 120], 1)
        sigma = 0.4 * depth**2 / (340 * 0.15)
        pairs = correspondences_of(xy, moved, depth, sigma, now[:, 2], sigma)
        covariance = estimate_motion(turned, pairs, 0.5, prior).covariance
        error.append(np.diag(covariance) @ [1, 1, 4])  # of the position two meters on
    assert error[1] > 3 * error[0]


@pytest.mark.parametrize("egomotion", ["camera", "wheels"])
def test_a_camera_that_measures_the_motion_looks_no_further_aside_than_it_can(egomotion):
    pan, drive = panning(30, (96, 72))
    control = GazeControl("active", drive.camera, pan.limits, pan.turn_to)
    visual.run(drive, visual.VisualConfig(egomotion=egomotion), gaze=control)
    widest = max(abs(decision.pan) for decision in control.decisions)
    assert (0.1 < widest <= MAX_ASIDE) if egomotion == "camera" else widest > 2 * MAX_ASIDE


def test_a_pan_camera_has_latency_rate_and_range_and_no_foresight():
    pan = PanCamera(GazeLimits(pan=(-1.0, 1.0), rate=0.5, latency=0.2))
    pan.turn_to(1.0, Gaze(2.0))
    assert_allclose([pan.angle(t) for t in (1.2, 1.4, 3.2, 9.0)], [0, 0.1, 1.0, 1.0])
    pan.turn_to(1.4, Gaze(0.0))
    assert_allclose([pan.angle(t) for t in (1.4, 1.6, 1.8, 3.0)], [0.1, 0.2, 0.1, 0.0], atol=1e-12)
    errors = [pan.measured(t).pan - pan.angle(t) for t in np.arange(2, 40, 0.1)]
    assert np.std(errors) == pytest.approx(pan.measured(5.0).sigma, rel=0.15)


def test_the_next_frame_is_seen_where_the_policy_looked():
    pan, drive = panning(16, (96, 72))
    control = GazeControl(lambda gazer: 0.4, drive.camera, pan.limits, pan.turn_to)
    seen = []
    load = drive.load
    drive = replace(drive, load=lambda i: seen.append(load(i)) or seen[-1])
    visual.run(drive, gaze=control)
    turns = [frame.turn.pan for frame in seen]
    assert_allclose(turns[:2], 0, atol=0.01)
    assert_allclose(turns[-3:], 0.4, atol=0.01)
    assert control.decisions[0].reason == "a custom policy"
    assert control.is_leaving is False


def test_the_gazer_of_a_drive_knows_its_motion_its_landmarks_and_their_salience():
    pan, drive = panning(20, (160, 120))
    found = []

    def look(gazer):
        found.append((dict(gazer.salience), gazer.plan.copy(), dict(gazer.last_seen)))
        return 0.0

    visual.run(drive, gaze=GazeControl(look, drive.camera, pan.limits, pan.turn_to))
    salience, plan, seen = found[-1]
    assert len(salience) > 5
    assert all(0 <= value <= 1 for value in salience.values())
    assert set(salience) <= set(seen)
    steps = steps_between(drive.truth.pose)
    assert plan[0, 0] == pytest.approx(2 * steps[:, 0].mean(), rel=0.5)
