"""Diagnostics of a camera drive: what would spoil a run, found before it."""

from saccade.diagnostics.checks import CheckConfig, check_drive
from saccade.diagnostics.findings import CheckReport, Finding

__all__ = ["CheckConfig", "CheckReport", "Finding", "check_drive"]
