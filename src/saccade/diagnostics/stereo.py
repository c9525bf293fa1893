"""Rectification of a stereo rig."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.findings import Finding
from saccade.diagnostics.survey import Survey

MIN_POINTS = 200
"""Points from which something is said."""
MAX_NEGATIVE = 0.05
"""Fraction of the points with a negative disparity: wrong matches."""
MAX_ROW_OFFSET = 1.0
"""Pixels between the rows of a point in both images."""


def check_stereo(survey: Survey) -> Iterator[Finding]:
    """Whether left and right are exchanged, and the rows aligned."""
    if len(survey.disparity) < MIN_POINTS:
        return
    negative = float(np.mean(survey.disparity < -1.0))
    if negative > MAX_NEGATIVE:
        swapped = negative > 0.5
        yield Finding(
            "error" if swapped else "warning",
            "disparity sign",
            f"{100 * negative:.0f} % of the points have a negative disparity: they lie further "
            "right in the right image",
            "Exchange the left and the right images"
            if swapped
            else "Check the rectification, and whether both images are of the same time",
            100 * negative,
            "%",
        )
    rows = survey.row_offset[np.isfinite(survey.row_offset)]
    offset = float(np.median(np.abs(rows))) if len(rows) >= MIN_POINTS else 0.0
    if offset > MAX_ROW_OFFSET:
        yield Finding(
            "warning",
            "rows",
            f"the same points lie {offset:.1f} px higher or lower in the right image (median)",
            "Rectify the images, or calibrate again",
            offset,
            "px",
        )
