"""A pytest plugin that records which lines every quick test runs; slow tests are stopped."""

import os
import signal
from collections import Counter, defaultdict
from contextlib import contextmanager
from pathlib import Path

import coverage
import pytest


class Reach:
    """Collects while pytest runs.

    Args:
        package: the folder of the code.
        limit: CPU seconds that a test may take, fixtures and tracing included.
    """

    def __init__(self, package: Path, limit: float) -> None:
        self.limit = limit
        self.took: dict[str, float] = {}
        self.slow: Counter[str] = Counter()
        include = [f"{package}{os.sep}*"]
        self.tracer = coverage.Coverage(data_file=None, include=include, config_file=False)
        self.tracer.start()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        """Attribute lines to the test."""
        self.tracer.switch_context(item.nodeid)
        result = yield
        self.tracer.switch_context("")
        return result

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_runtest_setup(self, item):
        """Stop what a test needs if it takes too long; leave out what is known to be slow."""
        if self.slow[name_of(item)]:
            pytest.skip("another of its kind was too slow")
        with self.limited(item):
            return (yield)

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_runtest_call(self, item):
        """Stop a test that takes too long."""
        with self.limited(item):
            return (yield)

    @contextmanager
    def limited(self, item):
        """Raise a TimeoutError after a time."""

        def stop(number, frame):
            self.slow[name_of(item)] += 1
            raise TimeoutError

        signal.signal(signal.SIGPROF, stop)
        signal.setitimer(signal.ITIMER_PROF, self.limit, self.limit)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)

    def pytest_runtest_logreport(self, report):
        """Remember how long it took, what it needed too, if it passed."""
        if report.when == "setup":
            self.took[report.nodeid] = 0.0
        if report.passed and report.nodeid in self.took:
            self.took[report.nodeid] += report.duration
        elif not report.passed:
            self.took.pop(report.nodeid, None)

    def lines(self) -> dict[str, dict[str, dict[str, float]]]:
        """By file and line, the tests that run it and their seconds, the quickest first."""
        self.tracer.stop()
        data = self.tracer.get_data()
        tests: dict[str, dict[str, dict[str, float]]] = defaultdict(dict)
        for file in data.measured_files():
            for line, contexts in data.contexts_by_lineno(file).items():
                ours = sorted(self.took.keys() & contexts, key=self.took.__getitem__)
                tests[file][str(line)] = {test: self.took[test] for test in ours}
        return tests


def name_of(item):
    """A test without its parameters."""
    return item.nodeid.partition("[")[0]
