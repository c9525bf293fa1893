"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Images = Annotated[
    list[str],
    typer.Argument(metavar="IMAGE", help="Images, folders of images, or quoted patterns."),
]
Log = Annotated[Path, typer.Argument(metavar="LOG", help="Landmark log: a file or folder.")]
Sequence = Annotated[
    Path,
    typer.Argument(metavar="SEQUENCE", help="Camera drive: a folder, video, bag or track file."),
]
Out = Annotated[Path, typer.Option("--out", "-o", help="Output folder.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Preset = Annotated[
    str | None,
    typer.Option(
        "--preset", "-p", help="Preset of the configuration; see saccade config KIND --all."
    ),
]
Config = Annotated[
    Path | None,
    typer.Option("--config", "-c", help="TOML file with settings; see saccade config."),
]
Report = Annotated[
    Path | None,
    typer.Option("--report", metavar="FILE", help="Also write the tables as an HTML page."),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the random number generator.")]
MaxKeypoints = Annotated[
    int | None, typer.Option("--max", min=1, help="Keep only so many keypoints, the strongest.")
]
Spread = Annotated[
    bool, typer.Option("--spread", help="With --max: keep keypoints spread over the image.")
]
LogFormat = Annotated[
    str | None,
    typer.Option(
        "--format",
        help="Format of LOG: csv, g2o, isam, mrclam, victoria-park or dlr; detected by default.",
    ),
]
Robot = Annotated[
    int | None, typer.Option(min=1, help="Number of the robot, in a log of several robots.")
]
SequenceFormat = Annotated[
    str | None,
    typer.Option(
        "--format",
        help="Format of SEQUENCE: kitti, tum-rgbd, euroc, rosbag, tracks, folder or video; "
        "detected by default.",
    ),
]
Film = Annotated[bool, typer.Option(help="Write a film of the growing map.")]
CheckpointInterval = Annotated[
    float,
    typer.Option(
        "--checkpoint",
        min=0.0,
        metavar="SECONDS",
        help="Time between checkpoints, from which an interrupted run resumes.",
    ),
]
