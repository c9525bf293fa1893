"""Options for reading recordings: landmark logs and camera drives."""

from dataclasses import dataclass, field
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import INPUT, SEVERAL, Options
from saccade.datasets import load, load_drive
from saccade.datasets.drives.folder import CameraOptions, parse_intrinsics
from saccade.datasets.drives.formats import DRIVE_FORMATS
from saccade.datasets.logs.formats import LOG_FORMATS
from saccade.errors import ConfigError, setting
from saccade.frames import Drive
from saccade.types import LandmarkLog

FORMAT = Parameter("--format", metavar="FORMAT")
if TYPE_CHECKING:
    LogKind: TypeAlias = str
    DriveKind: TypeAlias = str
    AnyKind: TypeAlias = str
else:  # names for help and completion, or module:function
    LogKind = Literal[*LOG_FORMATS] | str
    DriveKind = Literal[*DRIVE_FORMATS] | str
    AnyKind = Literal[*dict.fromkeys([*DRIVE_FORMATS, *LOG_FORMATS])] | str


@dataclass(frozen=True, kw_only=True)
class LogOptions(Options):
    """Options for reading a landmark log."""

    kind: Annotated[LogKind | None, INPUT, FORMAT] = None
    """Format of LOG, or module:function that reads it; detected by default."""
    robot: Annotated[int | None, INPUT] = setting(None, 1)
    """Number of the robot, from 1, in a log of several robots."""
    topic: Annotated[list[str] | None, INPUT, SEVERAL, Parameter(metavar="TOPIC")] = None
    """Landmark topics in a ROS bag, separated by commas for several cameras; by default chosen by
    message type."""
    sensor: Annotated[str | None, INPUT, Parameter(metavar="X,Y,YAW")] = None
    """Pose of the sensor in the robot frame: meters forward and left, and radians."""

    def load(self, log: Path) -> LandmarkLog:
        """The log."""
        sensor = None if self.sensor is None else parse_pose("--sensor", self.sensor, "X,Y,YAW")
        kind = self.kind or "auto"
        return load(kind, log, robot=self.robot, topic=self.topic, sensor=sensor)


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
    kind: Annotated[DriveKind | None, INPUT, FORMAT] = None
    """Layout of SEQUENCE, or module:function that reads it; detected by default."""
    intrinsics: Annotated[str | None, INPUT, Parameter(metavar="FX,FY,CX,CY")] = None
    """Intrinsic parameters of the camera in pixels, for images without a calibration."""
    baseline: Annotated[float | None, INPUT, Parameter(metavar="METERS")] = setting(None, 1e-6)
    """Distance between the cameras of a stereo pair without a calibration."""

    def calibration(self) -> CameraOptions:
        """Calibration given on the command line, for a drive that has none."""
        return CameraOptions(parse_intrinsics(self.intrinsics), self.baseline)

    def load_drive(self) -> Drive:
        """The drive."""
        return load_drive(self.kind or "auto", self.sequence, self.calibration())
