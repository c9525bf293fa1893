"""Diagnostics of a camera drive: finds errors of a recording before it is mapped."""

from saccade.diagnostics.checks import check_drive
from saccade.diagnostics.findings import CheckReport, Finding

__all__ = ["CheckReport", "Finding", "check_drive"]
