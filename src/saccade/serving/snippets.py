"""What was set on the page of `saccade serve`, in Python and as a command."""

import shlex
from dataclasses import is_dataclass
from typing import Any

from saccade.attention.models import KINDS
from saccade.serving.controls import changes
from saccade.settings import NONE

CALLS = {
    "both": "attention_saliency",
    "contrast": "contrast_saliency",
    "symmetry": "symmetry_saliency",
}
FIXATIONS = 10
"""Of a scanpath that is not told otherwise."""
CLASSES = {"sift": "Sift", "must": "Must", "symroid": "SymRoid"}


def read_python(name: str) -> str:
    """The lines that read a photograph."""
    return f"import saccade\n\nimage = saccade.read_image({name!r})"


def attention_python(model: str, settings: Any, path: Any, fixations: int) -> str:
    """The lines that look at it."""
    more = f", fixations={fixations}" if fixations != FIXATIONS else ""
    if changes(path):
        more += f", config={_constructed(path)}"
    return (
        f"maps = saccade.{CALLS[model]}(image{_argument(settings)})\n"
        f"path = saccade.scanpath(maps.saliency, image.shape{more})"
    )


def detection_python(detector: str, settings: Any) -> str:
    """The lines that find its interest points."""
    inside = _constructed(settings) if changes(settings) else ""
    return f"points = saccade.{CLASSES[detector]}({inside})(image)"


def attention_command(name: str, model: str, settings: Any, path: Any, fixations: int) -> str:
    """The command that looks at it."""
    words = f"--model {model}" if model != "both" else ""
    if fixations != FIXATIONS:
        words += f" --fixations {fixations}"
    command = _with_file("look", name, words.strip(), KINDS[model], settings)
    if changes(path):
        command = f"# the settings of the scanpath: in Python only\n{command}"
    return command


def detection_command(name: str, detector: str, settings: Any) -> str:
    """The command that finds its interest points."""
    words = "" if detector == "sift" else f"--detector {detector}"
    return _with_file("detect", name, words, detector, settings)


def _argument(settings: Any) -> str:
    return f", {_constructed(settings)}" if changes(settings) else ""


def _constructed(settings: Any) -> str:
    """A configuration as Python that makes it."""
    arguments = ", ".join(
        f"{name}={_constructed(value) if is_dataclass(value) else repr(value)}"
        for name, value in changes(settings).items()
    )
    return f"saccade.{type(settings).__name__}({arguments})"


def _table(settings: Any) -> dict[str, Any]:
    table = {}
    for name, value in changes(settings).items():
        table[name] = _table(value) if is_dataclass(value) else NONE if value is None else value
    return table


def _with_file(command: str, name: str, words: str, kind: str, settings: Any) -> str:
    """A command, after the file of settings that it needs."""
    import tomli_w

    photo = shlex.quote(f"./{name}" if name.startswith("-") else name)
    line = " ".join(word for word in ("saccade", command, photo, words) if word)
    table = _table(settings)
    if not table:
        return line
    return f"cat > {kind}.toml <<'END'\n{tomli_w.dumps(table)}END\n{line} --config {kind}.toml"
