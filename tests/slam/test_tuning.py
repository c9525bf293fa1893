"""Noise that is found from innovations, where it is known what it is."""

import dataclasses

import numpy as np
import pytest

from saccade import slam
from saccade.errors import LogError
from saccade.evaluation.trajectory import position_rmse
from saccade.slam.tuning import tune
from saccade.types import Trajectory
from support.circular_log import simulate


@pytest.mark.parametrize(("motion", "sensor"), [(0.5, 2.0), (2.0, 0.5), (1.0, 1.0)])
def test_deviations_that_are_wrong_by_a_factor_are_found(rng, motion, sensor):
    log, _, _ = simulate(rng)
    said = dataclasses.replace(
        log,
        control_covariance=log.control_covariance / motion**2,
        observation_covariance=log.observation_covariance / sensor**2,
    )
    found = tune(said, slam.EkfConfig())
    assert found.config.motion_noise_scale == pytest.approx(motion, rel=0.3)
    assert found.config.sensor_noise_scale == pytest.approx(sensor, rel=0.1)
    assert found.after <= found.before
    assert 1.8 < slam.run(said, found.config).consistency.mean < 2.2
    assert f"{found.config.sensor_noise_scale:.2f}" in found.words


def test_wrong_observations_do_not_decide(rng):
    log, _, _ = simulate(rng)
    wrong = rng.random(len(log.observation)) < 0.02
    z = log.observation + wrong[:, None] * rng.choice([-2.0, 2.0], (len(wrong), 2))
    found = tune(dataclasses.replace(log, observation=z), slam.EkfConfig()).config
    assert 0.9 < found.sensor_noise_scale < 1.3


@pytest.mark.parametrize(("memory", "confirmed"), [(0.95, False), (0.0, True)])
def test_scales_are_kept_where_errors_are_not_white_noise(rng, memory, confirmed):
    """Errors that stay for a while are as large as declared, and seem small from scan to scan."""
    log, _, _ = simulate(rng, noise=0.0)
    error = np.zeros((len(log.time), log.landmark.max() + 1, 2))
    error[0] = rng.normal(size=error[0].shape)
    for step in range(1, len(error)):
        fresh = rng.normal(size=error[0].shape)
        error[step] = memory * error[step - 1] + np.sqrt(1 - memory**2) * fresh
    size = 1.0 if memory else 0.5
    deviation = size * np.sqrt(log.observation_covariance[0].diagonal())
    wheel = np.sqrt(log.control_covariance[0].diagonal())
    wrong = dataclasses.replace(
        log,
        observation=log.observation + error[log.observation_pose, log.landmark] * deviation,
        control=log.control + rng.normal(size=log.control.shape) * wheel,
    )
    config = slam.EkfConfig()
    found = tune(wrong, config)
    assert found.estimated[1] < 0.9
    assert (found.config != config) == confirmed == (not found.objection)
    expected = "the second half confirms it" if confirmed else "the noise scales stay as they were"
    assert expected in found.words


def test_gates_of_a_noise_declared_far_too_small_are_opened(rng):
    log, truth, _ = simulate(rng)
    said = dataclasses.replace(
        log,
        control_covariance=log.control_covariance / 25,
        observation_covariance=log.observation_covariance / 25,
        landmark=np.full_like(log.landmark, -1),
        truth=Trajectory(log.time, truth),
    )
    found = tune(said, slam.EkfConfig())
    assert not found.objection
    assert found.config.sensor_noise_scale == pytest.approx(5.0, rel=0.15)
    before, after = (slam.run(said, each).trajectory for each in (slam.EkfConfig(), found.config))
    assert position_rmse(after, said.truth) < 0.5 * position_rmse(before, said.truth)


def test_a_log_that_says_nothing_about_noise_is_refused(rng):
    log, _, _ = simulate(rng, steps=20)
    few = {
        name: getattr(log, name)[:5]
        for name in ("observation_pose", "observation", "observation_covariance", "landmark")
    }
    with pytest.raises(LogError, match="tune: expected at least 20 innovations in the first half"):
        tune(dataclasses.replace(log, **few), slam.EkfConfig())
    none = {name: value[:0] for name, value in few.items()}
    with pytest.raises(LogError, match="tune: expected observations"):
        tune(dataclasses.replace(log, **none), slam.EkfConfig())
