"""The sliding window, on points whose places and motions are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from saccade.frames import AHEAD, Camera
from saccade.slam.filter.robot_models import compose, heading_rotation
from saccade.visual import VisualConfig
from saccade.visual.camera import to_pixels
from saccade.visual.odometry_model import ODOMETRY_ERRORS, OdometryErrors
from saccade.visual.points import TrackedPoints
from saccade.visual.robot_motion import camera_motion, step_motions
from saccade.visual.self_calibration import CalibrationDrift, SelfCalibration
from saccade.visual.window import SlidingWindow
from saccade.visual.window_equations import FACTOR_KERNEL_WIDTH, NormalEquations, WindowSteps
from support.nightly import nightly

CAMERA = Camera(1226, 370, 700.0, 700.0, 600.0, 180.0, 0.54, np.array([0.5, 0.0, 1.6]), AHEAD)
CONTROL = np.array([0.8, 0.0, 0.02])
ODOMETRY = CONTROL, np.diag([0.2, 0.2, 0.1]) ** 2


def observed(camera, pose, world, ids, rng, pixel=0.0, disparity=0.0, distortion=0.0, offset=0.0):
    """The points (k, 3) in the frame of the world that a robot at a pose (3,) sees."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    xy, depth = to_pixels(camera, (world - [*pose[:2], 0]) @ rotation)
    ok = (depth > 3) & (np.abs(xy - [613, 185]) < [600, 180]).all(1)
    xy, depth = xy[ok], depth[ok]
    bf = camera.fx * camera.baseline
    right = xy - np.stack([bf / depth, 0 * depth], 1)
    center = np.array([camera.cx, camera.cy])
    for each in (xy, right):  # both lenses distort alike
        radius = np.square((each - center) / camera.fx).sum(1, keepdims=True)
        each += distortion * radius * (each - center)
    d = offset + xy[:, 0] - right[:, 0] + disparity * rng.standard_normal(len(xy))
    xy += pixel * rng.standard_normal(xy.shape)
    depth = bf / d
    return TrackedPoints.zeros(
        len(xy),
        xy=xy.astype(np.float32),
        depth=depth,
        depth_sigma=depth**2 * 0.4 / bf,
        id=ids[ok],
    )


def drive(steps, seed=0, gaps=(), acceleration=0.0, camera=CAMERA, config=None, **errors):
    """Controls (steps, 3) and covariances of a window on a curve; and the window."""
    rng = np.random.default_rng(seed)
    world = rng.uniform([-60, -60, -1], [60, 60, 5], (1500, 3))
    odometry_errors = OdometryErrors(scale_sigma=0.05, camera_sigma=0.01, turn_sigma=0.2)
    window = SlidingWindow(camera, config or VisualConfig(), odometry_errors)
    pose, ids = np.zeros(3), np.arange(len(world))
    last, controls, covariances = observed(camera, pose, world, ids, rng, **errors), [], []
    for i in range(steps):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turn = CONTROL[2] + acceleration * i
        pose = pose + np.array([c * CONTROL[0], s * CONTROL[0], turn])
        ids = ids + len(world) * (i in gaps)
        now = observed(camera, pose, world, ids, rng, **errors)
        common = now[np.isin(now.id, last.id)]
        odometry = CONTROL * (1.05, 1, 0.5), ODOMETRY[1]  # poor
        initial = camera_motion(camera, odometry[0])
        cameras = camera, camera
        control, covariance = window.add(last, common, initial, odometry, 0.1, cameras)
        controls.append(control)
        covariances.append(covariance)
        last = now
    return np.array(controls), np.array(covariances), window


@pytest.mark.parametrize("baseline", [0.54, 0.2])
def test_without_noise_the_motion_is_exact(baseline):
    controls, _, _ = drive(14, camera=replace(CAMERA, baseline=baseline))
    np.testing.assert_allclose(controls[3:].mean(0), CONTROL, atol=2e-3)


def test_a_step_without_points_is_mended_by_those_around_it():
    turned = CONTROL[2] + 0.004 * np.arange(14)
    error = (drive(14, gaps=(9,), acceleration=0.004)[0][:, 2] - turned).cumsum()
    assert abs(error[9] - error[8]) > 2e-3  # what odometry and the last motion make of it
    assert abs(error[12] - error[8]) < 0.5 * abs(error[9] - error[8])


def test_the_motion_before_a_gap_longer_than_the_window_is_not_forgotten():
    controls, _, _ = drive(24, gaps=range(10, 22))
    odometry = 12 * (CONTROL * (1.05, 1, 0.5) - CONTROL)
    error = (controls[10:22] - CONTROL).sum(0)
    assert abs(error[0]) < 0.3 * abs(odometry[0])
    assert abs(error[2]) < 0.3 * abs(odometry[2])


@pytest.mark.nightly
def test_a_window_has_less_error_than_pairs_of_frames():
    def error(window):
        config = VisualConfig(window=window)
        ends = [
            drive(12, seed, pixel=0.5, disparity=0.4, config=config)[0][2:].sum(0) - 10 * CONTROL
            for seed in range(4)
        ]
        return np.sqrt(np.square(ends).mean(0))

    assert error(10)[0] < 0.8 * error(2)[0]


def test_the_covariance_of_a_step_is_that_of_its_errors():
    controls, covariances, _ = drive(60, pixel=0.5, disparity=0.4)
    error = controls[10:] - CONTROL
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariances[10:]), error)
    assert 0.3 * 3 < squared.mean() < 3 * 3  # pixels of both frames, not one, err


@pytest.mark.parametrize("distortion", [0.03, *nightly(0.0)])
def test_the_distortion_of_the_lens_is_found(distortion):
    _, _, window = drive(40, pixel=0.3, disparity=0.2, distortion=distortion)
    assert window.calibration.error[0] == pytest.approx(-distortion, abs=6e-3)
    assert abs(window.calibration.error[1]) < 0.2


@pytest.mark.nightly
def test_what_an_offset_of_the_disparities_does_to_the_pose_is_known():
    ends, window = [], None
    for offset in (-0.05, 0.05):  # too little to be corrected
        controls, _, window = drive(20, pixel=0.1, offset=offset)
        pose = np.zeros(3)
        for control in controls:
            pose = compose(pose, control)[0]
        ends.append(pose)
        assert window.calibration.error[2] == 0
    back = heading_rotation(ends[1][2]).T
    change = back @ (ends[1] - ends[0]) / 0.1
    np.testing.assert_allclose(window.drift.by_errors[:2, 2], change[:2], rtol=0.1, atol=0.02)
    longer = window.drift.report().scale_by_offset
    assert longer == pytest.approx(abs(change[0]) / (20 * CONTROL[0]), rel=0.15)
    spread = window.drift.covariance(0.0)
    assert spread[0, 0] > (0.04 * window.drift.by_errors[0, 2]) ** 2
    assert window.drift.covariance(np.pi / 2)[1, 1] == pytest.approx(spread[0, 0])


@pytest.mark.parametrize("offset", [0.8, *nightly(0.0)])
def test_an_offset_of_all_disparities_is_found_and_none_where_there_is_none(offset):
    _, _, window = drive(40, pixel=0.3, disparity=0.2, offset=offset)
    assert window.calibration.error[2] == pytest.approx(-offset, abs=0.15 if offset else 0)
    egomotion = window.drift.covariance(0.0, is_corrected=False)[0, 0]  # has the whole offset
    if offset:
        assert egomotion > (0.7 * window.drift.by_errors[0, 2]) ** 2
        assert window.drift.covariance(0.0)[0, 0] < egomotion


@pytest.mark.parametrize("column", [3, 4])
def test_focal_length_and_yaw_displace_a_pose_as_a_longer_and_a_turned_path_do(column, rng):
    steps = np.array([0.9, 0.05, 0.04]) + 0.1 * rng.standard_normal((30, 3))
    drift = CalibrationDrift(SelfCalibration(CAMERA, 6))
    ends = [np.zeros(3), np.zeros(3)]
    for x, y, turn in steps:
        drift.add(np.array([x, y, turn]), np.zeros((3, 3)), np.zeros(3))
        for i, error in enumerate((-1e-6, 1e-6)):
            c, s = np.cos(error), np.sin(error)
            wrong = [c * x - s * y, s * x + c * y, turn]
            if column == 3:  # points look further away, and turns smaller
                wrong = [(1 + error) * x, (1 + error) * y, (1 - error) * turn]
            ends[i] = compose(ends[i], np.array(wrong))[0]
    change = heading_rotation(ends[0][2]).T @ (ends[1] - ends[0]) / 2e-6
    np.testing.assert_allclose(drift.by_errors[:, column], change, rtol=1e-4, atol=1e-4)


def robot_motions(rotation, translation, mount, position):
    """(n - 1, 6) motions of the robot, by the transformations of points from frame to frame."""
    motions = []
    for k in range(len(rotation) - 1):
        R = mount[k + 1] @ rotation[k + 1] @ (mount[k] @ rotation[k]).T
        t = (
            mount[k + 1] @ translation[k + 1]
            + position
            - R @ (mount[k] @ translation[k] + position)
        )
        x, y, z = -R.T @ t
        turn, pitch, roll = Rotation.from_matrix(R.T).as_euler("ZYX")
        motions.append([x, y, turn, z, roll, pitch])
    return np.array(motions)


def test_factors_are_the_slope_of_a_robust_cost(rng):
    n, m, width = 4, ODOMETRY_ERRORS, FACTOR_KERNEL_WIDTH
    seconds = rng.uniform(0.08, 0.12, n - 1)
    mount = CAMERA.rotation @ Rotation.from_rotvec(rng.normal(0, 0.2, (n, 3))).as_matrix()
    place = np.cumsum(rng.uniform(0.5, 1, (n, 3)) * (1, 0.1, 0), 0)
    rotation = np.swapaxes(mount, 1, 2)  # the robot does not turn: the slopes are exact
    translation = -(rotation @ (place + CAMERA.position)[:, :, None])[:, :, 0]
    odometry = rng.normal((0.7, 0, 0), 0.02, (n - 1, 3))
    by_errors = rng.normal(0, 1, (n - 1, 3, m))
    weight = np.array([np.diag(rng.uniform(1, 9, 6)) + 0.5 for _ in range(n - 1)])
    before, information = rng.normal(0, 1, 6), 0.1 * np.eye(6) + 0.05
    acceleration = np.array([2.0, 0.5, 0.5, 0.5, 0.2, 0.2])

    def cost(p):
        by_pose = p[: 6 * n].reshape(n, 6)
        R = Rotation.from_rotvec(by_pose[:, :3]).as_matrix() @ rotation
        motion = robot_motions(R, translation + by_pose[:, 3:], mount, CAMERA.position)
        residual = -motion
        residual[:, :3] += odometry + by_errors @ p[6 * n :]
        rate = motion / seconds[:, None]
        squares = [r @ W @ r for r, W in zip(residual, weight, strict=True)]
        squares.append((before - rate[0]) @ information @ (before - rate[0]))
        sigma = acceleration * (seconds[1:] + seconds[:-1])[:, None] / 2
        squares.extend(np.square((rate[1:] - rate[:-1]) / sigma).sum(1))
        return width**2 / 2 * np.log(1 + np.array(squares) / width**2).sum()

    size = 3 + 6 * n + m
    equations = NormalEquations(size)
    motion, slope = step_motions((rotation, translation), mount, CAMERA.position)
    made = {"control": odometry, "by_errors": by_errors, "information": weight, "seconds": seconds}
    steps = WindowSteps.zeros(n - 1, **made)
    steps.add_to(equations, motion, slope, np.zeros(m), acceleration, (before, information))
    H, g = equations.information, equations.gradient
    steps = 1e-6 * np.eye(size - 3)
    numeric = np.array([(cost(step) - cost(-step)) / 2e-6 for step in steps])
    np.testing.assert_allclose(g[3:], -numeric, rtol=1e-5, atol=1e-5)
    expected = robot_motions(rotation, translation, mount, CAMERA.position)
    np.testing.assert_allclose(motion, expected, atol=1e-12)
    assert (np.linalg.eigvalsh(H) > -1e-9).all()
    np.testing.assert_allclose(H, H.T, atol=1e-9)
