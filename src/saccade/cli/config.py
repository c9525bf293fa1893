"""`saccade config`: a configuration as TOML."""

from typing import Annotated

import typer
from typer import Argument, Option

from saccade.errors import require
from saccade.settings import as_toml, load_settings, presets_as_toml


def config(
    kind: Annotated[
        str,
        Argument(
            metavar="KIND",
            help="attention, contrast, symmetry, scanpath, must, sift, symroid, slam, visual, "
            "world or drive.",
        ),
    ],
    preset: Annotated[
        str | None, Option("--preset", "-p", help="Print this preset, not the default.")
    ] = None,
    every: Annotated[
        bool, Option("--all", help="Print every preset, each as a table of its name.")
    ] = False,
) -> None:
    """Print a configuration as TOML.

    Save the output to a file, edit it, and pass it to a command with --config.
    The output of --all is for reading: it has a table for each preset.
    """
    require(not (every and preset), "preset", "--preset or --all", "both")
    text = presets_as_toml(kind) if every else as_toml(load_settings(kind, preset))
    typer.echo(text, nl=False)
