"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Images = Annotated[
    list[str],
    typer.Argument(metavar="IMAGE...", help="Images, folders of images, or quoted patterns."),
]
Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for what is made.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Preset = Annotated[
    str | None,
    typer.Option("--preset", "-p", help="A named configuration; `saccade config` lists them."),
]
Settings = Annotated[
    Path | None,
    typer.Option("--config", "-c", help="A TOML file as `saccade config` prints it."),
]
Report = Annotated[
    Path | None,
    typer.Option(
        "--report", metavar="FILE", help="Also write the tables as a page, such as report.html."
    ),
]
