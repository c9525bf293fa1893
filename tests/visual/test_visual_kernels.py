"""The compiled passes of a camera's motion against formulas written for a person."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import map_coordinates

from saccade.frames import Camera
from saccade.visual.egomotion import CLOSEST, _accumulate, camera_motion, make_pairs
from saccade.visual.ground_scale import GroundTracker, _warp
from saccade.visual.prefetch import Prefetcher

CAMERA = Camera(640, 360, 500, 480, 320, 120, position=np.array([0.2, 0.1, 1.5]))
VIEW = CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy
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


def voted(pairs, at, R, t):
    """The sums of `_vote`, one point after the other."""
    information, gradient, square, likely = np.zeros((6, 6)), np.zeros(6), [], []
    for i in range(len(at)):
        xy, h = pairs.before[i], at[i]
        again = np.isfinite(pairs.inverse_depth_now[i])
        rows = [0, 1, 2] if again else [0, 1]
        seen = np.append(pairs.now[i], pairs.inverse_depth_now[i])[rows]
        J = slope(lambda e: predicted(xy, h, cv2.Rodrigues(e[:3])[0] @ R, t + e[3:]), 6)[rows]  # noqa: B023
        d = slope(lambda e: predicted(xy, h + e[0], R, t), 1)[rows, 0]  # noqa: B023
        missed = seen - predicted(xy, h, R, t)[rows] + d * (h - pairs.inverse_depth[i])
        sigma = np.array([np.sqrt(2) * PIXEL, np.sqrt(2) * PIXEL, pairs.sigma_now[i]])[rows]
        N = np.linalg.inv(np.diag(sigma**2) + pairs.sigma[i] ** 2 * np.outer(d, d))
        square.append(missed @ N @ missed)
        count = 1 / (1 + square[-1] / SOFT**2) ** 2
        information += count * J.T @ N @ J
        gradient += count * J.T @ N @ missed
        better = pairs.inverse_depth[i] + pairs.sigma[i] ** 2 * d @ N @ missed
        likely.append(min(max(better, 0), CLOSEST))
    return information, gradient, np.array(square), np.array(likely)


@pytest.mark.parametrize("known", [0.0, 0.5, 1.0])
def test_points_vote_for_a_motion_as_the_formulas_say(rng, known):
    k = 12
    R, t = camera_motion(CAMERA, np.array([1.2, 0.05, 0.08]))
    before, depth = rng.uniform((20, 20), (620, 340), (k, 2)), rng.uniform(4, 60, k)
    now = np.array([predicted(p, 1 / d, R, t)[:2] for p, d in zip(before, depth, strict=True)])
    now += rng.normal(0, 3, now.shape)
    deep = np.where(rng.uniform(size=k) < known, depth - t[2], np.nan)
    was = np.where(rng.uniform(size=k) < known, depth, np.nan)
    pairs = make_pairs(before, now, was, 0.05 * depth, deep, 0.04 * depth)
    at = pairs.inverse_depth * rng.uniform(0.9, 1.1, k)
    expected = voted(pairs, at, R, t)
    information, gradient, square, found = np.zeros((6, 6)), np.zeros(6), np.zeros(k), at.copy()
    _accumulate(pairs, VIEW, R, t, PIXEL, SOFT, found, information, gradient, square)
    for ours, theirs in zip((information, gradient, square, found), expected, strict=True):
        assert_allclose(ours, theirs, rtol=1e-5, atol=1e-5 * np.abs(theirs).max())


def test_a_point_behind_the_camera_has_no_vote():
    unknown = np.full(1, np.nan)
    pairs = make_pairs(
        np.zeros((1, 2)), np.zeros((1, 2)), np.full(1, 2.0), np.ones(1), *(unknown,) * 2
    )
    sums, square = (np.zeros((6, 6)), np.zeros(6)), np.zeros(1)
    back = np.array([0.0, 0.0, -3.0])
    _accumulate(
        pairs, VIEW, np.eye(3), back, PIXEL, SOFT, pairs.inverse_depth.copy(), *sums, square
    )
    assert np.isinf(square[0])
    assert not sums[0].any()


def test_a_road_is_looked_up_where_its_plane_says(rng):
    """On a ramp neither bilinear interpolation nor slopes err."""
    R, t = camera_motion(CAMERA, np.array([4.5, 0.02, 0.03]))
    way = np.linalg.norm(t)
    rays, at = GroundTracker(CAMERA)._rays[::10], rng.uniform(0, 255, 1000)
    v, u = np.mgrid[:360, :640]
    ramp = (5 * u + 3 * v).astype(np.int16)
    images = ramp, np.full_like(ramp, 8 * 5), np.full_like(ramp, 8 * 3)
    axes = cv2.Rodrigues(rng.normal(0, 0.05, 3))[0][[1, 2, 0]]

    def looked_up(found):
        plane = axes.T @ (found[0] * np.append(1.0, found[1:]))
        seen = rays @ R.T + (rays @ plane)[:, None] * t / way
        x, y = (seen[:, :2] / seen[:, 2:] * VIEW[:2] + VIEW[2:]).T
        inside = (x > 1) & (y > 1) & (x < 638) & (y < 358)
        return np.where(inside, map_coordinates(ramp, [y, x], np.float64, order=1), np.nan)

    found = np.array([way / 1.5, 0.01, -0.02])
    light, J = np.empty(len(rays)), np.empty((len(rays), 5))
    by = np.stack([axes.T @ np.append(1, found[1:]), found[0] * axes[1], found[0] * axes[2]])
    n = _warp(rays, at, VIEW, R, t / way, found[0], by, images, light, J)
    expected = looked_up(found)
    inside = np.isfinite(expected)
    assert 10 < n == inside.sum() < len(rays)
    assert_allclose(light[:n], expected[inside], atol=1e-9)
    assert_allclose(J[:n, 3], -at[: len(rays)][inside])
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        change = (looked_up(found + step) - looked_up(found - step)) / 2e-6
        assert_allclose(J[:n, k], change[inside], rtol=1e-5, atol=1e-3)


def test_work_ahead_is_done_once_and_in_order_and_fails_where_it_is_asked_for():
    begun = []

    def work(number):
        begun.append(number)
        if number == 3:
            raise ValueError("3")
        return number**2

    ahead = Prefetcher(work, 6, 4)
    done = []
    for number in range(6):
        try:
            done.append(ahead(number))
        except ValueError as error:
            done.append(str(error))
        assert len(begun) <= min(number + 5, 6)
    assert done == [0, 1, 4, "3", 16, 25]
    assert begun == list(range(6))
