"""Times of the frames."""

import numpy as np

from saccade.diagnostics.findings import Finding, counted, numbers_of
from saccade.frames import Drive

GAP = 2.5
"""Times the usual time between frames, above which some are missing."""
UNEVEN = 0.3
"""Standard deviation of the time between frames, as a share of it, that a camera may have."""


def check_clock(drive: Drive) -> list[Finding]:
    """Gaps, an uneven beat, and what had to be mended when the files were read."""
    findings = [
        Finding(
            "warning",
            "files",
            remark,
            "It was mended on reading; look what else the recorder did",
            1.0,
            "remark",
        )
        for remark in drive.remarks
    ]
    period = np.diff(drive.time)
    if len(period) < 5:
        return findings
    usual = float(np.median(period))
    gaps = np.flatnonzero(period > GAP * usual)
    if len(gaps):
        longest = float(period.max())
        findings.append(
            Finding(
                "warning",
                "gaps",
                f"frames are missing: {counted(len(gaps), 'gap', 'gaps')}, the longest of "
                f"{longest:.2f} s where {usual:.3f} s are usual",
                "Odometry alone bridges them; look for a camera that fell out",
                longest,
                "s",
                numbers_of(gaps + 1),
            )
        )
    even = period[period <= GAP * usual]
    spread = float(even.std() / max(usual, 1e-9))
    if spread > UNEVEN:
        findings.append(
            Finding(
                "warning",
                "uneven clock",
                f"the time between frames varies by {100 * spread:.0f} % (one standard deviation)",
                "Use the times of exposure, not those of arrival",
                100 * spread,
                "%",
            )
        )
    return findings
