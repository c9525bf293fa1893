"""Absolute and relative errors of poses in space, against evo's."""

import json

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.core.units import Unit
from evo.tools import file_interface
from scipy.spatial.transform import Rotation

from saccade.datasets.drives.sidecar_files import read_tum_poses as read_poses
from saccade.errors import ConfigError, LogError
from saccade.evaluation.trajectory import (
    PoseErrorConfig,
    Poses,
    associate,
    pairs,
    score_poses,
    statistics,
)

N = 300


def _random_walk(rng, n=N, start=100.0, spread=0.02):
    turn = Rotation.from_rotvec(np.cumsum(rng.normal(size=(n, 3)) * 0.05, 0))
    time = start + 0.1 * np.arange(n) + rng.uniform(-spread, spread, n)
    return Poses(time, turn.as_matrix(), np.cumsum(rng.normal(size=(n, 3)), 0))


def _noisy(rng, poses, scale=1.0):
    """The poses with noise, in another frame and of another scale."""
    frame = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    turn = Rotation.from_rotvec(rng.normal(size=(len(poses.time), 3)) * 0.02).as_matrix()
    position = poses.position + rng.normal(size=poses.position.shape) * 0.2
    return Poses(
        poses.time + rng.uniform(-0.004, 0.004, len(poses.time)),
        frame @ poses.rotation @ turn,
        scale * position @ frame.T + rng.normal(size=3),
    )


def _write(path, poses, keep=slice(None)):
    quaternion = Rotation.from_matrix(poses.rotation).as_quat()
    table = np.column_stack([poses.time, poses.position, quaternion])[keep]
    np.savetxt(path, table, fmt="%.12f")
    return path


def _evo(path):
    return file_interface.read_tum_trajectory_file(str(path))


def _statistics(metric, pair):
    metric.process_data(pair)
    found = metric.get_all_statistics()
    return [found[name] for name in ("rmse", "mean", "median", "std", "min", "max")]


@pytest.fixture
def files(rng, tmp_path):
    """The truth, and an estimate of two poses in three of it."""
    truth = _random_walk(rng)
    estimate = _noisy(rng, truth)
    keep = np.arange(N) % 3 > 0
    return _write(tmp_path / "estimate.tum", estimate, keep), _write(tmp_path / "truth.tum", truth)


RELATIONS = {
    "translation": metrics.PoseRelation.translation_part,
    "rotation": metrics.PoseRelation.rotation_angle_deg,
}


@pytest.mark.parametrize("relation", RELATIONS)
@pytest.mark.parametrize("alignment", ["aligned", "first_aligned", "unaligned", "scaled"])
def test_absolute_errors_are_those_of_evo(files, alignment, relation):
    reference, estimate = sync.associate_trajectories(_evo(files[1]), _evo(files[0]))
    if alignment in ("aligned", "scaled"):
        estimate.align(reference, correct_scale=alignment == "scaled")
    if alignment == "first_aligned":
        estimate.align_origin(reference)
    expected = _statistics(metrics.APE(RELATIONS[relation]), (reference, estimate))
    config = PoseErrorConfig(scale=alignment == "scaled")
    scores = score_poses(*map(read_poses, files), config)
    found = getattr(scores, "aligned" if alignment == "scaled" else alignment)
    np.testing.assert_allclose(
        statistics(getattr(found, relation)), expected, rtol=1e-7, atol=1e-12
    )
    assert len(found.translation) == reference.num_poses == N * 2 // 3


@pytest.mark.parametrize("relation", RELATIONS)
@pytest.mark.parametrize("all_pairs", [False, True])
@pytest.mark.parametrize(("delta", "unit"), [(1, "frames"), (7, "frames"), (9.0, "meters")])
def test_relative_errors_are_those_of_evo(files, delta, unit, all_pairs, relation):
    reference, estimate = sync.associate_trajectories(_evo(files[1]), _evo(files[0]))
    metric = metrics.RPE(RELATIONS[relation], delta, Unit[unit], all_pairs=all_pairs)
    expected = _statistics(metric, (reference, estimate))
    config = PoseErrorConfig(delta=delta, unit=unit, all_pairs=all_pairs)
    found = score_poses(*map(read_poses, files), config)
    np.testing.assert_array_equal(found.second, metric.delta_ids)
    np.testing.assert_allclose(
        statistics(getattr(found.relative, relation)), expected, rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("finer", [0, 1])
def test_the_finer_trajectory_can_be_interpolated_as_by_evo(files, tmp_path, finer, rng):
    coarse = _write(tmp_path / "coarse.tum", read_poses(files[1 - finer]), slice(2, -2, 5))
    pair = (files[0], coarse) if finer == 0 else (coarse, files[1])
    method = sync.SyncMethod.interpolation
    reference, estimate = sync.associate_trajectories(
        _evo(pair[1]), _evo(pair[0]), max_diff=0.1, sync_method=method
    )
    config = PoseErrorConfig(max_difference=0.1, interpolate=True)
    mine, true = associate(*map(read_poses, pair), config)
    for found, expected in ((mine, estimate), (true, reference)):
        np.testing.assert_allclose(found.time, expected.timestamps, atol=1e-9)
        np.testing.assert_allclose(found.position, expected.positions_xyz, atol=1e-8)
        matrices = np.array(expected.poses_se3)[:, :3, :3]
        np.testing.assert_allclose(found.rotation, matrices, atol=1e-8)


def test_pairs_by_time_are_as_far_apart_as_asked_for(rng):
    poses = _random_walk(rng)
    for all_pairs, tolerance in ((True, 0.2), (False, 0.14)):
        config = PoseErrorConfig(delta=2.0, unit="seconds", all_pairs=all_pairs)
        first, second = pairs(poses, config)
        apart = poses.time[second] - poses.time[first]
        assert np.abs(apart - 2.0).max() <= tolerance
        assert len(first) == (pytest.approx(N - 20, abs=2) if all_pairs else len(first))
    np.testing.assert_array_equal(first[1:], second[:-1])


def test_segments_have_the_error_of_their_drift():
    """2 % too long, and half a degree to the left every hundred metres."""
    s = np.arange(0, 1000.0, 1.0)
    level = np.tile(np.eye(3), (len(s), 1, 1))
    truth = Poses(s, level, np.column_stack([s, 0 * s, 0 * s]))
    long = score_poses(Poses(s, level, 1.02 * truth.position), truth).segments
    assert len(long.translation) == sum(
        (1000 - length + 9) // 10 for length in range(100, 900, 100)
    )
    np.testing.assert_allclose(long.translation, 2.0, rtol=0.02)
    np.testing.assert_allclose(long.rotation, 0.0, atol=1e-9)
    turned = Rotation.from_rotvec(np.outer(np.deg2rad(s * 0.5 / 100), (0, 0, 1))).as_matrix()
    drifted = score_poses(Poses(s, turned, truth.position), truth).segments
    np.testing.assert_allclose(drifted.rotation, 0.5, rtol=0.02)


def test_on_a_line_the_rotation_of_the_alignment_is_not_scored():
    s = np.arange(30.0)
    level = np.tile(np.eye(3), (30, 1, 1))
    path = Poses(s, level, np.column_stack([s, 0 * s, 0 * s]))
    scores = score_poses(path._replace(position=path.position[:, ::-1]), path)
    assert scores.aligned.translation.max() < 1e-9
    assert np.isnan(scores.aligned.rotation).all()
    assert scores.unaligned.rotation.max() < 1e-9


def test_what_cannot_be_compared_is_refused(rng):
    truth = _random_walk(rng)
    later = truth._replace(time=truth.time + 1e4)
    with pytest.raises(LogError, match=r"at least 2 poses within 0\.01 s of a true one, found 0"):
        score_poses(later, truth)
    with pytest.raises(LogError, match="poses 400 frames apart, found none among 300"):
        score_poses(truth, truth, PoseErrorConfig(delta=400))
    for settings in ({"delta": 0.5}, {"delta": 0}, {"unit": "miles"}, {"max_difference": -1}):
        with pytest.raises(ConfigError):
            PoseErrorConfig(**settings)


def test_the_command_prints_them(files, tmp_path, run):
    other = _write(tmp_path / "other.tum", read_poses(files[1]), slice(20, None))
    words = ["evaluate", "trajectory", "estimate.tum", other.name, "--truth", "truth.tum"]
    code, out, _ = run(*words, "--json")
    assert code == 0
    found = json.loads(out)["estimates"]
    expected = statistics(score_poses(*map(read_poses, files)).aligned.translation)
    assert found["estimate.tum"]["ate_aligned_m"] == pytest.approx(expected._asdict())
    assert found["other.tum"]["ate_unaligned_m"]["max"] == 0
    truth = read_poses(files[1])
    late = truth.time + 0.05
    late[[10, 40]] -= 0.05
    _write(tmp_path / "few.tum", truth._replace(time=late))
    code, out, message = run("evaluate", "trajectory", "few.tum", "--truth", "truth.tum")
    assert code == 0
    assert f"poses (of {N})" in out
    assert f"few.tum: warning: truth for only 2 of {N} poses" in message
