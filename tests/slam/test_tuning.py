"""Noise that is found from innovations, where it is known what it is."""

import dataclasses

import pytest

from saccade import slam
from saccade.errors import LogError
from saccade.slam.tuning import tune
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


def test_a_log_that_says_nothing_about_noise_is_refused(rng):
    log, _, _ = simulate(rng, steps=20)
    few = {
        name: getattr(log, name)[:5]
        for name in ("observation_pose", "observation", "observation_covariance", "landmark")
    }
    with pytest.raises(LogError, match="tune: expected at least 20 innovations"):
        tune(dataclasses.replace(log, **few), slam.EkfConfig())
    none = {name: value[:0] for name, value in few.items()}
    with pytest.raises(LogError, match="tune: expected observations"):
        tune(dataclasses.replace(log, **none), slam.EkfConfig())
