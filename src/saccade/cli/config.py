"""`saccade config`: a configuration as TOML."""

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import Options
from saccade.errors import require
from saccade.settings import as_toml, kinds, load_settings, presets_as_toml


@dataclass(frozen=True, kw_only=True)
class ConfigOptions(Options):
    """Options of `saccade config`."""

    preset: Annotated[str | None, Parameter(("--preset", "-p"), metavar="NAME")] = None
    """Print this preset, not the default."""
    every: Annotated[bool, Parameter("--all")] = False
    """Print every preset, one table each."""


Kind: TypeAlias = Annotated[str, Parameter(help=f"One of {', '.join(kinds())}.")]


def config(kind: Kind, /, options: ConfigOptions = ConfigOptions()) -> None:
    """Print a configuration as TOML.

    Save the output to a file, edit it, and pass it to a command with --config.
    The output of --all is for reading only: it has one table per preset.

    Example: saccade config sift --preset opencv > sift.toml
    """
    preset = options.preset
    require(not (options.every and preset), "preset", "--preset or --all", "both")
    text = presets_as_toml(kind) if options.every else as_toml(load_settings(kind, preset))
    print(text, end="")
