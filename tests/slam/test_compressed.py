"""A submap against the whole map, and scans against single observations."""

import copy

import numpy as np
import pytest

from saccade.errors import LogError
from saccade.slam import (
    EkfSlam,
    observe,
    turn_then_translate,
)

U, NOISE = np.diag([1e-4, 1e-5]), np.diag([0.01, 0.0004])
every = pytest.mark.parametrize("errors", ["standard", "invariant"])


def _avenue(rng, steps=240):
    """Controls (t, 2), and (step, z, name) of what is seen on a way through 90 landmarks."""
    world = rng.uniform([-5, -6], [45, 6], (90, 2))
    control = np.tile([0.25, 0.0], (steps, 1))
    control[steps // 2 : steps // 2 + 10, 1] = np.pi / 10  # and back again
    pose, seen = np.zeros(3), []
    for step, each in enumerate(control):
        pose = turn_then_translate(pose, each)[0]
        z = observe(pose, world)[0]
        near = rng.permutation(np.flatnonzero(z[:, 0] < 6))[:3].tolist()
        seen += [(step, z[name] + rng.normal(size=2) * [0.1, 0.02], name) for name in near]
    return control + rng.normal(size=control.shape) * np.sqrt(U.diagonal()), seen


@every
def test_a_submap_is_the_whole_filter(errors, rng):
    """Among changing landmarks, at random, of which some are never observed and some are new."""
    start = np.zeros(3), np.diag([0.01, 0.01, 0.001])
    whole, small = (EkfSlam(*start, errors=errors) for _ in range(2))
    world, pose = rng.uniform([-5, -6], [15, 6], (50, 2)), np.zeros(3)
    for ekf in (whole, small):
        for z in observe(np.zeros(3), world)[0]:
            ekf.augment(z, NOISE)
    for visit in range(4):
        inside = np.sort(rng.permutation(50)[:12])
        small.enter(inside)
        submap = small.submap
        for _ in range(25):
            u = np.array([0.25, 0.05])
            pose = turn_then_translate(pose, u)[0]
            u = u + rng.normal(size=2) * np.sqrt(U.diagonal())
            whole.predict(u, U)
            small.predict(u, U)
            for local in rng.integers(8, size=2).tolist():
                z = observe(pose, world[inside[local]])[0] + rng.normal(size=2) * [0.1, 0.02]
                one = whole.update(z, NOISE, inside[local])
                v, _, nis = small.update(z[None], NOISE[None], inside[[local]])
                np.testing.assert_allclose(v, one.value, atol=1e-9)
                assert nis == pytest.approx(one.nis, abs=1e-6)
        for bearing in range(6 if visit == 1 else 0):  # more than there was room for
            z = np.array([4.0, bearing])
            whole.augment(z, NOISE)
            small.augment(z, NOISE)
        np.testing.assert_allclose(small.pose, whole.pose, atol=1e-9)
        np.testing.assert_allclose(small.pose_covariance, whole.pose_covariance, atol=1e-9)
        for _ in range(2):  # read in the submap, then in the whole map
            np.testing.assert_allclose(small.landmarks, whole.landmarks, atol=1e-9)
            np.testing.assert_array_equal(small.ids, whole.ids)
            np.testing.assert_allclose(
                small.landmark_covariances, whole.landmark_covariances, atol=1e-9
            )
            np.testing.assert_allclose(small.covariance, whole.covariance, atol=1e-9)
            if small.submap is not None:
                assert small.submap is submap
                small.leave()
        np.testing.assert_allclose(small.state, whole.state, atol=1e-9)
    with pytest.raises(LogError, match="expected ids"):
        small.update(np.ones(2), NOISE, len(small) + 1)


def _numbered(seen):
    step, z, name = zip(*seen, strict=True)
    number = {}
    which = [number.setdefault(each, len(number)) for each in name]
    return np.array(step), np.array(z), np.array(which)


@every
def test_a_scan_is_its_observations(errors, rng):
    """Those of no landmark are left out."""
    control, seen = _avenue(rng)
    step, z, which = _numbered(seen)
    new = np.unique(which, return_index=True)[1]
    which[np.setdiff1d(np.arange(0, len(which), 7), new)] = -1
    one = EkfSlam(np.zeros(3), np.diag([0.01, 0.01, 0.001]), errors=errors)
    two = copy.deepcopy(one)
    for i, u in enumerate(control):
        rows = np.flatnonzero(step == i)
        one.predict(u, U)
        two.predict(u, U)
        went = one.update(z[rows], np.tile(NOISE, (len(rows), 1, 1)), which[rows])
        for n, k in enumerate(rows):
            if which[k] == len(two):
                two.augment(z[k], NOISE)
                assert np.isnan(went.nis[n])
            elif which[k] >= 0:
                found = two.update(z[k], NOISE, int(which[k]))
                np.testing.assert_allclose(went.value[n], found.value[0], atol=1e-9)
                np.testing.assert_allclose(went.covariance[n], found.covariance[0])
                assert went.nis[n] == pytest.approx(found.nis[0], abs=1e-9)
            else:
                assert np.isnan(went.nis[n])
        np.testing.assert_allclose(one.pose, two.pose, atol=1e-9)
        np.testing.assert_allclose(one.pose_covariance, two.pose_covariance, atol=1e-9)
    assert len(one) > 20
    np.testing.assert_allclose(one.covariance, two.covariance, atol=1e-9)
