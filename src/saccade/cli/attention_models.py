"""The attention model of a command: its options, and the model with its settings."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

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
