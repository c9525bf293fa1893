"""`saccade config`: a configuration and its presets, as TOML."""

from typing import Annotated

import typer

from saccade.cli.options import Preset


def config(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="attention, contrast, symmetry, scanpath, must, sift, symroid, slam, world "
            "or drive.",
        ),
    ],
    preset: Preset = None,
) -> None:
    """Print a configuration with its presets as TOML.

    Save the preset you want to a file, change it, and hand it to a command
    with --config. Without --preset every preset is printed, a table each.
    """
    from saccade.settings import as_toml, load_settings, presets_as_toml

    if preset is not None:
        typer.echo(as_toml(load_settings(kind, preset)), nl=False)
        return
    typer.echo(presets_as_toml(kind), nl=False)
