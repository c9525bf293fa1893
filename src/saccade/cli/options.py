"""Options shared by several commands: dataclasses whose fields cyclopts reads.

The docstring of a field is the option's help; its name is the option's name unless an annotation
overrides it. Fields that are not `kw_only` are positional; their class is the last base.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args

from cyclopts import Group, Parameter, Token, convert

from saccade.errors import Settings, require
from saccade.settings import load_model, load_settings

INPUT = Parameter(group=Group("Input", sort_key=2))
MAP = Parameter(group=Group("Map", sort_key=3))
OUTPUT = Parameter(group=Group("Output", sort_key=4))
EXECUTION = Parameter(group=Group("Execution", sort_key=5))
FigureFormat = Literal["png", "svg", "pdf"]
"""File formats of figures."""
Egomotion = Literal["camera", "second-camera", "wheels"]


def _split_commas(kind: Any, tokens: Sequence[Token]) -> Any:
    """Values separated by commas; an existing path is a single value."""
    parts = [
        token.evolve(value=part.strip())
        for token in tokens
        for part in ([token.value] if _is_path(token.value) else token.value.split(","))
    ]
    return convert(kind, parts)


def _is_path(text: str) -> bool:
    return Path(text.partition("=")[2] or text).exists()


SEVERAL = Parameter(converter=_split_commas)
"""Marks options with values separated by commas."""
OUT = Parameter(("--out", "-o"), metavar="DIR", help="Output folder.")
OutputFolder: TypeAlias = Annotated[Path, OUTPUT, OUT]


def figure_formats(formats: Iterable[str] | None) -> list[str]:
    """Formats of figures in --format; PNG by default."""
    known = get_args(FigureFormat)
    return [each for each in dict.fromkeys(formats or ()) if each in known] or ["png"]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Options(Settings):
    """Base class of command options."""


@dataclass(frozen=True, kw_only=True)
class JsonOptions(Options):
    """Output format on stdout."""

    as_json: Annotated[bool, OUTPUT, Parameter("--json")] = False
    """Print the result as JSON."""


@dataclass(frozen=True, kw_only=True)
class SettingsOptions(Options):
    """A configuration."""

    preset: Annotated[str | None, INPUT, Parameter(("--preset", "-p"), metavar="NAME")] = None
    """Preset of the configuration; see saccade config KIND --all."""
    config: Annotated[Path | None, INPUT, Parameter(("--config", "-c"))] = None
    """TOML file of settings, as printed by saccade config."""

    def settings(self, kind: str) -> Any:
        """The configuration of a kind."""
        return load_settings(kind, self.preset, self.config)

    def fitted_model(self, path: str | Path) -> Any:
        """A model of saccade fit, which carries its own settings."""
        given = self.preset or self.config
        require(given is None, "model", "no --preset and --config with a fitted model", given)
        return load_model(path)
