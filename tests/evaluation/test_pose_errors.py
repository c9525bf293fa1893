"""Absolute and relative errors of poses in space, against evo's."""

import json
from dataclasses import replace

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
@pytest.mark.parametrize("alignment", ["aligned", "unaligned", "scaled"])
def test_absolute_errors_are_those_of_evo(files, alignment, relation):
    reference, estimate = sync.associate_trajectories(_evo(files[1]), _evo(files[0]))
    if alignment in ("aligned", "scaled"):
        estimate.align(reference, correct_scale=alignment == "scaled")
    expected = _statistics(metrics.APE(RELATIONS[relation]), (reference, estimate))
    config = PoseErrorConfig(scale=alignment == "scaled")
    scores = score_poses(*map(read_poses, files), config)
    found = getattr(scores, "aligned" if alignment == "scaled" else alignment)
    np.testing.assert_allclose(
        statistics(getattr(found, relation)), expected, rtol=1e-7, atol=1e-12
    )
    assert len(found.translation) == reference.num_poses == N * 2 // 3


@pytest.mark.parametrize("relation", RELATIONS)
def test_relative_errors_are_those_of_evo(files, relation):
    pair = sync.associate_trajectories(_evo(files[1]), _evo(files[0]))
    expected = _statistics(metrics.RPE(RELATIONS[relation], 1, Unit.frames), pair)
    found = score_poses(*map(read_poses, files)).relative
    np.testing.assert_allclose(statistics(getattr(found, relation)), expected, rtol=1e-6, atol=1e-6)


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
    scores = score_poses(replace(path, position=path.position[:, ::-1]), path)
    assert scores.aligned.translation.max() < 1e-9
    assert np.isnan(scores.aligned.rotation).all()
    assert scores.unaligned.rotation.max() < 1e-9


def test_what_cannot_be_compared_is_refused(rng):
    truth = _random_walk(rng)
    later = replace(truth, time=truth.time + 1e4)
    with pytest.raises(LogError, match=r"at least 2 poses within 0\.01 s of a true pose, found 0"):
        score_poses(later, truth)
    with pytest.raises(ConfigError):
        PoseErrorConfig(max_difference=-1)


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
    _write(tmp_path / "few.tum", replace(truth, time=late))
    code, out, message = run("evaluate", "trajectory", "few.tum", "--truth", "truth.tum")
    assert code == 0
    assert f"poses (of {N})" in out
    assert f"few.tum: warning: truth for only 2 of {N} poses" in message
