"""What docs/slam.md says can be done."""

import dataclasses
import re
from importlib.resources import files

import numpy as np
import pytest

from saccade import slam
from saccade.errors import LogError
from support.circular_log import simulate
from support.paths import ROOT

SCALE, WHEEL_BASE = 60.0, 2.8


def _stereo(log):
    """The same drive, seen by a stereo rig; disparities a tenth of a pixel off."""
    rng = np.random.default_rng(4)
    distance = log.observation[:, 0]
    disparity = SCALE / distance + rng.normal(size=len(distance)) * 0.1
    R = log.observation_covariance.copy()
    R[:, 0, 0] = 0.1**2
    seen = np.stack([disparity, log.observation[:, 1]], 1)
    return dataclasses.replace(log, observation=seen, observation_covariance=R)


def _car(log):
    """The same drive, by distance and steering angle."""
    steering = np.arctan(log.control[:, 1] / log.control[:, 0] * WHEEL_BASE)
    return dataclasses.replace(
        log,
        motion="custom",
        control=np.stack([log.control[:, 0], steering], 1),
        control_covariance=log.control_covariance * np.diag([1.0, 10.0]) ** 2,
    )


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The names that the code of docs/slam.md leaves, and its results."""
    folder = tmp_path_factory.mktemp("docs")
    park = (files("saccade") / "data" / "victoria_park.txt").read_text().splitlines()[:2000]
    (folder / "victoria_park.txt").write_text("\n".join(park))
    rng = np.random.default_rng(3)
    log, truth, _ = simulate(rng, "turn_then_translate", noise=0.0)
    seen = log.observation + rng.normal(size=log.observation.shape) * [0.1, 0.02]
    seen[:, 0] = np.abs(seen[:, 0])
    bearings = np.stack([log.observation[:, 0], seen[:, 1]], 1)
    drifting = dataclasses.replace(
        log, control=log.control + rng.normal(size=log.control.shape) * [0.02, 0.01]
    )
    names = {
        "stereo_log": _stereo(dataclasses.replace(drifting, observation=bearings)),
        "car_log": _car(dataclasses.replace(drifting, observation=seen)),
        "truth": truth,
    }
    code = re.findall(r"```python\n(.*?)```", (ROOT / "docs/slam.md").read_text(), re.DOTALL)
    results = []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for block in code:
            exec(block, names)
            results.append(names.get("result"))
    return names, {id(each): each for each in results if each is not None}.values()


def test_code_of_the_page_runs_and_is_right(page):
    names, results = page

    plain, stereo, car, reach = results
    assert len(plain.map) == len(names["smoothed"].map) > 20
    for result in (stereo, car):
        error = np.hypot(*(result.trajectory.pose - names["truth"])[:, :2].T)
        drift = np.hypot(*(result.dead_reckoning.pose - names["truth"])[:, :2].T)
        assert error.mean() < max(0.5 * drift.mean(), 0.2)
        assert 1.7 < result.consistency.mean < 2.3
    assert 0.3 < len(reach.map) / len(plain.map) < 1.5


def test_a_motion_that_is_not_given_is_named(rng):
    log, _, _ = simulate(rng, "turn_then_translate", steps=3)
    with pytest.raises(LogError, match="motion: expected the model of custom controls"):
        slam.run(dataclasses.replace(log, motion="custom"))


def test_the_header_of_a_csv_is_on_the_page():
    from saccade.datasets.logs.log_csv import columns_of

    text = (ROOT / "docs/slam.md").read_text()
    named = set(re.findall(r"`(\w+)`", text))
    for motion in ("compose", "turn_then_translate"):
        missing = {name for name in columns_of(motion) if name not in named}
        assert all(name.startswith("cov_") for name in missing), missing
