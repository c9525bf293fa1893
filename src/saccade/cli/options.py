"""Arguments and options that several commands share."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, BadParameter, Option

from saccade.errors import ConfigError

if TYPE_CHECKING:
    from saccade.cli.mapping import RunOutput
    from saccade.datasets.drives.folder import CameraOptions as Calibration
    from saccade.frames import Drive
    from saccade.viewing.report import Table

FILE_SUFFIXES = (
    *(".bmp", ".csv", ".db", ".eps", ".gif", ".h5", ".html", ".jpeg", ".jpg", ".json", ".mp4"),
    *(".npz", ".parquet", ".pdf", ".png", ".svg", ".tif", ".tiff", ".toml", ".txt", ".webp"),
)
"""Suffixes of an output that was meant as a file where a folder is written."""


class FigureFormat(StrEnum):
    """File formats of figures."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


def figure_formats(formats: Iterable[str] | None) -> list[str]:
    """The formats of figures among those of --format; PNG where there is none."""
    return [each for each in dict.fromkeys(formats or ()) if each in tuple(FigureFormat)] or ["png"]


LogPath = Annotated[
    Path | None, Argument(metavar="LOG", help="Landmark log: a file, folder or ROS bag.")
]


def folder_name(path: Path | None) -> Path | None:
    """An output folder, whose name is not that of a file."""
    if path and path.suffix.lower() in FILE_SUFFIXES and not path.exists():
        raise BadParameter(f"expected a folder, found the name of a file: {path}")
    return path


def _figures(paths: list[Path] | None) -> list[Path] | None:
    """Names of figures, each of a format that is drawn."""
    for path in paths or ():
        if path.suffix.lower().removeprefix(".") not in tuple(FigureFormat):
            raise BadParameter(f"expected a .png, .svg or .pdf, found {path}")
    return paths


Out = Annotated[Path, Option("--out", "-o", help="Output folder.", callback=folder_name)]
Json = Annotated[bool, Option("--json", help="Print the result as JSON.")]
Preset = Annotated[
    str | None,
    Option("--preset", "-p", help="Preset of the configuration; see saccade config KIND --all."),
]
Config = Annotated[
    Path | None,
    Option("--config", "-c", help="TOML file of settings, as printed by saccade config."),
]
FigureFiles = Annotated[
    list[Path] | None,
    Option(
        metavar="FILE",
        help="Also draw a figure: .png, .svg or .pdf; may be repeated.",
        callback=_figures,
    ),
]
Sigma = Annotated[
    float,
    Option(
        min=0.1,
        max=1000,
        metavar="PX",
        help="Standard deviation of the fixation density: one degree of visual angle.",
    ),
]
Seed = Annotated[int, Option(min=0, help="Seed of the random number generator.")]
LogFormat = Annotated[
    str | None,
    Option(
        "--format",
        help="Format of LOG: csv, g2o, isam, mrclam, victoria-park, dlr or rosbag; detected by "
        "default.",
    ),
]
Robot = Annotated[
    int | None, Option(min=1, help="Number of the robot, in a log of several robots.")
]
Topics = Annotated[
    list[str] | None,
    Option(
        "--topic",
        metavar="TOPIC",
        help="Topic of landmarks in a ROS bag, of several cameras with commas; chosen by its type "
        "by default.",
    ),
]
EgomotionName = Annotated[
    str,
    Option(
        "--egomotion",
        help="What measures the motion: camera, second-camera (a fixed one), or wheels.",
    ),
]
CameraSource = Annotated[
    str | None,
    Option(
        metavar="SOURCE",
        help="Take the frames of a camera: a device (0), an address (rtsp://...) or a video file.",
    ),
]
LivePage = Annotated[bool, Option("--page", help="Show it in rerun's viewer in the browser.")]
LiveWindow = Annotated[
    bool, Option("--live", help="Show the run in the rerun viewer (needs rerun-sdk).")
]
MAX_CAMERA_FRAMES = 36_000
"""Frames of a camera by default: twenty minutes at 30 a second."""


@dataclass(frozen=True)
class CameraOptions:
    """A camera of a command, and where its frames are shown."""

    camera: CameraSource = None
    frames: Annotated[
        int, Option("--frames", min=2, metavar="N", help="Of a camera take at most N frames.")
    ] = MAX_CAMERA_FRAMES
    live: LiveWindow = False
    page: LivePage = False

    def instead_of(self, images: list[str] | None) -> list[str]:
        """The images, if there is no camera.

        Raises:
            ConfigError: there are both, or neither.
        """
        if bool(images) == (self.camera is not None):
            found = "both" if images else "neither"
            raise ConfigError(f"IMAGE: expected images or --camera, found {found}")
        return images or []


@dataclass(frozen=True)
class SequenceOptions:
    """A camera drive, and what its files do not tell."""

    sequence: Annotated[
        Path, Argument(metavar="SEQUENCE", help="Camera drive: a folder, video, bag or track file.")
    ]
    kind: Annotated[
        str | None,
        Option(
            "--format",
            help="Format of SEQUENCE: kitti, tum-rgbd, euroc, rosbag, tracks, folder or video; "
            "detected by default.",
        ),
    ] = None
    intrinsics: Annotated[
        str | None,
        Option(metavar="FX,FY,CX,CY", help="Camera of images without a calibration, in pixels."),
    ] = None
    baseline: Annotated[
        float | None, Option(min=1e-6, help="Metres between the cameras of such a stereo pair.")
    ] = None

    def calibration(self) -> "Calibration":
        """The camera where the drive tells of none."""
        from saccade.datasets.drives.folder import CameraOptions, parse_intrinsics

        return CameraOptions(parse_intrinsics(self.intrinsics), self.baseline)

    def load(self) -> "Drive":
        """The drive."""
        from saccade.datasets import load_drive

        kind: Any = self.kind or "auto"
        return load_drive(kind, self.sequence, self.calibration())


@dataclass(frozen=True)
class RunOptions:
    """What a mapping run writes."""

    figures: Annotated[
        list[FigureFormat] | None,
        Option(
            "--figure-format", help="Format of the figures, png by default; several with commas."
        ),
    ] = None
    film: Annotated[bool, Option(help="Also write a film of the growing map.")] = False
    checkpoint: Annotated[
        float,
        Option(
            "--checkpoint",
            min=0.0,
            metavar="SECONDS",
            help="Time between checkpoints, from which an interrupted run resumes.",
        ),
    ] = 10.0

    def into(self, folder: Path) -> "RunOutput":
        """The output of a run."""
        from saccade.cli.mapping import RunOutput

        figures = figure_formats(self.figures)
        return RunOutput(folder, self.film, checkpoint_interval=self.checkpoint, figures=figures)


@dataclass(frozen=True)
class ReportOptions:
    """How the tables of an evaluation are shown."""

    report: Annotated[
        Path | None,
        Option("--report", metavar="FILE", help="Also write the tables as an HTML page."),
    ] = None
    as_json: Json = False

    def write(self, command: str, lead: str, tables: "Sequence[Table]") -> None:
        """Write the page, if there is to be one."""
        from saccade.viewing.report import write_tables

        write_tables(self.report, f"saccade {command}", lead, tables)


if TYPE_CHECKING:
    from saccade.attention.combined import FaceDetector
    from saccade.attention.models import AttentionModel
    from saccade.attention.scanpath import ScanpathConfig

DEFAULT_MODEL = "attention"
MODELS = "attention, contrast, symmetry, boolean, or a file of saccade fit (.toml)"
CARRIED = "auto"
"""Value of --faces for what OpenCV carries."""
PUBLISHED = ("kootstra2010", "itti1998", "saliencytoolbox2")
"""Presets whose scanpath is that of the winner-take-all network."""

ModelChoice = Annotated[str, Option(metavar="MODEL", help=f"Saliency model: {MODELS}.")]
Faces = Annotated[
    str | None,
    Option(
        metavar="FILE",
        help="Also weigh faces, by this detector of OpenCV's (YuNet's .onnx, a cascade's .xml), or "
        "auto for what OpenCV carries; for the attention model and fitted ones.",
    ),
]


def attention_model(
    model: str,
    preset: str | None,
    config: Path | None,
    *,
    keep_features: bool = False,
    faces: str | None = None,
    free_viewing: bool = False,
) -> "AttentionModel":
    """The model with the settings of the command line.

    Args:
        model: name or file.
        preset: name of a preset, or None.
        config: file of settings, or None.
        keep_features: whether the maps of contrast hold their feature maps.
        faces: detector of faces, or None.
        free_viewing: whether the default of the attention model is its preset of that name.

    Raises:
        ConfigError: no such model, preset, setting or detector of faces.
    """
    from saccade.attention.models import FITTED, KINDS, AttentionModel
    from saccade.errors import require
    from saccade.settings import FREE_VIEWING, load_model, load_settings

    detector = face_detector(faces)
    if model.endswith(".toml"):
        given = preset or config
        require(given is None, "model", "no --preset and --config with a fitted model", given)
        return AttentionModel(FITTED, load_model(model), faces=detector)
    require(model in KINDS, "model", MODELS, model)
    usable = faces is None or model == DEFAULT_MODEL
    require(usable, "faces", "--model attention or a fitted one", model)
    if free_viewing and model == DEFAULT_MODEL:
        preset = preset or FREE_VIEWING
    settings = load_settings(KINDS[model], preset, config)
    return AttentionModel(model, settings, keep_features, detector)


def face_detector(faces: str | None) -> "FaceDetector | None":
    """The detector that --faces names; None, with a remark, if OpenCV carries none."""
    if faces is None:
        return None
    from saccade.cli.output import print_message
    from saccade.face_detection import find_face_detector

    detector = find_face_detector(None if faces == CARRIED else Path(faces))
    if detector is None:
        print_message("faces: OpenCV carries no detector here; faces are left out")
    return detector


def scanpath_network(preset: str | None) -> "ScanpathConfig":
    """The winner-take-all network of a model's preset: of the same source where there is one."""
    from saccade.settings import load_settings, preset_names

    known = preset in preset_names("scanpath")
    network: ScanpathConfig = load_settings("scanpath", preset if known else None)
    return network
