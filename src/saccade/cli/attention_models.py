"""The attention model of a command: its option, and the model with its settings."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

if TYPE_CHECKING:
    from saccade.attention.models import AttentionModel
    from saccade.attention.scanpath import ScanpathConfig


class Model(StrEnum):
    """Saliency models."""

    attention = "attention"
    contrast = "contrast"
    symmetry = "symmetry"
    boolean = "boolean"


ModelChoice = Annotated[Model, Option(help="Saliency model.")]


def attention_model(
    model: Model, preset: str | None, config: Path | None, *, keep_features: bool = False
) -> "AttentionModel":
    """The model with the settings of the command line."""
    from saccade.attention.models import KINDS, AttentionModel
    from saccade.settings import load_settings

    return AttentionModel(model, load_settings(KINDS[model], preset, config), keep_features)


def scanpath_network(preset: str | None) -> "ScanpathConfig":
    """The winner-take-all network of a model's preset: of the same source where there is one."""
    from saccade.settings import load_settings, preset_names

    known = preset in preset_names("scanpath")
    network: ScanpathConfig = load_settings("scanpath", preset if known else None)
    return network
