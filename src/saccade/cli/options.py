"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter, Option

FILE_SUFFIXES = (
    *(".bmp", ".csv", ".db", ".eps", ".gif", ".h5", ".html", ".jpeg", ".jpg", ".json", ".mp4"),
    *(".npz", ".parquet", ".pdf", ".png", ".svg", ".tif", ".tiff", ".toml", ".txt", ".webp"),
)
"""Of an output that was meant as a file where a folder is written."""

Images = Annotated[
    list[str], Argument(metavar="IMAGE", help="Images, folders of images, or quoted patterns.")
]
LogPath = Annotated[Path, Argument(metavar="LOG", help="Landmark log: a file or folder.")]
SequencePath = Annotated[
    Path, Argument(metavar="SEQUENCE", help="Camera drive: a folder, video, bag or track file.")
]
Intrinsics = Annotated[
    str | None,
    Option(metavar="FX,FY,CX,CY", help="Camera of images without a calibration, in pixels."),
]
Baseline = Annotated[
    float | None, Option(min=1e-6, help="Metres between the cameras of such a stereo pair.")
]


def _folder(path: Path) -> Path:
    """An output folder, whose name is not that of a file."""
    if path.suffix.lower() in FILE_SUFFIXES and not path.exists():
        raise BadParameter(f"expected a folder, found the name of a file: {path}")
    return path


Out = Annotated[Path, Option("--out", "-o", help="Output folder.", callback=_folder)]
Json = Annotated[bool, Option("--json", help="Print the result as JSON.")]
Preset = Annotated[
    str | None,
    Option("--preset", "-p", help="Preset of the configuration; see saccade config KIND --all."),
]
Config = Annotated[
    Path | None,
    Option("--config", "-c", help="TOML file of settings, as printed by saccade config."),
]
Report = Annotated[
    Path | None, Option("--report", metavar="FILE", help="Also write the tables as an HTML page.")
]
Seed = Annotated[int, Option(min=0, help="Seed of the random number generator.")]
MaxKeypoints = Annotated[
    int | None, Option("--max", min=1, metavar="N", help="Keep only the N strongest keypoints.")
]
Spread = Annotated[
    bool, Option("--spread", help="With --max: keep keypoints spread over the image.")
]
LogFormat = Annotated[
    str | None,
    Option(
        "--format",
        help="Format of LOG: csv, g2o, isam, mrclam, victoria-park or dlr; detected by default.",
    ),
]
Robot = Annotated[
    int | None, Option(min=1, help="Number of the robot, in a log of several robots.")
]
SequenceFormat = Annotated[
    str | None,
    Option(
        "--format",
        help="Format of SEQUENCE: kitti, tum-rgbd, euroc, rosbag, tracks, folder or video; "
        "detected by default.",
    ),
]
Film = Annotated[bool, Option(help="Write a film of the growing map.")]
CheckpointInterval = Annotated[
    float,
    Option(
        "--checkpoint",
        min=0.0,
        metavar="SECONDS",
        help="Time between checkpoints, from which an interrupted run resumes.",
    ),
]
