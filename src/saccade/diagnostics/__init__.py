"""What is wrong with a camera drive, before it is run."""

from saccade.diagnostics.checks import CheckConfig, check_drive
from saccade.diagnostics.findings import CheckReport, Finding

__all__ = ["CheckConfig", "CheckReport", "Finding", "check_drive"]
