"""`saccade convert`: a landmark log in another format."""

from pathlib import Path
from typing import Annotated, cast

from typer import Argument, Option

from saccade.cli.options import Json, LogFormat, LogPath, Robot, Topics


def convert(
    log: LogPath,
    file: Annotated[Path, Argument(metavar="FILE", help="File or folder to write.")],
    kind: LogFormat = None,
    to: Annotated[
        str | None,
        Option(
            help="Format of FILE: csv, g2o, isam, toro, gtsam or mrclam; given by its suffix by "
            "default."
        ),
    ] = None,
    robot: Robot = None,
    topic: Topics = None,
    as_json: Json = False,
) -> None:
    """Convert a landmark log to another format.

    csv keeps everything but the ground truth; its header names the columns.
    g2o, isam, toro and gtsam are pose graphs as text, without time stamps;
    mrclam is a folder of velocities without covariance. All but csv need the
    identity of every landmark.
    """
    from saccade import datasets
    from saccade.cli.output import print_result

    source = "auto" if kind is None else kind
    recorded = datasets.load(cast("datasets.Kind", source), log, robot=robot, topic=topic)
    datasets.save(file, recorded, cast("datasets.Format", "auto" if to is None else to))
    row = {
        "log": recorded.name,
        "poses": len(recorded.time),
        "observations": len(recorded.observation),
        "file": str(file),
    }
    print_result(row, as_json, f"{recorded.name} -> {file}")
