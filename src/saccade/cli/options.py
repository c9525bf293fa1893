"""Options that several commands share."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from typer import BadParameter

from saccade.cli.group import argument, option
from saccade.cli.output import print_message
from saccade.errors import ConfigError, require
from saccade.io.image import find_images
from saccade.settings import FREE_VIEWING, load_model, load_settings, preset_names

if TYPE_CHECKING:
    from saccade.attention.combined import FaceDetector
    from saccade.attention.models import AttentionModel
    from saccade.attention.scanpath import ScanpathConfig
    from saccade.datasets.drives.folder import CameraOptions as Calibration
    from saccade.frames import Drive
    from saccade.types import LandmarkLog

FILE_SUFFIXES = (
    *(".bmp", ".csv", ".db", ".eps", ".gif", ".h5", ".html", ".jpeg", ".jpg", ".json", ".mp4"),
    *(".npz", ".parquet", ".pdf", ".png", ".svg", ".tif", ".tiff", ".toml", ".txt", ".webp"),
)
"""Suffixes of an output that was meant as a file where a folder is written."""
FigureFormat = Literal["png", "svg", "pdf"]
"""File formats of figures."""
Egomotion = Literal["camera", "second-camera", "wheels"]


def figure_formats(formats: Iterable[str] | None) -> list[str]:
    """The formats of figures among those of --format; PNG where there is none."""
    known = get_args(FigureFormat)
    return [each for each in dict.fromkeys(formats or ()) if each in known] or ["png"]


def folder_name(path: Path | None) -> Path | None:
    """An output folder, whose name is not that of a file."""
    if path and path.suffix.lower() in FILE_SUFFIXES and not path.exists():
        raise BadParameter(f"expected a folder, found the name of a file: {path}")
    return path


def output_folder(name: str | None, **attributes: Any) -> Any:
    """The option of the folder for the results; `name` by default."""
    default = None if name is None else Path(name)
    attributes = {"help": "Output folder.", "metavar": "DIR"} | attributes
    return option(default, "--out", "-o", callback=folder_name, **attributes)


def _figures(paths: list[Path] | None) -> list[Path] | None:
    """Names of figures, each of a format that is drawn."""
    for path in paths or ():
        if path.suffix.lower().removeprefix(".") not in get_args(FigureFormat):
            raise BadParameter(f"expected a .png, .svg or .pdf, found {path}")
    return paths


def figure_files() -> Any:
    """The option of the files to which a figure is drawn."""
    words = "Also draw a figure: .png, .svg or .pdf; may be repeated."
    return option(None, metavar="FILE", help=words, callback=_figures)


@dataclass(frozen=True, kw_only=True)
class JsonOption:
    """How a result is printed."""

    as_json: bool = option(False, "--json")
    """Print the result as JSON."""


@dataclass(frozen=True, kw_only=True)
class ReportOptions(JsonOption):
    """How the tables of an evaluation are shown."""

    report: Path | None = None
    """Also write the tables as an HTML page."""


@dataclass(frozen=True, kw_only=True)
class SettingsOptions:
    """A configuration."""

    preset: str | None = option(None, "--preset", "-p")
    """Preset of the configuration; see saccade config KIND --all."""
    config: Path | None = option(None, "--config", "-c")
    """TOML file of settings, as printed by saccade config."""

    def settings(self, kind: str) -> Any:
        """The configuration of a kind."""
        return load_settings(kind, self.preset, self.config)


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """How a landmark log is read."""

    kind: str | None = option(None, "--format")
    """Format of LOG: csv, g2o, isam, mrclam, victoria-park or rosbag; detected by default."""
    robot: int | None = option(None, min=1)
    """Number of the robot, in a log of several robots."""
    topic: list[str] | None = option(None, "--topic", metavar="TOPIC")
    """Topic of landmarks in a ROS bag, of several cameras with commas; chosen by its type by
    default."""

    def load(self, log: Path) -> "LandmarkLog":
        """The log."""
        from saccade import datasets

        kind: Any = self.kind or "auto"
        return datasets.load(kind, log, robot=self.robot, topic=self.topic)


MAX_CAMERA_FRAMES = 36_000
"""Frames of a camera by default: twenty minutes at 30 a second."""


@dataclass(frozen=True, kw_only=True)
class LiveOptions:
    """A camera, and where its frames are shown."""

    camera: str | None = option(None, metavar="SOURCE")
    """Take the frames of a camera: a device (0), an address (rtsp://...) or a video file."""
    live: bool = False
    """Show the run in the rerun viewer (needs rerun-sdk)."""
    page: bool = False
    """Show it in rerun's viewer in the browser."""


@dataclass(frozen=True, kw_only=True)
class SourceOptions(LiveOptions):
    """Images and videos, or a camera."""

    images: list[str] | None = argument("IMAGE", None)
    """Images, videos, folders, or quoted patterns."""
    frames: int = option(MAX_CAMERA_FRAMES, min=2)
    """Of a camera take at most N frames."""

    def paths(self) -> list[Path]:
        """The images and videos; none with a camera.

        Raises:
            ConfigError: there are both, or neither.
        """
        if bool(self.images) == (self.camera is not None):
            found = "both" if self.images else "neither"
            raise ConfigError(f"IMAGE: expected images or --camera, found {found}")
        return [path for each in self.images or () for path in find_images(each)]


@dataclass(frozen=True, kw_only=True)
class SequenceOptions:
    """A camera drive, and what its files do not tell."""

    sequence: Path = argument("SEQUENCE")
    """Camera drive: a folder, video, bag or track file."""
    kind: str | None = option(None, "--format")
    """Format of SEQUENCE: kitti, tum-rgbd, rosbag, tracks, folder or video; detected by
    default."""
    intrinsics: str | None = option(None, metavar="FX,FY,CX,CY")
    """Camera of images without a calibration, in pixels."""
    baseline: float | None = option(None, min=1e-6)
    """Metres between the cameras of such a stereo pair."""

    def calibration(self) -> "Calibration":
        """The camera where the drive tells of none."""
        from saccade.datasets.drives.folder import CameraOptions, parse_intrinsics

        return CameraOptions(parse_intrinsics(self.intrinsics), self.baseline)

    def load(self) -> "Drive":
        """The drive."""
        from saccade.datasets import load_drive

        kind: Any = self.kind or "auto"
        return load_drive(kind, self.sequence, self.calibration())


DEFAULT_MODEL = "attention"
MODELS = "attention, contrast, symmetry, boolean, or a file of saccade fit (.toml)"
CARRIED = "auto"
"""Value of --faces for what OpenCV carries."""
PUBLISHED = ("kootstra2010", "itti1998", "saliencytoolbox2")
"""Presets whose scanpath is that of the winner-take-all network."""


@dataclass(frozen=True, kw_only=True)
class FaceOptions(SettingsOptions):
    """A configuration of saliency, and a detector of faces."""

    faces: str | None = option(None, metavar="FILE")
    """Also weigh faces, by this detector of OpenCV's (YuNet's .onnx, a cascade's .xml), or auto for
    what OpenCV carries; for the attention model and fitted ones."""


@dataclass(frozen=True, kw_only=True)
class ModelOptions(SettingsOptions):
    """A model of saliency."""

    model: str = option(DEFAULT_MODEL, metavar="MODEL", help=f"Saliency model: {MODELS}.")


def attention_model(
    model: str,
    preset: str | None = None,
    config: Path | None = None,
    *,
    faces: str | None = None,
    free_viewing: bool = False,
) -> "AttentionModel":
    """The model with the settings of the command line.

    Args:
        model: name or file.
        preset: name of a preset, or None.
        config: file of settings, or None.
        faces: detector of faces, or None.
        free_viewing: whether the default of the attention model is its preset of that name.

    Raises:
        ConfigError: no such model, preset, setting or detector of faces.
    """
    from saccade.attention.models import MODEL_NAMES, AttentionModel

    detector = face_detector(faces)
    if model.endswith(".toml"):
        given = preset or config
        require(given is None, "model", "no --preset and --config with a fitted model", given)
        return AttentionModel(load_model(model), detector)
    require(model in MODEL_NAMES, "model", MODELS, model)
    usable = faces is None or model == DEFAULT_MODEL
    require(usable, "faces", "--model attention or a fitted one", model)
    if free_viewing and model == DEFAULT_MODEL:
        preset = preset or FREE_VIEWING
    settings = load_settings(model, preset, config)
    return AttentionModel(settings, detector)


def face_detector(faces: str | None) -> "FaceDetector | None":
    """The detector that --faces names; None, with a remark, if OpenCV carries none."""
    if faces is None:
        return None
    from saccade.face_detection import find_face_detector

    detector = find_face_detector(None if faces == CARRIED else Path(faces))
    if detector is None:
        print_message("faces: OpenCV carries no detector here; faces are left out")
    return detector


def scanpath_network(preset: str | None) -> "ScanpathConfig":
    """The winner-take-all network of a model's preset: of the same source where there is one."""
    known = preset in preset_names("scanpath")
    network: ScanpathConfig = load_settings("scanpath", preset if known else None)
    return network
