"""Candidates become landmarks or are dropped; landmarks that are missed are culled."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade import datasets, slam
from saccade.slam import EkfConfig, observe
from saccade.slam.association.outcomes import DROPPED
from saccade.slam.landmarks import CullingPolicy, LandmarkTable
from saccade.viewing.snapshots import SnapshotRecorder
from support.circular_log import simulate
from support.logs import between, with_observations, without_names
from support.oracles_slam import ListedLandmarks

U, R = np.diag([0.02, 0.01]) ** 2, np.diag([0.1, 0.02]) ** 2
STILL = np.array([0.0, 0.0])
SINGLE = EkfConfig(max_hypotheses=1)


def _scan(live, xy, time=0.0):
    """Let a robot at the origin observe points (k, 2) exactly."""
    z = observe(np.zeros(3), np.asarray(xy, np.float64).reshape(-1, 2))[0]
    return live.step(time, STILL, U * 1e-6, z, np.tile(R, (len(z), 1, 1)))


def test_a_candidate_becomes_a_landmark_at_its_third_observation():
    live = slam.Slam(EkfConfig(confirm_after=3))
    for confirmed in ([False], [False, False], [True, False]):
        xy = [[4.0, 1.0], [-2.0, 3.0]][: len(confirmed)]
        assert _scan(live, xy).association.tolist() == list(range(len(confirmed)))
        assert live.landmarks.in_map.tolist() == confirmed


def test_a_candidate_that_is_not_observed_again_is_dropped():
    live = slam.Slam(EkfConfig(confirm_after=2, candidate_scans=5, culling_ratio=None))
    _scan(live, [[4.0, 1.0], [-2.0, 3.0]])
    removed = [_scan(live, [[4.0, 1.0]]).culled.tolist() for _ in range(31)]
    assert removed == [[]] * 14 + [[1]] + [[]] * 16  # in the 16th scan, as in every 16th
    assert live.landmarks.forgotten == 1
    assert live.landmarks.culled == 0


def test_a_landmark_that_is_no_longer_there_is_culled_and_one_out_of_view_is_not():
    """The robot turns: what lies behind it cannot be seen, and the filter learns that."""
    live, taken = slam.Slam(EkfConfig()), 60
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    world = 5 * np.stack([np.cos(angle), np.sin(angle)], 1)
    pose = np.zeros(3)
    for step in range(240):
        pose[2] = slam.wrap(pose[2] + 0.2)
        z, _ = observe(pose, world)
        seen = np.abs(z[:, 1]) < 1.0
        seen[3] &= step < taken
        noise = np.tile(R, (seen.sum(), 1, 1))
        live.step(float(step), np.array([0.0, 0.2]), U * 1e-4, z[seen], noise)
        if step == taken:
            assert len(live.map) == 16
    assert len(live.map) == len(live.landmarks) == 15
    assert live.map.id.tolist() == [i for i in range(16) if i in live.map.id]
    np.testing.assert_allclose(
        np.sort(np.hypot(*(live.map.xy[:, None] - world).transpose(2, 0, 1)).argmin(1)),
        np.delete(np.arange(16), 3),
    )


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_counts_are_those_of_a_list(seed):
    rng = np.random.default_rng(seed)
    policy = CullingPolicy(True, int(rng.integers(1, 4)), 5, 0.6, 0.5, interval=2)
    table, listed, next_id = LandmarkTable(policy), ListedLandmarks(policy), 0
    table.max_range, table.has_unlabeled = 5.0, True
    for scan in range(1, 81):
        ids = table.counts.id
        mapped = len(ids)
        predicted = np.stack([rng.uniform(4, 5, mapped), rng.uniform(-3.1, -2.9, mapped)], 1)
        found = [i if rng.random() < (0.1, 0.9)[i % 2] else DROPPED for i in range(mapped)]
        matches = [int(ids[i]) if i >= 0 else i for i in found]
        added = int(rng.integers(0, 3)) if mapped < 8 else 0
        candidates = int(rng.integers(0, added + 1))
        new = np.arange(next_id, next_id + added)
        table.add(new[:candidates], confirmed=True)
        table.add(new[candidates:], confirmed=False)
        next_id += added
        visible = (ids, predicted) if scan % policy.interval == 0 else None
        removed = table.count(np.array([*matches, *new], np.int64), visible)
        rows = np.flatnonzero(np.isin(table.counts.id, removed)).tolist()
        found += range(mapped, mapped + added)
        assert rows == listed.update(predicted, mapped + candidates, found)
        table.remove(removed)
        assert table.counts.confirmed.tolist() == [m["confirmed"] for m in listed.landmarks]
    assert table.culled + table.forgotten > 0


def test_early_observations_of_a_candidate_are_not_lost(rng):
    """When it is confirmed has no influence on the estimate: it is in the filter from the first."""
    log = without_names(simulate(rng, steps=150)[0])
    runs = [slam.run(log, replace(SINGLE, confirm_after=times)) for times in (1, 4)]
    one, four = (run.filtered for run in runs)
    assert one.pose.tobytes() == four.pose.tobytes()
    assert one.covariance.tobytes() == four.covariance.tobytes()
    assert len(runs[1].map) >= 15
    assert (runs[1].association >= 0).mean() > 0.95


def test_the_unit_of_the_clock_does_not_matter(rng):
    log = without_names(simulate(rng, steps=120)[0])
    result = slam.run(log)
    assert len(result.map) >= 15
    for unit in (1e-9, 1000.0):
        scaled = slam.run(replace(log, time=log.time * unit))
        assert result.trajectory.pose.tobytes() == scaled.trajectory.pose.tobytes()
        assert len(result.map) == len(scaled.map)


@pytest.mark.parametrize(
    ("config", "cause"),
    [
        (EkfConfig(), ""),
        (EkfConfig(confirm_after=1000), "no candidate was observed 1000 times with at most 20"),
        (replace(SINGLE, sensor_noise_scale=20.0), "each may be of several landmarks"),
    ],
)
def test_nothing_mapped_and_little_used_are_warnings_with_their_cause(rng, config, cause):
    log = without_names(simulate(rng, steps=150)[0])
    warning = slam.run(log, replace(config, smooth=False)).warning
    assert cause in warning
    assert (cause == "") == (warning == "")


def test_no_observations_and_only_culled_landmarks_are_warnings(rng):
    log = simulate(rng)[0]
    blind = with_observations(log, np.array([], np.int64))
    assert "there are no observations" in slam.run(blind).warning
    table = LandmarkTable(CullingPolicy(True, 3, 5, 0.4))
    table.culled = 7
    assert "all of 7 landmarks were culled" in table.warning(np.full(9, -1))
    assert table.warning(np.array([-1, 0])) == ""


def test_snapshots_show_landmarks_without_candidates(rng):
    recorder = SnapshotRecorder(frames=1000)
    result = slam.run(
        without_names(simulate(rng, steps=100)[0]), EkfConfig(smooth=False), recorder=recorder
    )
    assert len(recorder.snapshots[0].landmarks) == 0
    assert len(recorder.snapshots[5].observed) > 0
    np.testing.assert_array_equal(recorder.snapshots[-1].landmarks, result.map.xy)
    for snapshot in recorder.snapshots:
        assert len(snapshot.ids) == len(snapshot.landmarks) == len(snapshot.landmark_covariance)
        assert (snapshot.observed < len(snapshot.landmarks)).all()


def _check_cuts(log, config, cuts, rng):
    """That what is estimated up to a pose has the same bits without the rest of the log."""
    whole = slam.run(log, config)
    for poses in rng.integers(2, len(log.time), cuts):
        cut = between(log, 0, int(poses) - 1)
        part, k = slam.run(cut, config), len(cut.observation)
        for name in ("pose", "covariance"):
            before = getattr(whole.filtered, name)[:poses]
            assert getattr(part.filtered, name).tobytes() == before.tobytes()
        for name in ("innovation", "innovation_covariance"):
            assert getattr(part, name).tobytes() == getattr(whole, name)[:k].tobytes()
        assert part.consistency.nis.tobytes() == whole.consistency.nis[:k].tobytes()
        both = (part.association >= 0) & (whole.association[:k] >= 0)  # neither culled nor dropped
        pairs = np.stack([part.association[both], whole.association[:k][both]], 1)
        pairs = np.unique(pairs, axis=0)  # each landmark is still the same one
        assert len(pairs) == len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1]))
    return whole


@pytest.mark.nightly
def test_the_past_of_gtsams_victoria_park_does_not_depend_on_the_future(rng):
    log = datasets.load("auto", files("saccade") / "data" / "victoria_park.txt")
    _check_cuts(without_names(between(log, 0, 3500)), SINGLE, 1, rng)
