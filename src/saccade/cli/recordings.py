"""Options for reading recordings: landmark logs and camera drives."""

from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import INPUT, SEVERAL, Options
from saccade.cli.output import print_message, progress_bar
from saccade.datasets import load, load_drive
from saccade.datasets.drives.folder import CameraOptions, parse_intrinsics
from saccade.datasets.drives.formats import DRIVE_FORMATS
from saccade.datasets.logs.formats import LOG_FORMATS
from saccade.errors import ConfigError, ImageError, require, setting
from saccade.frames import Drive
from saccade.tags import TagConfig, TagLog, observe_tags, parse_sizes
from saccade.types import Image, LandmarkLog, LandmarkMap

MAX_REMARKS = 5
"""Maximum number of remarks on frames that could not be read."""
KIND = Parameter(metavar="FORMAT")
if TYPE_CHECKING:
    from saccade.diagnostics.findings import Finding

    LogKind: TypeAlias = str
    DriveKind: TypeAlias = str
    AnyKind: TypeAlias = str
else:  # names for help and completion, or module:function
    LogKind = Literal[*LOG_FORMATS] | str
    DriveKind = Literal[*DRIVE_FORMATS] | str
    AnyKind = Literal[*dict.fromkeys([*DRIVE_FORMATS, *LOG_FORMATS])] | str


@dataclass(frozen=True, kw_only=True)
class TagOptions(Options):
    """Tags in the images of a camera drive."""

    tags: Annotated[str | None, INPUT, Parameter(metavar="FAMILY")] = None
    """Family of tags in the images of a camera drive that are landmarks, such as tag36h11."""
    tag_size: Annotated[str | None, INPUT, Parameter(metavar="METERS")] = None
    """Side of the black square of the tags, or a list by ids such as 0-13=0.165,20=0.3."""

    @property
    def tag_config(self) -> TagConfig | None:
        """Family and size; None without --tags."""
        if self.tags is None:
            require(self.tag_size is None, "--tag-size", "--tags FAMILY with it", "none")
            return None
        expected = "the side of the black square in meters, such as 0.165"
        require(self.tag_size is not None, "--tag-size", expected, "none")
        return TagConfig(self.tags, parse_sizes(self.tag_size or ""))


class TagRide(NamedTuple):
    """The tags of a camera drive."""

    drive: Drive
    """The drive."""
    tags: TagLog
    """Tags as a landmark log."""
    config: TagConfig
    """Family and size."""

    def image_at(self, pose: int) -> Image | None:
        """The image at a pose of the log; None if there is none."""
        number = int(self.tags.frame[pose])
        try:
            return None if number < 0 else self.drive.load(number).image
        except ImageError:
            return None

    def findings(self, survey: LandmarkMap | None) -> "tuple[Finding, ...]":
        """Findings on tag size and camera, by the surveyed tags or the odometry."""
        from saccade.diagnostics.tag_calibration import check_tags

        size = self.config.size
        one = size if isinstance(size, float) else None
        return check_tags(self.tags.log, self.tags.axis, one, survey)


@dataclass(frozen=True, kw_only=True)
class LogOptions(TagOptions):
    """Options for reading a landmark log."""

    kind: Annotated[LogKind | None, INPUT, KIND] = None
    """Format of LOG, or module:function that reads it; detected by default."""
    intrinsics: Annotated[str | None, INPUT, Parameter(metavar="FX,FY,CX,CY")] = None
    """Intrinsic parameters of the camera in pixels, for images without a calibration."""
    also: Annotated[list[Path] | None, INPUT, SEVERAL, Parameter(metavar="DRIVE")] = None
    """With --tags: drives of further cameras on the robot on the same clock, each with its
    camera.toml; several with commas."""
    robot: Annotated[int | None, INPUT] = setting(None, 1)
    """Number of the robot, from 1, in a log of several robots."""
    topic: Annotated[list[str] | None, INPUT, SEVERAL, Parameter(metavar="TOPIC")] = None
    """Landmark topics in a ROS bag, separated by commas for several cameras; by default chosen by
    message type."""
    sensor: Annotated[str | None, INPUT, Parameter(metavar="X,Y,YAW")] = None
    """Pose of the sensor in the robot frame: meters forward and left, and radians."""

    def load(self, log: Path) -> LandmarkLog:
        """The log; of the tags in the images with --tags.

        Raises:
            LogError, DriveError: the recording cannot be read.
            ConfigError: an option that does not apply.
        """
        if self.tag_config is not None:
            return self.load_ride(log).tags.log
        for option, value in (("--intrinsics", self.intrinsics), ("--also", self.also)):
            require(value is None, option, "--tags with it", value)
        sensor = None if self.sensor is None else parse_pose("--sensor", self.sensor, "X,Y,YAW")
        kind = self.kind or "auto"
        return load(kind, log, robot=self.robot, topic=self.topic, sensor=sensor)

    def load_ride(self, path: Path) -> TagRide:
        """A camera drive with its tags; prints remarks."""
        config = self.tag_config
        assert config is not None
        for option in ("robot", "topic", "sensor"):
            value = getattr(self, option)
            require(value is None, f"--{option}", "none with --tags", value)
        camera = CameraOptions(parse_intrinsics(self.intrinsics))
        drive = load_drive(self.kind or "auto", path, camera)
        others = [load_drive("auto", each) for each in self.also or ()]
        with progress_bar("tags", len(drive)) as update:
            found = observe_tags(drive, config, update, others)
        for remark in (*drive.remarks, *drive.assumptions, *found.remarks[:MAX_REMARKS]):
            print_message(remark)
        return TagRide(drive, found, config)


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

    kind: Annotated[DriveKind | None, INPUT, KIND] = None
    """Layout of SEQUENCE, or module:function that reads it; detected by default."""
    intrinsics: Annotated[str | None, INPUT, Parameter(metavar="FX,FY,CX,CY")] = None
    """Intrinsic parameters of the camera in pixels, for images without a calibration."""
    baseline: Annotated[float | None, INPUT, Parameter(metavar="METERS")] = setting(None, 1e-6)
    """Distance between the cameras of a stereo pair without a calibration."""

    def calibration(self) -> CameraOptions:
        """Calibration given on the command line, for a drive that has none."""
        return CameraOptions(parse_intrinsics(self.intrinsics), self.baseline)

    def load_drive(self, sequence: Path) -> Drive:
        """The drive."""
        return load_drive(self.kind or "auto", sequence, self.calibration())
