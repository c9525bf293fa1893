"""Whole logs with defects: `check`, `slam.run` and `Slam.step` end in a result or in one line.

A defect that has a finding is found. `FUZZ_LOGS=500 pytest -m nightly tests/test_fuzz_logs.py` is
part of `uvx nox -s nightly`.
"""

import os

import pytest

from saccade import slam
from saccade.diagnostics import check_log, check_run
from saccade.slam.recorded_log import slam_for
from support.broken_logs import broken_log
from support.error_checks import result_or_refusal
from support.logs import scan_of

LOGS = int(os.environ.get("FUZZ_LOGS", "500"))


def survives(seed):
    """Whether a log is refused, or its defect found; no other exception is raised."""
    log, names, must_be_found = broken_log(seed)
    if log is None:
        assert must_be_found, f"{seed}: {names}"  # the message
        return
    causes, refusal = result_or_refusal(lambda: check_log(log))
    result, refused = result_or_refusal(lambda: slam.run(log))
    findings = list(causes or ())
    if result is not None:
        findings += check_run(log, result, causes or ())
    live = slam_for(log)
    for step in range(len(log.time)):
        _, stopped = result_or_refusal(lambda step=step: live.step(*scan_of(log, step)))
        if stopped:
            break
    if must_be_found:
        severe = [each for each in findings if each.severity != "note"]
        assert severe or refusal or refused, f"{seed}: nothing is found of {names}"


@pytest.mark.parametrize("seed", range(3, 12))
def test_a_log_with_defects_is_mapped_or_refused(seed):
    survives(seed)


@pytest.mark.nightly
def test_many_logs_with_defects_are_mapped_or_refused():
    for seed in range(LOGS):
        survives(seed)
