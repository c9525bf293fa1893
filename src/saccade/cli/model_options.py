"""Options for a saliency model, shared by the commands that compute saliency."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from saccade.attention.models import MODELS, AttentionModel
from saccade.cli.options import SettingsOptions
from saccade.errors import require
from saccade.extras import import_function
from saccade.settings import FREE_VIEWING, load_settings, preset_names

if TYPE_CHECKING:
    from saccade.attention.scanpath import ScanpathConfig

DEFAULT_MODEL = "attention"
NAMED = f"{', '.join(MODELS)}; a file of saccade fit (.toml); or module:function"
PUBLISHED = ("kootstra2010", "itti1998", "saliencytoolbox2")
"""Presets whose scanpath comes from the winner-take-all network."""


@dataclass(frozen=True, kw_only=True)
class SaliencyOptions(SettingsOptions):
    """Settings of saliency models."""

    def attention_model(
        self, model: str, preset: str | None = None, *, free_viewing: bool = False
    ) -> AttentionModel:
        """The saliency model with these settings.

        Args:
            model: name, file of a fitted model, or module:function.
            preset: preset that overrides --preset.
            free_viewing: whether the attention model defaults to the preset free_viewing.

        Raises:
            ConfigError: unknown model, preset, setting or function.
        """
        preset = preset or self.preset
        if model.endswith(".toml"):
            return AttentionModel(self.fitted_model(model))
        if model not in MODELS and ":" in model:
            given = preset or self.config
            require(given is None, "model", "no --preset and --config with a function", given)
            return AttentionModel(import_function("model", model))
        require(model in MODELS, "model", f"one of {NAMED}", model)
        if free_viewing and model == DEFAULT_MODEL:
            preset = preset or FREE_VIEWING
        return AttentionModel(load_settings(model, preset, self.config))


@dataclass(frozen=True, kw_only=True)
class ModelOptions(SaliencyOptions):
    """A saliency model."""

    model: Annotated[str, Parameter(metavar="MODEL", help=f"Saliency model: {NAMED}.")] = (
        DEFAULT_MODEL
    )


def scanpath_network(preset: str | None) -> "ScanpathConfig":
    """Winner-take-all network for a model's preset, from the same source if it defines one."""
    known = preset in preset_names("scanpath")
    network: ScanpathConfig = load_settings("scanpath", preset if known else None)
    return network
