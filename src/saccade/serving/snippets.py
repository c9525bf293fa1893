"""The settings of the page of `saccade serve` as Python and as a command."""

import shlex
from dataclasses import fields, is_dataclass
from typing import Any

import tomli_w

from saccade.attention.models import KINDS
from saccade.serving.controls import DETECTORS
from saccade.settings import FREE_VIEWING, NONE, load_settings

FIXATIONS = 10
"""Default length of a scanpath."""


def read_python(name: str) -> str:
    """The lines that read a photograph."""
    return f"import saccade\n\nimage = saccade.read_image({name!r})"


def attention_python(model: str, settings: Any, path: Any, fixations: int) -> str:
    """The lines that compute saliency and scanpath."""
    config = f", {_constructor(settings)}" if changes(settings) else ""
    options = f", fixations={fixations}" if fixations != FIXATIONS else ""
    if changes(path):
        options += f", config={_constructor(path)}"
    return (
        f"maps = saccade.{KINDS[model]}_saliency(image{config})\n"
        f"path = saccade.scanpath(maps.saliency, image.shape{options})"
    )


def detection_python(detector: str, settings: Any) -> str:
    """The line that detects interest points."""
    config = _constructor(settings) if changes(settings) else ""
    return f"points = saccade.{DETECTORS[detector]}({config})(image)"


def attention_command(name: str, model: str, settings: Any, path: Any, fixations: int) -> str:
    """The command that computes saliency and scanpath."""
    options = ["--model", model] if model != "attention" else []
    options += ["--fixations", str(fixations)] if fixations != FIXATIONS else []
    options += ["--scanpath", "winner-take-all"]
    default = type(settings)()
    if model == "attention" and settings == default:
        options += ["--bare"]
    elif model == "attention":
        default = load_settings(model, FREE_VIEWING)
    command = _command("look", name, options, KINDS[model], _toml_value(settings, default))
    if changes(path):
        command = f"# scanpath settings: in Python only\n{command}"
    return command


def detection_command(name: str, detector: str, settings: Any) -> str:
    """The command that detects interest points."""
    options = [] if detector == "sift" else ["--detector", detector]
    return _command("detect", name, options, detector, _toml_value(settings, type(settings)()))


def changes(settings: Any, default: Any = None) -> dict[str, Any]:
    """The settings of a configuration that differ from another, by default from their defaults."""
    default = type(settings)() if default is None else default
    values = ((each.name, getattr(settings, each.name)) for each in fields(settings))
    return {name: value for name, value in values if value != getattr(default, name)}


def _constructor(settings: Any) -> str:
    """A configuration as the Python expression that makes it."""
    arguments = ", ".join(
        f"{name}={_constructor(value) if is_dataclass(value) else repr(value)}"
        for name, value in changes(settings).items()
    )
    return f"saccade.{type(settings).__name__}({arguments})"


def _toml_value(value: Any, default: Any) -> Any:
    if is_dataclass(value):
        return {
            name: _toml_value(each, getattr(default, name, None))
            for name, each in changes(value, default).items()
        }
    return NONE if value is None else value


def _command(command: str, name: str, options: list[str], kind: str, table: dict[str, Any]) -> str:
    """A command, preceded by the file with the table of settings that it needs."""
    photo = shlex.quote(f"./{name}" if name.startswith("-") else name)
    line = " ".join(("saccade", command, photo, *options))
    if not table:
        return line
    return f"cat > {kind}.toml <<'END'\n{tomli_w.dumps(table)}END\n{line} --config {kind}.toml"
