"""`saccade convert`: a landmark log from one format into another."""

from pathlib import Path
from typing import Annotated, cast

import typer

from saccade.cli.options import Json


def convert(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The recorded log, a file or folder.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What to write.")],
    kind: Annotated[
        str, typer.Option("--format", help="Of LOG; see saccade slam --help.")
    ] = "auto",
    to: Annotated[
        str,
        typer.Option(help="Of FILE: csv, g2o, isam, toro, gtsam or mrclam; auto: its suffix."),
    ] = "auto",
    robot: Annotated[
        int | None, typer.Option(min=1, help="Which robot, where a log has several.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a landmark log in another format.

    csv keeps all but the truth, and its header says what its cells are. g2o,
    isam, toro and gtsam are texts of poses and edges, without a clock; mrclam
    is a folder of speeds without noise. They need the identity of every
    landmark.
    """
    from saccade import datasets
    from saccade.cli.output import print_json, print_table

    recorded = datasets.load(cast("datasets.Kind", kind), log, robot=robot)
    datasets.save(file, recorded, cast("datasets.Format", to))
    row = {
        "log": recorded.name,
        "poses": len(recorded.time),
        "observations": len(recorded.observation),
        "file": str(file),
    }
    if as_json:
        print_json(row)
        return
    print_table(f"{recorded.name} -> {file}", ["", ""], [(k, str(v)) for k, v in row.items()])
