"""Diagnostics of camera drives, landmark logs and SLAM runs."""

from saccade.diagnostics.checks import check_drive
from saccade.diagnostics.drive_run import mapping_findings
from saccade.diagnostics.findings import CheckReport, Finding
from saccade.diagnostics.landmark_log import check_log
from saccade.diagnostics.recording import drop_repeated
from saccade.diagnostics.slam_run import check_run

__all__ = [
    "CheckReport",
    "Finding",
    "check_drive",
    "check_log",
    "check_run",
    "drop_repeated",
    "mapping_findings",
]
