"""Timestamps of the frames."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.findings import Finding, counted
from saccade.frames import Drive

GAP_RATIO = 2.5
"""Frame period over the median one from which frames are missing."""
MAX_JITTER = 0.3
"""Standard deviation of the frame period, as a fraction of it."""


def check_timestamps(drive: Drive) -> Iterator[Finding]:
    """Gaps, jitter, and what was repaired when the files were read."""
    for remark in drive.remarks:
        advice = "It was repaired on reading; look what else the recorder did"
        yield Finding("warning", "files", remark, advice, 1.0, "remark")
    period = np.diff(drive.time)
    if len(period) < 5:
        return
    median = float(np.median(period))
    gaps = np.flatnonzero(period > GAP_RATIO * median)
    if len(gaps):
        longest = float(period.max())
        yield Finding(
            "warning",
            "gaps",
            f"frames are missing: {counted(len(gaps), 'gap', 'gaps')}, the longest of "
            f"{longest:.2f} s where {median:.3f} s are usual",
            "Odometry alone bridges them; look for a camera that dropped out",
            longest,
            "s",
            tuple((gaps + 1).tolist()),
        )
    jitter = 100 * float(period[period <= GAP_RATIO * median].std() / max(median, 1e-9))
    if jitter > 100 * MAX_JITTER:
        yield Finding(
            "warning",
            "uneven clock",
            f"the time between frames varies by {jitter:.0f} % (one standard deviation)",
            "Use the times of exposure, not those of arrival",
            jitter,
            "%",
        )
