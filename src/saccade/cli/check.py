"""`saccade check`: diagnostics of a camera drive or a landmark log."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from saccade.cli.options import INPUT, JsonOptions, LogOptions, SequenceOptions
from saccade.cli.output import Result, Table, progress_bar
from saccade.datasets.logs.log_csv import LOG_FILE
from saccade.diagnostics import check_drive, check_log
from saccade.diagnostics.findings import Finding
from saccade.errors import setting

LOG_KINDS = ("csv", "g2o", "isam", "mrclam")
"""Formats of landmark logs."""
LOG_SUFFIXES = (".csv", ".g2o", ".isam", ".graph", ".txt")
"""Suffixes of landmark logs."""
LOG_FILES = (LOG_FILE, "Barcodes.dat")
"""Files that identify a folder as a landmark log."""


@dataclass(frozen=True)
class DriveOrLog(SequenceOptions):
    """A camera drive or a landmark log."""

    sequence: Path
    """Camera drive (a folder, video, bag or track file) or landmark log."""


@dataclass(frozen=True, kw_only=True)
class CheckOptions(JsonOptions, LogOptions, DriveOrLog):
    """Options of `saccade check`."""

    kind: Annotated[str | None, INPUT, Parameter("--format", metavar="FORMAT")] = None
    """Format of a drive: kitti, tum-rgbd, rosbag, tracks, folder or video; of a log: csv, g2o, isam
    or mrclam; detected by default."""
    frames: int = setting(300, 40)
    """Number of frames to inspect, evenly spaced over the drive; at least 40."""

    @property
    def is_log(self) -> bool:
        """Whether a landmark log is checked."""
        path = self.sequence
        if self.kind is not None:
            return self.kind in LOG_KINDS
        return path.suffix.lower() in LOG_SUFFIXES or any((path / f).exists() for f in LOG_FILES)


def check(options: CheckOptions) -> Result:
    """Check a camera drive or a landmark log for errors before mapping.

    Drives: compares odometry with visual motion (sign, scale, time offset,
    noise, camera extrinsics), and detects repeated, black, blurred and missing
    frames, and stereo pairs that are not rectified.

    Logs: compares repeated observations of each landmark, given the odometry,
    under alternative units, signs, axes, sensor mountings, orders of motion and
    clocks.

    Exit code 0: no problem found; 1: at least one problem found.

    Example: saccade check kitti/07
    """
    if options.is_log:
        log = options.load(options.sequence)
        counts = {"poses": len(log.time), "observations": len(log.observation)}
        findings = check_log(log)
        row = {"log": log.name, **counts}
        return _result(log.name, row, f"{counts['observations']:,} observations", findings)
    drive = options.load_drive()
    with progress_bar("checking") as update:
        report = check_drive(drive, options.frames, update)
    row = {"sequence": report.name, "frames": report.frames, "inspected": report.inspected}
    count = f"{report.frames} frames, {report.inspected} inspected"
    result = _result(report.name, row, count, report.findings)
    return Result({**result.row, "figures": report.figures}, result.tables, code=result.code)


def _result(name: str, row: dict[str, Any], count: str, findings: Sequence[Finding]) -> Result:
    """The findings as a table and as a row; the exit code is 1 if there is a problem."""
    problems = sum(each.severity != "note" for each in findings)
    verdict = f"{problems or 'no'} problem{'' if problems == 1 else 's'}"
    cells = [[f"{each.severity}: {each.check}", str(each)] for each in findings]
    table = Table(f"{name}: {count}, {verdict}", ["", ""], cells)
    row = {**row, "clean": problems == 0, "findings": [asdict(finding) for finding in findings]}
    return Result(row, [table], code=int(problems > 0))
