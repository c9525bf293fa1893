"""Runs in submaps against runs on the whole map."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade import slam
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam import EkfConfig, EkfSlam, submap_choice
from support.logs import with_observations

WORLD = WorldConfig(
    course_length=70.0,
    steps=300,
    landmarks=70,
    landmark_spread=6.0,
    range_percent=1.0,
    bearing_sigma_deg=1.0,
)
"""More than one lap, so that a loop is closed."""


def _close(one, two, tolerance=1e-6):
    np.testing.assert_array_equal(one.association, two.association)
    assert one.removed == two.removed
    for a, b in (
        (one.trajectory.pose, two.trajectory.pose),
        (one.trajectory.covariance, two.trajectory.covariance),
        (one.map.xy, two.map.xy),
        (one.map.covariance, two.map.covariance),
        (one.innovation, two.innovation),
        (one.innovation_covariance, two.innovation_covariance),
        (one.consistency.nis, two.consistency.nis),
    ):
        np.testing.assert_allclose(a, b, atol=tolerance, rtol=1e-6)


@pytest.fixture
def entries(monkeypatch):
    """The sizes of the submaps that were entered, and of their maps."""
    sizes, enter = [], EkfSlam.enter

    def counted(ekf, inside):
        sizes.append((len(inside), len(ekf)))
        return enter(ekf, inside)

    monkeypatch.setattr(EkfSlam, "enter", counted)
    return sizes


@settings(max_examples=4, deadline=None)
@given(
    st.sampled_from(["invariant", "standard"]),
    st.sampled_from(["known", "mutual", "nearest"]),
    st.sampled_from([(0.0, 0.0, 0.0), (0.05, 0.02, 0.02)]),
    st.sampled_from([180.0, 360.0]),
    st.integers(0, 1000),
)
def test_estimates_are_those_of_the_whole_map(kind, association, bias, view, seed):
    small = {"course_length": 50.0, "steps": 220, "landmarks": 50}
    world = dataclasses.replace(WORLD, field_of_view_deg=view, **small)
    log = dataclasses.replace(simulate_world(world, seed), odometry_bias=bias)
    config = EkfConfig(
        errors=kind, association=association, confirm_after=2, submaps="never", smooth=False
    )
    whole = slam.run(log, config)
    _close(slam.run(log, dataclasses.replace(config, submaps="always")), whole)
    assert len(whole.map) > 20


def test_landmarks_are_culled_alike(entries):
    log = simulate_world(dataclasses.replace(WORLD, steps=350, step_length=0.1), 2)
    names, first = np.unique(log.landmark, return_index=True)
    since = log.observation_pose - log.observation_pose[first][np.searchsorted(names, log.landmark)]
    gone = (log.landmark % 3 == 0) & (since > 3)  # they went away
    log = with_observations(log, ~gone)
    config = EkfConfig(
        association="mutual",
        confirm_after=1,
        culling_ratio=0.9,
        submaps="never",
        smooth=False,
    )
    whole = slam.run(log, config)
    _close(slam.run(log, dataclasses.replace(config, submaps="always")), whole)
    assert whole.removed > 1
    used = whole.association >= 0  # what was removed leaves the numbers of the others right
    counts = np.zeros((len(whole.map), 70))
    np.add.at(counts, (whole.association[used], log.landmark[used]), 1)
    assert counts.max(1).sum() > 0.95 * used.sum()
    assert any(inside < 0.7 * mapped for inside, mapped in entries)


def test_a_large_map_chooses_by_itself(monkeypatch, entries):
    log = simulate_world(WORLD, 1)
    whole = slam.run(log, EkfConfig(submaps="never", smooth=False))
    assert not entries
    monkeypatch.setattr(submap_choice, "LARGE_MAP", 30)
    monkeypatch.setattr(submap_choice, "MAX_FRACTION", 0.5)
    _close(slam.run(log, EkfConfig(smooth=False)), whole)
    assert min(mapped for _, mapped in entries) >= 30
    assert all(inside <= mapped / 2 for inside, mapped in entries)


@pytest.mark.filterwarnings("error")
def test_the_first_scan_may_have_as_many_landmarks_as_a_large_map(rng):
    live = slam.Slam()
    z = np.column_stack([*rng.uniform([[1], [-3]], [[100], [3]], (2, submap_choice.LARGE_MAP))])
    live.step(0.0, z=z, R=np.diag([1e-4, 1e-6]), labels=np.arange(len(z)))
    assert len(live.filter) == submap_choice.LARGE_MAP


def test_rows_are_those_of_ids_in_the_order_of_the_state(rng):
    """Against NumPy's search of sorted arrays; landmark 4 was removed, and 9 is added next."""
    ekf = slam.EkfSlam(np.zeros(3), np.eye(3) * 1e-4)
    for _ in range(9):
        ekf.augment(rng.uniform([2, -1], [9, 1]), np.eye(2) * 1e-2)
    ekf.remove(np.array([4]))
    kept = np.delete(np.arange(9), 4)
    asked = np.array([-2, -1, 0, 3, 5, 8, 9, 11])
    expected = [-2, -1, *np.searchsorted(kept, [0, 3, 5, 8]), 8, 10]
    np.testing.assert_array_equal(ekf.rows(asked), expected)
    ekf.enter(np.array([1, 4, 6]))  # rows of landmarks 1, 5 and 7
    np.testing.assert_array_equal(
        ekf.rows(np.array([-1, 0, 1, 5, 6, 7, 8, 9])), [-1, -1, 0, 1, -1, 2, -1, 3]
    )
