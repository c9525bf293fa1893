"""A plugin of pytest: tests that take too long are stopped, and the others are written down."""

import json
import os
import signal
from pathlib import Path

import pytest

LIMIT = float(os.environ["QUICK_LIMIT"])
TOOK: dict[str, float] = {}


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Stop a test, its fixtures too."""

    def stop(number, frame):
        raise TimeoutError

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LIMIT, LIMIT)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def pytest_runtest_logreport(report):
    """Remember how long it took."""
    if report.when == "call" and report.passed:
        TOOK[report.nodeid] = report.duration


def pytest_sessionfinish():
    """Write it down."""
    Path(os.environ["QUICK_REPORT"]).write_text(json.dumps(TOOK))
