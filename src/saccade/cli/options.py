"""Options shared by several commands: dataclasses whose fields cyclopts reads.

The docstring of a field is the option's help; its name is the option's name unless an annotation
overrides it. Fields that are not `kw_only` are positional; their class is the last base.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, get_args

from cyclopts import Group, Parameter, Token, convert

from saccade.errors import ConfigError, Settings, require, setting
from saccade.settings import load_model, load_settings

if TYPE_CHECKING:
    from saccade.datasets.drives.folder import CameraOptions as Calibration
    from saccade.frames import Drive
    from saccade.types import LandmarkLog

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


@dataclass(frozen=True, kw_only=True)
class LogOptions(Options):
    """Options for reading a landmark log."""

    kind: Annotated[str | None, INPUT, Parameter("--format", metavar="FORMAT")] = None
    """Format of LOG: csv, g2o, isam, mrclam or rosbag; detected by default."""
    robot: Annotated[int | None, INPUT] = setting(None, 1)
    """Number of the robot, from 1, in a log of several robots."""
    topic: Annotated[list[str] | None, INPUT, SEVERAL, Parameter(metavar="TOPIC")] = None
    """Landmark topics in a ROS bag, separated by commas for several cameras; by default chosen by
    message type."""
    sensor: Annotated[str | None, INPUT, Parameter(metavar="X,Y,YAW")] = None
    """Pose of the sensor in the robot frame: meters forward and left, and radians."""

    def load(self, log: Path) -> "LandmarkLog":
        """The log."""
        from saccade import datasets

        kind: Any = self.kind or "auto"
        sensor = None if self.sensor is None else parse_pose("--sensor", self.sensor, "X,Y,YAW")
        return datasets.load(kind, log, robot=self.robot, topic=self.topic, sensor=sensor)


def parse_pose(option: str, text: str, expected: str) -> tuple[float, float, float]:
    """Parses three finite numbers; `expected` is the form shown in the error message."""
    try:
        x, y, angle = (float(number) for number in text.split(","))
    except ValueError:
        x = y = angle = inf
    if not all(map(isfinite, (x, y, angle))):
        raise ConfigError(f"{option}: expected {expected}, found {text!r}")
    return x, y, angle


@dataclass(frozen=True, kw_only=True)
class SequenceOptions(Options):
    """A camera drive, with calibration for files that lack it."""

    sequence: Path = field(kw_only=False)
    """Camera drive: a folder, video, bag or track file."""
    kind: Annotated[str | None, INPUT, Parameter("--format", metavar="FORMAT")] = None
    """Format of SEQUENCE: kitti, tum-rgbd, rosbag, tracks, folder or video; detected by default."""
    intrinsics: Annotated[str | None, INPUT, Parameter(metavar="FX,FY,CX,CY")] = None
    """Intrinsic parameters of the camera in pixels, for images without a calibration."""
    baseline: Annotated[float | None, INPUT, Parameter(metavar="METERS")] = setting(None, 1e-6)
    """Distance between the cameras of a stereo pair without a calibration."""

    def calibration(self) -> "Calibration":
        """Calibration given on the command line, for a drive that has none."""
        from saccade.datasets.drives.folder import CameraOptions, parse_intrinsics

        return CameraOptions(parse_intrinsics(self.intrinsics), self.baseline)

    def load_drive(self) -> "Drive":
        """The drive."""
        from saccade.datasets import load_drive

        kind: Any = self.kind or "auto"
        return load_drive(kind, self.sequence, self.calibration())
