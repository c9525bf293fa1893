"""`saccade check`: diagnostics of a camera drive."""

from dataclasses import asdict, dataclass

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from saccade.cli.group import option
from saccade.cli.options import JsonOption, SequenceOptions
from saccade.cli.output import Result, progress_bar
from saccade.diagnostics import CheckReport, check_drive


@dataclass(frozen=True, kw_only=True)
class CheckOptions(JsonOption):
    """Options of `saccade check`."""

    frames: int = option(300, min=40)
    """Frames to inspect, spread over a longer drive."""


def check(source: SequenceOptions, options: CheckOptions) -> Result:
    """Check a camera drive for errors before it is mapped.

    Compares odometry with visual motion (sign, scale, time offset, noise,
    camera extrinsics), and detects repeated, black, blurred and missing
    frames, stereo pairs that are not rectified, and ground that is not flat.

    Exit code 0: no problem was found; 1: at least one was found.
    """
    drive = source.load()
    with progress_bar("checking") as update:
        report = check_drive(drive, options.frames, update)
    if not options.as_json:
        _print(report)
    row = {
        "sequence": report.name,
        "frames": report.frames,
        "inspected": report.inspected,
        "clean": report.clean,
        "findings": [asdict(finding) for finding in report.findings],
        "figures": report.figures,
    }
    return Result(row, code=int(not report.clean))


def _print(report: CheckReport) -> None:
    console = Console(highlight=False)
    problems = sum(finding.severity != "note" for finding in report.findings)
    count = f"{report.frames} frames"
    if report.inspected < report.frames:
        count += f", {report.inspected} inspected"
    verdict = f"{problems or 'no'} problem{'' if problems == 1 else 's'}"
    console.print(Text(f"{report.name}: {count}, {verdict}", style="bold"), soft_wrap=True)
    styles = {"error": "bold red", "warning": "yellow", "note": "dim"}
    for finding in report.findings:
        heading = Text(f"{finding.severity:8}", style=styles[finding.severity])
        heading.append(finding.check, style="bold")
        console.print()
        console.print(heading)
        console.print(Padding(Text(str(finding)), (0, 0, 0, 8)))
