"""`saccade check`: diagnostics of a camera drive."""

from dataclasses import asdict, dataclass

from saccade.cli.options import JsonOptions, SequenceOptions
from saccade.cli.output import Result, Table, progress_bar
from saccade.diagnostics import check_drive
from saccade.errors import setting


@dataclass(frozen=True, kw_only=True)
class CheckOptions(JsonOptions, SequenceOptions):
    """Options of `saccade check`."""

    frames: int = setting(300, 40)
    """Number of frames to inspect, spread over a longer drive; at least 40."""


def check(options: CheckOptions) -> Result:
    """Check a camera drive for errors before it is mapped.

    Compares odometry with visual motion (sign, scale, time offset, noise,
    camera extrinsics), and detects repeated, black, blurred and missing
    frames, stereo pairs that are not rectified, and ground that is not flat.

    Exit code 0: no problem was found; 1: at least one was found.

    Example: saccade check kitti/07
    """
    drive = options.load_drive()
    with progress_bar("checking") as update:
        report = check_drive(drive, options.frames, update)
    row = {
        "sequence": report.name,
        "frames": report.frames,
        "inspected": report.inspected,
        "clean": report.clean,
        "findings": [asdict(finding) for finding in report.findings],
        "figures": report.figures,
    }
    problems = sum(each.severity != "note" for each in report.findings)
    count = f"{report.frames} frames, {report.inspected} inspected"
    verdict = f"{problems or 'no'} problem{'' if problems == 1 else 's'}"
    cells = [[f"{each.severity}: {each.check}", str(each)] for each in report.findings]
    table = Table(f"{report.name}: {count}, {verdict}", ["", ""], cells)
    return Result(row, [table], code=int(not report.clean))
