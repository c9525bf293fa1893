"""Whether two cameras are a rectified rig."""

import numpy as np

from saccade.diagnostics.findings import Finding
from saccade.diagnostics.survey import Survey

LEAST = 200
"""Points below which nothing is said."""
NEGATIVE = 0.05
"""Share of the points that may lie further right in the right image: wrong matches."""
ROWS = 1.0
"""Pixels by which rows may be apart."""


def check_stereo(survey: Survey) -> list[Finding]:
    """Right and left the same way round, and on the same rows."""
    if len(survey.disparity) < LEAST:
        return []
    negative = float(np.mean(survey.disparity < -1.0))
    findings = []
    if negative > NEGATIVE:
        swapped = negative > 0.5
        findings.append(
            Finding(
                "error" if swapped else "warning",
                "disparity sign",
                f"{100 * negative:.0f} % of the points lie further right in the right image, "
                "where nothing real can be",
                "Exchange the left and the right images"
                if swapped
                else "Look at the rectification, and whether both images are of the same time",
                100 * negative,
                "%",
            )
        )
    rows = survey.rows_apart[np.isfinite(survey.rows_apart)]
    apart = float(np.median(np.abs(rows))) if len(rows) >= LEAST else 0.0
    if apart > ROWS:
        findings.append(
            Finding(
                "warning",
                "rows",
                f"the same points lie {apart:.1f} px higher or lower in the right image (median)",
                "Rectify the images, or calibrate again",
                apart,
                "px",
            )
        )
    return findings
