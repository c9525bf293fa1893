"""`saccade check`: what is wrong with a camera drive, before a run."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from saccade.cli.options import Json

if TYPE_CHECKING:
    from saccade.diagnostics import CheckReport


def check(
    sequence: Annotated[
        Path, typer.Argument(metavar="SEQUENCE", help="Folder, video, bag or tracks of a drive.")
    ],
    kind: Annotated[
        str,
        typer.Option(
            "--format",
            help="Of SEQUENCE: kitti, tum-rgbd, euroc, rosbag, tracks, folder or video; "
            "auto: found out.",
        ),
    ] = "auto",
    frames: Annotated[
        int, typer.Option(min=40, help="Images to look at, spread over a longer drive.")
    ] = 300,
    as_json: Json = False,
) -> None:
    """Tell what is wrong with a camera drive, before a run.

    Compares odometry with the motion of the images (sign, scale, clock, noise,
    where the camera is), and looks for repeated, black, blurred and missing
    frames, cameras that are no rectified pair, and ground that is not flat.

    Exit code 0: nothing is wrong; 1: something is.
    """
    from rich.progress import Progress

    from saccade import datasets
    from saccade.cli.output import messages, print_json
    from saccade.diagnostics import CheckConfig, check_drive

    drive = datasets.load_drive(cast("datasets.DriveKind", kind), sequence)
    console = messages()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("looking", total=None)
        report = check_drive(
            drive,
            CheckConfig(frames),
            lambda done, of: progress.update(task, completed=done, total=of),
        )
    if as_json:
        print_json(_as_row(report))
    else:
        _print(report)
    if not report.clean:
        raise typer.Exit(1)


def _as_row(report: "CheckReport") -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "sequence": report.name,
        "frames": report.frames,
        "looked_at": report.inspected,
        "clean": report.clean,
        "findings": [asdict(finding) for finding in report.findings],
        "figures": report.figures,
    }


def _print(report: "CheckReport") -> None:
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console(highlight=False)
    wrong = sum(finding.severity != "note" for finding in report.findings)
    count = f"{report.frames} frames" + (
        f", {report.inspected} looked at" if report.inspected < report.frames else ""
    )
    verdict = f"{wrong} thing{'s' if wrong > 1 else ''} wrong" if wrong else "nothing wrong"
    console.print(Text(f"{report.name}: {count}, {verdict}", style="bold"), soft_wrap=True)
    styles = {"error": "bold red", "warning": "yellow", "note": "dim"}
    for finding in report.findings:
        heading = Text(f"{finding.severity:8}", style=styles[finding.severity])
        heading.append(finding.check, style="bold")
        console.print()
        console.print(heading)
        console.print(Padding(Text(str(finding)), (0, 0, 0, 8)))
