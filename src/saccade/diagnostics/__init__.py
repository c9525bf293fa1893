"""Diagnostics of a camera drive: finds errors of a recording before it is mapped."""

from saccade.diagnostics.checks import check_drive
from saccade.diagnostics.findings import CheckReport, Finding
from saccade.diagnostics.repeats import drop_repeated

__all__ = ["CheckReport", "Finding", "check_drive", "drop_repeated"]
