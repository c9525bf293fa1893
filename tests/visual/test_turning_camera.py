"""A camera that turns on the robot: its geometry, its drives on disk, and a simulated one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from saccade import visual
from saccade.datasets import load_drive, save_drive
from saccade.errors import ConfigError, DriveError
from saccade.evaluation.runs import summarize_drive
from saccade.frames import AHEAD, Camera, CameraTurn, Gaze, GazeLimits, directions
from saccade.plane import steps_between
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.visual.camera import from_pixels, move_pixels, to_pixels
from saccade.visual.egomotion import correspondences_of, estimate_motion
from saccade.visual.robot_motion import camera_motion, robot_motion
from support.track_recorder import record_tracks

CAMERA = Camera(320, 240, 340, 340, 160, 120, 0.1, np.array([0.2, 0.05, 0.7]), AHEAD)
CONTROL = np.array([0.2, 0.03, 0.1])
BEFORE, AFTER = CameraTurn(0.3, -0.05), CameraTurn(0.55, 0.02)
SMALL = DriveConfig(
    world="rooms", frames=24, frames_per_lap=200, image_size=(120, 90), field_of_view_deg=50.0
)


@pytest.fixture(scope="module")
def pan_drive():
    """A drive whose camera turns to the left, with all frames loaded."""
    pan = PanCamera(GazeLimits(rate=0.6, latency=0.0), seed=3)
    drive = simulate_drive(SMALL, 1, pan)
    pan.turn_to(0.0, Gaze(1.0, reason="explore"))
    frames = [drive.load(i) for i in range(len(drive))]
    return replace(drive, load=lambda i: frames[i])


def test_pan_turns_left_and_tilt_up_as_rotations_about_the_robots_axes():
    turn = CameraTurn(0.7, 0.3)
    expected = Rotation.from_euler("ZY", [0.7, -0.3]).as_matrix()
    assert_allclose(turn.rotation, expected, atol=1e-12)
    axis = CAMERA.turned(turn).rotation[:, 2]
    assert_allclose(np.arctan2(axis[1], axis[0]), 0.7)
    assert_allclose(np.arcsin(axis[2]), 0.3)
    assert CAMERA.turned(None) is CAMERA


def test_the_motion_of_the_robot_is_the_same_however_the_camera_turns():
    before, after = CAMERA.turned(BEFORE), CAMERA.turned(AFTER)
    control, off_plane, _ = robot_motion(after, *camera_motion(after, CONTROL, before), before)
    assert_allclose(control, CONTROL, atol=1e-12)
    assert_allclose(off_plane, 0, atol=1e-12)


@pytest.mark.parametrize("turn", [0.0, 0.1])
def test_the_jacobian_of_the_motion_of_a_turned_camera_is_that_of_finite_differences(turn):
    before, after = CAMERA.turned(BEFORE), CAMERA.turned(AFTER)
    R, t = camera_motion(after, np.array([0.2, 0.03, turn]), before)

    def motion(p):
        turned = Rotation.from_rotvec(p[:3]).as_matrix() @ R
        return np.concatenate(robot_motion(after, turned, t + p[3:], before)[:2])

    steps = 1e-6 * np.eye(6)
    numeric = np.stack([(motion(step) - motion(-step)) / 2e-6 for step in steps], 1)
    slope = robot_motion(after, R, t, before).jacobian
    assert_allclose(slope[:4], numeric[:4], atol=1e-6)
    assert_allclose(slope[4:], numeric[4:], atol=max(turn, 1e-6))  # of first order in the angles


def test_the_egomotion_of_a_turning_camera_is_found():
    rng = np.random.default_rng(0)
    before, after = CAMERA.turned(BEFORE), CAMERA.turned(AFTER)
    xy, depth = rng.uniform((80, 20), (300, 220), (80, 2)), rng.uniform(1, 6, 80)
    points = from_pixels(before, xy, depth)
    turned = Rotation.from_euler("Z", CONTROL[2]).as_matrix()
    now, _ = to_pixels(after, (points - np.append(CONTROL[:2], 0)) @ turned)
    unknown = np.full(80, np.nan)
    pairs = correspondences_of(xy, now, depth, 0.01 * depth, unknown, unknown)
    prior = CONTROL + np.array([0.02, -0.01, 0.01]), np.diag([0.02, 0.01, 0.02]) ** 2
    motion = estimate_motion(after, pairs, 0.1, prior, before)
    assert_allclose(motion.control, CONTROL, atol=1e-3)
    assert motion.inliers.all()
    guess = move_pixels(after, camera_motion(after, CONTROL, before), xy.astype(np.float32), depth)
    assert_allclose(guess, now, atol=1e-3)
    assert len(directions(after, guess)) == 80


def test_a_recorded_turn_is_written_and_read(pan_drive, tmp_path):
    save_drive(tmp_path / "pan", pan_drive)
    again = load_drive("auto", tmp_path / "pan")
    for i in (0, 9, 23):
        assert again.load(i).turn == pan_drive.load(i).turn
    assert again.load(9).turn.reason == "explore"
    rows = (tmp_path / "pan" / "gaze.csv").read_text().splitlines()
    (tmp_path / "pan" / "gaze.csv").write_text("\n".join(rows[:-1]) + "\n")
    with pytest.raises(DriveError, match=r"gaze\.csv: expected a row for each of 24 frames"):
        load_drive("auto", tmp_path / "pan")


def test_a_turning_camera_maps_and_one_that_ignores_its_turn_does_not(pan_drive):
    mapped = summarize_drive(pan_drive, visual.run(pan_drive))
    assert mapped["ate_unaligned_m"] < 0.05
    assert mapped["inside_3sigma"] > 0.9
    ignorant = replace(pan_drive, load=lambda i: replace(pan_drive.load(i), turn=None))
    truth = pan_drive.truth.pose[:, 2]
    heading = visual.run(ignorant).trajectory.pose[:, 2]
    assert np.abs(heading - truth).max() > 0.3  # it takes the turn for the robot's


def test_by_wheels_every_observation_corrects_the_pose(pan_drive):
    """Within the ellipse, which is smaller than that of odometry and its systematic errors."""
    run = visual.run(pan_drive, visual.VisualConfig(egomotion="wheels"))
    tracked = run.observations.kind == visual.ObservationKind.TRACKED
    assert tracked.sum() > 20
    assert np.isfinite(run.observations.innovation[tracked]).all()
    assert summarize_drive(pan_drive, run)["inside_3sigma"] == 1
    heading = np.sum(pan_drive.control_covariance[:, 2, 2])
    way = np.hypot(*pan_drive.control[:, :2].T).sum()
    alone = np.sqrt(heading + (pan_drive.odometry_bias[1] * way) ** 2)
    assert np.sqrt(run.trajectory.covariance[-1, 2, 2]) < 0.5 * alone


def test_wheels_ask_for_depth(pan_drive):
    mono = replace(pan_drive, camera=replace(pan_drive.camera, baseline=0.0))
    with pytest.raises(ConfigError, match="egomotion: expected camera"):
        visual.run(mono, visual.VisualConfig(egomotion="wheels"))


def test_tracks_of_a_turning_camera_know_its_turn(pan_drive):
    _, recorded = record_tracks(pan_drive)
    assert recorded.load(12).turn == pan_drive.load(12).turn
    error = visual.run(recorded).trajectory.pose - pan_drive.truth.pose
    assert np.hypot(*error[:, :2].T).max() < 0.1


@pytest.mark.nightly
def test_a_second_camera_that_is_fixed_measures_the_motion_of_a_robot_that_looks_around(pan_drive):
    second = simulate_drive(replace(SMALL, field_of_view_deg=70.0), 1)
    measured = visual.measure_odometry(pan_drive, second)
    steps = steps_between(pan_drive.truth.pose)
    wheels, error = (drive.control - steps for drive in (pan_drive, measured))
    assert abs(error[:, 2].sum()) < abs(wheels[:, 2].sum()) / 3
    nees = (error * np.linalg.solve(measured.control_covariance, error[..., None])[..., 0]).sum(1)
    assert 0.02 < nees.mean() / 3 < 1.5
    result = visual.run(measured, visual.VisualConfig(egomotion="second-camera"))
    assert summarize_drive(measured, result)["ate_m"] < 0.02
    assert measured.load is pan_drive.load
