"""Normal equations and ground samples of a camera's motion against formulas for one point."""

import sys
import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import map_coordinates
from threadpoolctl import threadpool_info

from saccade import visual
from saccade.frames import Camera
from saccade.simulation import DriveConfig, simulate_drive
from saccade.visual.egomotion import MAX_INVERSE_DEPTH, correspondences_of, normal_equations
from saccade.visual.frontend import Prefetcher
from saccade.visual.ground_scale import GroundTracker, warp_ground
from saccade.visual.robot_motion import camera_motion

CAMERA = Camera(640, 360, 500, 480, 320, 120, position=np.array([0.2, 0.1, 1.5]))
PIXEL, SOFT, STEP = 0.4, 3.0, 1e-6


def predicted(xy, inverse_depth, R, t):
    """Pixels and inverse depth after a motion, of a point of before."""
    ray = np.array([(xy[0] - CAMERA.cx) / CAMERA.fx, (xy[1] - CAMERA.cy) / CAMERA.fy, 1.0])
    x, y, z = R @ ray / inverse_depth + t
    return np.array([CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy, 1 / z])


def slope(of, size):
    """(3, size) by finite differences."""
    steps = STEP * np.eye(size)
    return np.stack([(of(step) - of(-step)) / (2 * STEP) for step in steps], 1)


def expected_equations(pairs, at, R, t):
    """The result of `normal_equations`, one point after the other."""
    information, gradient, square, likely = np.zeros((6, 6)), np.zeros(6), [], []
    for i in range(len(at)):
        xy, h = pairs.previous[i], at[i]
        again = np.isfinite(pairs.current_inverse_depth[i])
        rows = [0, 1, 2] if again else [0, 1]
        seen = np.append(pairs.current[i], pairs.current_inverse_depth[i])[rows]
        J = slope(lambda e: predicted(xy, h, cv2.Rodrigues(e[:3])[0] @ R, t + e[3:]), 6)[rows]  # noqa: B023
        d = slope(lambda e: predicted(xy, h + e[0], R, t), 1)[rows, 0]  # noqa: B023
        missed = seen - predicted(xy, h, R, t)[rows] + d * (h - pairs.inverse_depth[i])
        sigma = np.array(
            [np.sqrt(2) * PIXEL, np.sqrt(2) * PIXEL, pairs.current_inverse_depth_sigma[i]]
        )[rows]
        N = np.linalg.inv(np.diag(sigma**2) + pairs.inverse_depth_sigma[i] ** 2 * np.outer(d, d))
        square.append(missed @ N @ missed)
        count = 1 / (1 + square[-1] / SOFT**2) ** 2
        information += count * J.T @ N @ J
        gradient += count * J.T @ N @ missed
        better = pairs.inverse_depth[i] + pairs.inverse_depth_sigma[i] ** 2 * d @ N @ missed
        likely.append(min(max(better, 0), MAX_INVERSE_DEPTH))
    return information, gradient, np.array(square), np.array(likely)


@pytest.mark.parametrize("known", [0.0, 0.5, 1.0])
def test_normal_equations_are_those_of_the_formulas(rng, known):
    k = 12
    R, t = camera_motion(CAMERA, np.array([1.2, 0.05, 0.08]))
    before, depth = rng.uniform((20, 20), (620, 340), (k, 2)), rng.uniform(4, 60, k)
    now = np.array([predicted(p, 1 / d, R, t)[:2] for p, d in zip(before, depth, strict=True)])
    now += rng.normal(0, 3, now.shape)
    deep = np.where(rng.uniform(size=k) < known, depth - t[2], np.nan)
    was = np.where(rng.uniform(size=k) < known, depth, np.nan)
    pairs = correspondences_of(before, now, was, 0.05 * depth, deep, 0.04 * depth)
    at = pairs.inverse_depth * rng.uniform(0.9, 1.1, k)
    expected = expected_equations(pairs, at, R, t)
    found = normal_equations(CAMERA, pairs, (R, t), at, PIXEL, SOFT)
    for ours, theirs in zip(found, expected, strict=True):
        assert_allclose(ours, theirs, rtol=1e-5, atol=1e-5 * np.abs(theirs).max())


def test_a_point_behind_the_camera_has_no_weight():
    unknown = np.full(1, np.nan)
    pairs = correspondences_of(
        np.zeros((1, 2)), np.zeros((1, 2)), np.full(1, 2.0), np.ones(1), *(unknown,) * 2
    )
    back = np.eye(3), np.array([0.0, 0.0, -3.0])
    found = normal_equations(CAMERA, pairs, back, pairs.inverse_depth, PIXEL, SOFT)
    information, _, squared, inverse_depth = found
    assert np.isinf(squared[0])
    assert not information.any()
    assert_allclose(inverse_depth, pairs.inverse_depth)


def test_the_ground_is_sampled_where_its_plane_is(rng):
    """On a ramp neither bilinear interpolation nor slopes err."""
    R, t = camera_motion(CAMERA, np.array([4.5, 0.02, 0.03]))
    way = np.linalg.norm(t)
    rays = GroundTracker(CAMERA).rays[::10]
    v, u = np.mgrid[:360, :640]
    ramp = 5.0 * u + 3.0 * v
    images = np.stack([ramp, np.full_like(ramp, 5), np.full_like(ramp, 3)])
    axes = cv2.Rodrigues(rng.normal(0, 0.05, 3))[0][[1, 2, 0]]

    def looked_up(found):
        plane = axes.T @ (found[0] * np.append(1.0, found[1:]))
        seen = rays @ R.T + (rays @ plane)[:, None] * t / way
        x, y = (seen[:, :2] / seen[:, 2:] * (500, 480) + (320, 120)).T
        inside = (x > 1) & (y > 1) & (x < 638) & (y < 358)
        return np.where(inside, map_coordinates(ramp, [y, x], np.float64, order=1), np.nan)

    found = np.array([way / 1.5, 0.01, -0.02])
    by = np.stack([axes.T @ np.append(1, found[1:]), found[0] * axes[1], found[0] * axes[2]])
    values, J, sampled = warp_ground(CAMERA, rays, (R, found[0] * t / way), by, images)
    expected = looked_up(found)
    inside = np.isfinite(expected)
    assert 10 < inside.sum() < len(rays)
    assert (sampled == inside).all()
    assert_allclose(values, expected[inside], atol=1e-9)
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        change = (looked_up(found + step) - looked_up(found - step)) / 2e-6
        assert_allclose(J[:, k], change[inside], rtol=1e-5, atol=1e-3)


def test_items_are_prefetched_once_in_order_and_fail_where_they_are_used():
    begun = []

    def work(number):
        begun.append(number)
        if number == 3:
            raise ValueError("3")
        return number**2

    done = []
    with Prefetcher(work, 6, 4) as prefetched:
        for number in range(6):
            try:
                done.append(prefetched(number))
            except ValueError as error:
                done.append(str(error))
            assert len(begun) <= min(number + 5, 6)
    assert done == [0, 1, 4, "3", 16, 25]
    assert begun == list(range(6))


def test_a_run_leaves_no_thread_and_no_setting_behind():
    drive = simulate_drive(DriveConfig(frames=2))
    visual.run(drive)  # loads libraries with threads of their own
    before = sys.getswitchinterval(), threadpool_info()
    seen = []

    def load(number):
        seen.append((sys.getswitchinterval(), threadpool_info()))
        return drive.load(number)

    visual.run(replace(drive, load=load))
    assert all(each == before for each in seen)
    assert not [each for each in threading.enumerate() if "prefetch" in each.name]
    with visual.dedicated_process():
        assert sys.getswitchinterval() < before[0]
    assert (sys.getswitchinterval(), threadpool_info()) == before
