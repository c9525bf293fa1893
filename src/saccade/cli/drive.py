"""`saccade drive`: visual SLAM from camera frames and odometry."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import INPUT, OutputFolder, SettingsOptions
from saccade.cli.output import Result, print_message, progress_bar
from saccade.cli.recordings import SequenceOptions, TagOptions
from saccade.cli.run_output import RunOutput
from saccade.errors import setting
from saccade.io.files import results_in


@dataclass(frozen=True, kw_only=True)
class DriveOptions(SettingsOptions, RunOutput, TagOptions, SequenceOptions):
    """Options of `saccade drive`."""

    out: OutputFolder = Path("saccade-drive")
    device: Annotated[str | None, INPUT, Parameter(metavar="SOURCE")] = None
    """Map live from a device (0), an address (rtsp://...) or a video file."""
    frames: Annotated[int | None, INPUT, Parameter(metavar="N")] = setting(None, 1)
    """Process only the first N frames, at least 1."""
    keep_repeated: Annotated[bool, INPUT] = False
    """Process repeated frames as if they were new."""


Ride: TypeAlias = Annotated[
    Path, Parameter(help="Camera drive: a folder, video, bag or track file.")
]


def drive(sequence: Ride, /, options: DriveOptions = DriveOptions()) -> Result:
    """Map a camera drive: visual odometry, keypoint landmarks and EKF-SLAM.

    Writes to --out the trajectory (trajectory.tum, for evo; poses.csv with
    covariances; filtered.tum before smoothing; visual_odometry.csv, from the
    camera alone), the map (landmarks.csv), a figure (map.png), an interactive
    report (report.html), and settings and scores (run.json); with --film also a
    film (drive.mp4).

    With --tags the tags in the images are landmarks, too.

    --device maps a live camera and records it in the folder SEQUENCE, whose
    camera.toml has the calibration; Ctrl-C ends the drive.

    Example: saccade drive KITTI/07 --out mapped
    """
    from saccade.cli.drive_run import (
        drive_tables,
        load_recorded,
        map_camera,
        map_recorded,
        write_results,
    )

    settings = options.settings("visual")
    recorded = load_recorded(sequence, options) if options.device is None else None
    name = f"camera {options.device}" if recorded is None else recorded.name
    with results_in(options.out), progress_bar(name) as progress:
        mapped, result, snapshots = (
            map_camera(sequence, settings, options, progress)
            if recorded is None
            else map_recorded(recorded, settings, options, progress, options.tag_config)
        )
        row = write_results(mapped, settings, options, progress, result, snapshots)
    for remark in row["remarks"]:
        print_message(remark)
    return Result(row, drive_tables(row, f"{name} -> {options.out}"))
