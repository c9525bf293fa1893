"""What docs/slam.md says can be done."""

import re
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from saccade import slam
from support.circular_log import simulate
from support.paths import ROOT

SCALE, WHEEL_BASE = 60.0, 2.8


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The names that the code of docs/slam.md leaves."""
    folder = tmp_path_factory.mktemp("docs")
    park = (files("saccade") / "data" / "victoria_park.txt").read_text().splitlines()[:1200]
    (folder / "victoria_park.txt").write_text("\n".join(park))
    names = {}
    code = re.findall(r"```python\n(.*?)```", (ROOT / "docs/slam.md").read_text(), re.DOTALL)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for block in code:
            exec(block, names)
    return names


def test_code_of_the_page_runs_and_is_right(page):
    mapped = len(page["result"].map)
    assert mapped > 20
    assert page["result"].estimate == "smoothed"
    assert 0.3 < len(page["robot"].map) / mapped < 2  # without candidates


def test_disparities_and_steering_angles_are_converted_with_their_noise(page, rng):
    log, truth, _ = simulate(rng, "turn_then_translate", noise=0.0)
    (distance, bearing), (driven, turn) = log.observation.T, log.control.T
    disparity = SCALE / distance + rng.normal(size=len(distance)) * 0.1
    R = log.observation_covariance.copy()
    R[:, 0, 0] = 0.1**2
    z = np.stack([disparity, bearing + rng.normal(size=len(bearing)) * 0.02], 1)
    u = np.stack([driven, np.arctan(turn / driven * WHEEL_BASE)], 1)
    u += rng.normal(size=u.shape) * [0.02, 0.1]
    U = np.tile(np.diag([0.02, 0.1]) ** 2, (len(u), 1, 1))
    z, R = page["ranges"](z, R, SCALE)
    u, U = page["turns"](u, U, WHEEL_BASE)
    seen = {"observation": z, "observation_covariance": R}
    result = slam.run(replace(log, control=u, control_covariance=U, **seen))
    error = np.hypot(*(result.trajectory.pose - truth)[:, :2].T)
    drift = np.hypot(*(result.dead_reckoning.pose - truth)[:, :2].T)
    assert error.mean() < max(0.5 * drift.mean(), 0.2)
    assert 1.7 < result.consistency.mean < 2.3


def test_the_header_of_a_csv_is_on_the_page():
    from saccade.datasets.logs.log_csv import columns_of
    from saccade.motions import MOTIONS

    text = (ROOT / "docs/slam.md").read_text()
    named = set(re.findall(r"`(\w+)`", text))
    for motion in MOTIONS:
        missing = {name for name in columns_of(motion) if name not in named}
        assert all(name.startswith("cov_") for name in missing), missing
