"""Arguments and options that several commands share."""

from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, BadParameter, Option
from typer.core import TyperCommand, TyperOption

FILE_SUFFIXES = (
    *(".bmp", ".csv", ".db", ".eps", ".gif", ".h5", ".html", ".jpeg", ".jpg", ".json", ".mp4"),
    *(".npz", ".parquet", ".pdf", ".png", ".svg", ".tif", ".tiff", ".toml", ".txt", ".webp"),
)
"""Of an output that was meant as a file where a folder is written."""


class Command(TyperCommand):
    """A command whose options for several values take commas too, and others a single value."""

    def make_parser(self, ctx: Any) -> Any:
        """The parser of the arguments."""
        parser: Any = super().make_parser(ctx)
        parse = parser.parse_args

        def parse_lists(args: list[str]) -> Any:
            values, rest, order = parse(args)
            for param in dict.fromkeys(order):
                if not isinstance(param, TyperOption) or param.is_flag:
                    continue
                if not param.multiple and order.count(param) > 1:
                    raise BadParameter("expected a single value, found several", ctx, param)
                if param.multiple and param.metavar != "FILE":
                    given = values[param.name]
                    values[param.name] = [part for text in given for part in _parts(text)]
            return values, rest, order

        parser.parse_args = parse_lists
        return parser


def _parts(text: str) -> list[str]:
    """Values between commas; commas may be in the name of a file."""
    is_path = Path(text.partition("=")[2] or text).exists()
    return [text] if is_path else [part.strip() for part in text.split(",")]


class FigureFormat(StrEnum):
    """File formats of figures."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


def figure_formats(formats: Iterable[str] | None) -> list[str]:
    """The formats of figures among those of --format; PNG where there is none."""
    return [each for each in dict.fromkeys(formats or ()) if each in tuple(FigureFormat)] or ["png"]


class Detector(StrEnum):
    """Keypoint detectors."""

    SIFT = "sift"
    MUST = "must"
    SYMROID = "symroid"


DetectorOption = Annotated[
    Detector,
    Option("--detector", help="SIFT, points of symmetry (must), or regions of symmetry (symroid)."),
]
LogPath = Annotated[Path, Argument(metavar="LOG", help="Landmark log: a file, folder or ROS bag.")]
SequencePath = Annotated[
    Path, Argument(metavar="SEQUENCE", help="Camera drive: a folder, video, bag or track file.")
]
Intrinsics = Annotated[
    str | None,
    Option(metavar="FX,FY,CX,CY", help="Camera of images without a calibration, in pixels."),
]
Baseline = Annotated[
    float | None, Option(min=1e-6, help="Metres between the cameras of such a stereo pair.")
]


def _folder(path: Path) -> Path:
    """An output folder, whose name is not that of a file."""
    if path.suffix.lower() in FILE_SUFFIXES and not path.exists():
        raise BadParameter(f"expected a folder, found the name of a file: {path}")
    return path


def _figures(paths: list[Path] | None) -> list[Path] | None:
    """Names of figures, each of a format that is drawn."""
    for path in paths or ():
        if path.suffix.lower().removeprefix(".") not in tuple(FigureFormat):
            raise BadParameter(f"expected a .png, .svg or .pdf, found {path}")
    return paths


Out = Annotated[Path, Option("--out", "-o", help="Output folder.", callback=_folder)]
Json = Annotated[bool, Option("--json", help="Print the result as JSON.")]
Preset = Annotated[
    str | None,
    Option("--preset", "-p", help="Preset of the configuration; see saccade config KIND --all."),
]
Config = Annotated[
    Path | None,
    Option("--config", "-c", help="TOML file of settings, as printed by saccade config."),
]
Report = Annotated[
    Path | None, Option("--report", metavar="FILE", help="Also write the tables as an HTML page.")
]
FigureFormats = Annotated[
    list[FigureFormat] | None,
    Option("--figure-format", help="Format of the figures, png by default; several with commas."),
]
"""Where --format is that of the input; elsewhere --format names those of figures too."""
FigureFiles = Annotated[
    list[Path] | None,
    Option(
        metavar="FILE",
        help="Also draw a figure: .png, .svg or .pdf; may be repeated.",
        callback=_figures,
    ),
]
OnlyPresent = Annotated[
    bool, Option("--only-present", help="Leave out the fixations on images that are not there.")
]
Fixations = Annotated[
    Path,
    Option(
        help="Fixations: a table of image, viewer, index or time, x and y (.csv, .tsv, Tobii's "
        "export), EyeLink's .asc, OSIE's .mat, or a folder of them.",
    ),
]
Columns = Annotated[
    str | None,
    Option(
        metavar="KEY=NAME,...",
        help="Columns of other than the usual names: image, viewer, index, time, x, y, duration. "
        "viewer=code,x=gx",
    ),
]
PositionUnits = Annotated[
    str | None,
    Option(
        "--xy",
        metavar="UNIT",
        help="Units of x and y: normalized, WIDTH,HEIGHT (the size of the images on the screen), "
        "or pixels (of the images, unchecked).",
    ),
]
Offset = Annotated[
    str | None,
    Option(
        metavar="X,Y",
        help="Upper left corner of the images on the screen, where x and y are positions on it.",
    ),
]
DropFirst = Annotated[
    int,
    Option("--drop", min=0, metavar="N", help="Leave out the first N fixations of each scanpath."),
]
EgomotionName = Annotated[
    str,
    Option(
        "--egomotion",
        help="What measures the motion: camera, second-camera (a fixed one), or wheels.",
    ),
]
Seed = Annotated[int, Option(min=0, help="Seed of the random number generator.")]
MaxKeypoints = Annotated[
    int | None, Option("--max", min=1, metavar="N", help="Keep only the N strongest keypoints.")
]
Spread = Annotated[
    bool, Option("--spread", help="With --max: keep keypoints spread over the image.")
]
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
SequenceFormat = Annotated[
    str | None,
    Option(
        "--format",
        help="Format of SEQUENCE: kitti, tum-rgbd, euroc, rosbag, tracks, folder or video; "
        "detected by default.",
    ),
]
Camera = Annotated[
    str | None,
    Option(
        metavar="SOURCE",
        help="Take the frames of a camera: a device (0), an address (rtsp://...) or a video file.",
    ),
]
CameraFrames = Annotated[
    int, Option("--frames", min=2, metavar="N", help="Of a camera take at most N frames.")
]
LiveWindow = Annotated[
    bool, Option("--live", help="Show the run in the rerun viewer (needs rerun-sdk).")
]
LivePage = Annotated[bool, Option("--page", help="Show it in rerun's viewer in the browser.")]
MAX_CAMERA_FRAMES = 36_000
"""Frames of a camera by default: twenty minutes at 30 a second."""
Film = Annotated[bool, Option(help="Write a film of the growing map.")]
CheckpointInterval = Annotated[
    float,
    Option(
        "--checkpoint",
        min=0.0,
        metavar="SECONDS",
        help="Time between checkpoints, from which an interrupted run resumes.",
    ),
]


def images_or_camera(images: list[str] | None, camera: str | None) -> list[str]:
    """The images, if there is no camera.

    Raises:
        ConfigError: there are both, or neither.
    """
    from saccade.errors import ConfigError

    if bool(images) == (camera is not None):
        found = "both" if images else "neither"
        raise ConfigError(f"IMAGE: expected images or --camera, found {found}")
    return images or []
