"""A run that is interrupted anywhere goes on to the same bits."""

import dataclasses

import numpy as np
import pytest

from saccade import slam
from saccade.slam import Checkpoint, EkfConfig, Recorder
from support.circular_log import simulate
from support.interrupted_run import interrupt_at


def _same(one, two):
    for a, b in (
        (one.trajectory.pose, two.trajectory.pose),
        (one.trajectory.covariance, two.trajectory.covariance),
        (one.map.xy, two.map.xy),
        (one.map.covariance, two.map.covariance),
        (one.map.id, two.map.id),
        (one.association, two.association),
        (one.innovation, two.innovation),
        (one.innovation_covariance, two.innovation_covariance),
        (one.consistency.nis, two.consistency.nis),
    ):
        assert a.tobytes() == b.tobytes()


@pytest.mark.parametrize(
    ("kind", "association", "pose"),
    [("standard", "known", 7), ("invariant", "nearest", 90), ("invariant", "known", 1)],
)
def test_resumed_run_is_the_uninterrupted_one(rng, tmp_path, kind, association, pose):
    log, _, _ = simulate(rng, steps=100)
    config = EkfConfig(filter=kind, association=association)
    films = [Recorder(frames=20), Recorder(frames=20), Recorder(frames=20)]
    whole = slam.run(log, config, recorder=films[0])
    checkpoint = Checkpoint(tmp_path / "run.npz", every=None)
    with pytest.raises(KeyboardInterrupt):
        slam.run(log, config, interrupt_at(pose), recorder=films[1], checkpoint=checkpoint)
    again = Checkpoint(tmp_path / "run.npz", every=None)
    resumed = slam.run(log, config, recorder=films[2], checkpoint=again)
    assert again.resumed == checkpoint.step >= pose
    _same(whole, resumed)
    assert len(films[0].snapshots) == len(films[2].snapshots) == 17
    for one, two in zip(films[0].snapshots, films[2].snapshots, strict=True):
        for field in dataclasses.fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))


def test_another_run_does_not_go_on_from_it(rng, tmp_path, caplog):
    log, _, _ = simulate(rng, steps=30)
    path = tmp_path / "run.npz"
    with pytest.raises(KeyboardInterrupt):
        slam.run(log, EkfConfig(), interrupt_at(20), checkpoint=Checkpoint(path, None))
    moved = dataclasses.replace(log, observation=log.observation + 1e-9)
    written = path.read_bytes()
    for other, config in (
        (moved, EkfConfig()),
        (log, EkfConfig(filter="standard")),
    ):
        path.write_bytes(written)
        caplog.clear()
        _same(slam.run(other, config, checkpoint=Checkpoint(path)), slam.run(other, config))
        assert "of another log, other settings or another version; beginning anew" in caplog.text


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:-1000]])
def test_a_broken_checkpoint_is_said_and_left(rng, tmp_path, caplog, damage):
    log, _, _ = simulate(rng, steps=30)
    path = tmp_path / "run.npz"
    with pytest.raises(KeyboardInterrupt):
        slam.run(log, EkfConfig(), interrupt_at(20), checkpoint=Checkpoint(path, None))
    path.write_bytes(damage(path.read_bytes()))
    _same(slam.run(log, checkpoint=Checkpoint(path)), slam.run(log))
    assert "no checkpoint, or a broken one; beginning anew" in caplog.text
