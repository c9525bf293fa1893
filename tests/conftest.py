"""Where the tests find their data."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from hypothesis.internal.conjecture import providers

import saccade
from saccade.cli import TRACEBACK, main
from saccade.simulation import WorldConfig, simulate_world
from support.filmed_wall import filmed
from support.limits import PAGE_TIMEOUT
from support.paths import SHARED

os.environ[TRACEBACK] = "1"  # or an error that nobody foresaw would look like one that is told
__all__ = ["filmed"]

CHROMIUM = Path("/usr/bin/chromium")
COMPILE_IMAGES = Path(__file__).parent / "support" / "compile_images.py"

hypothesis.settings.register_profile(
    "saccade",
    deadline=None,  # the first example compiles
    derandomize=True,  # one state of the code, one verdict
    database=None,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],  # that of a busy machine
)
hypothesis.settings.register_profile(
    "random",  # new examples every time: for a search, as `uvx nox -s fuzz` is one
    hypothesis.settings.get_profile("saccade"),
    derandomize=False,
    print_blob=True,
)
hypothesis.settings.load_profile("saccade")


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    """Keep derandomized examples free of the constants that Hypothesis finds in local modules.

    Which of them are imported depends on the tests that a worker happened to run before. Before
    all tests, compile what most of them call, which each worker would do for itself otherwise:
    the filter here and SIFT in another process. Workers share the cores, so that threads of BLAS
    would only wait for each other: one for each.
    """
    if config.getoption("numprocesses"):
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if hypothesis.settings.default.derandomize:
        providers.is_local_module_file = lambda path: False
    if config.args_source is pytest.Config.ArgsSource.TESTPATHS and not hasattr(
        config, "workerinput"
    ):
        with subprocess.Popen([sys.executable, COMPILE_IMAGES], stderr=subprocess.DEVNULL):
            log = simulate_world(WorldConfig(steps=60))
            saccade.slam.run(log)
            saccade.slam.run(replace(log, landmark=np.full(len(log.landmark), -1)))


def pytest_collection_modifyitems(items):
    if SHARED.is_dir():
        return
    absent = pytest.mark.skip(reason=f"reference data is not at {SHARED}")
    for item in items:
        if item.get_closest_marker("shared"):
            item.add_marker(absent)


@pytest.fixture(scope="session")
def shared():
    """The folder of reference data, for tests that are marked `shared`."""
    return SHARED


@pytest.fixture
def rng():
    return np.random.default_rng(20261121)


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium, for pages that are looked at."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not CHROMIUM.exists():
        pytest.skip(f"no browser at {CHROMIUM}")
    flags = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=str(CHROMIUM), args=flags, timeout=1000 * PAGE_TIMEOUT
        )
        api.expect.set_options(timeout=1000 * PAGE_TIMEOUT)
        yield chromium
        chromium.close()


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run `saccade` in an empty folder; gives the exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["saccade", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call
