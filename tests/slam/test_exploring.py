"""Many poses at once in compiled code, against one after the other."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from saccade import slam
from saccade.slam import EkfConfig, NearestNeighbor, observe
from saccade.slam.map_management._kernels import ConfirmationPolicy, confirm
from saccade.slam.map_management.candidates import Candidates
from support.circular_log import simulate
from support.oracles_slam import ListedCandidates


class OneByOne(NearestNeighbor):
    """The same rule, but not the one of which there is a kernel."""


def _cluttered(rng, steps=250):
    """A log without names, trees that are there for a while only, and what is no tree."""
    log, truth, _ = simulate(rng, steps=steps)
    passing, first = rng.uniform(-9, 9, (60, 2)), 3 * np.arange(60)
    rows = [np.column_stack([log.observation_pose, log.observation])]
    for step, pose in enumerate(truth):
        there = passing[(first <= step) & (step < first + 12)]
        z, _ = observe(pose, there)
        false = np.column_stack([rng.uniform(1, 8, 2), rng.uniform(-3, 3, 2)])
        z = np.concatenate([z[z[:, 0] < 8.0], false])
        rows.append(np.column_stack([np.full(len(z), step), z]))
    seen = np.concatenate(rows)
    seen = seen[np.argsort(seen[:, 0], kind="stable")]
    return dataclasses.replace(
        log,
        observation_pose=seen[:, 0].astype(np.int64),
        observation=seen[:, 1:],
        observation_covariance=np.tile(log.observation_covariance[0], (len(seen), 1, 1)),
        landmark=np.full(len(seen), -1),
    )


@pytest.mark.parametrize("kind", ["invariant", "standard", "first-estimates"])
@pytest.mark.parametrize(("rule", "biased"), [("mutual", True), ("nearest", False)])
def test_many_poses_at_once_are_the_same_as_one_by_one(rng, kind, rule, biased):
    log = _cluttered(rng)
    if biased:
        log = dataclasses.replace(log, odometry_bias=(0.05, 0.02, 0.02))
    config = EkfConfig(
        filter=kind,
        association=rule,
        candidate_timeout=4.0,
        confirm_after=3,
        culling_ratio=0.9,
        min_observations=1,
    )
    many = slam.run(log, config)
    one = slam.run(log, config, associate=OneByOne(mutual=rule == "mutual"))
    np.testing.assert_array_equal(many.association, one.association)
    np.testing.assert_allclose(many.trajectory.pose, one.trajectory.pose, atol=1e-9)
    np.testing.assert_allclose(many.trajectory.covariance, one.trajectory.covariance, atol=1e-9)
    np.testing.assert_allclose(many.map.xy, one.map.xy, atol=1e-9)
    np.testing.assert_allclose(many.map.covariance, one.map.covariance, atol=1e-9)
    np.testing.assert_allclose(many.consistency.nis, one.consistency.nis, rtol=1e-6)
    np.testing.assert_allclose(many.innovation_covariance, one.innovation_covariance, atol=1e-9)
    assert many.removed == one.removed > 2  # so that all of it has been tried
    assert len(many.map) >= 15


@given(st.integers(0, 10**6))
def test_candidates_are_those_of_a_list(seed):
    rng = np.random.default_rng(seed)
    policy = ConfirmationPolicy(confirm_after=3, timeout=2.0, gate=9.2)
    candidates, listed = Candidates(3, 2.0), ListedCandidates(*policy)
    candidates.reserve(200)
    kept = candidates.buffer
    for time in np.cumsum(rng.uniform(0, 1.5, 12)):
        xy = rng.integers(0, 4, (rng.integers(0, 6), 2)) + 0.1 * rng.normal(size=(1, 2))
        root = 0.3 * rng.normal(size=(len(xy), 2, 2))
        covariance = root @ root.transpose(0, 2, 1) * rng.integers(0, 2, (len(xy), 1, 1))
        confirmed = np.empty(len(xy), np.bool_)
        confirm(kept, policy, xy, covariance, float(time), confirmed)
        assert confirmed.tolist() == listed.confirm(xy, covariance, time)
    np.testing.assert_array_equal(
        kept.xy[: kept.length[0]], np.reshape([c[0] for c in listed.waiting], (-1, 2))
    )
