"""Optional dependencies: import, and the command that installs them."""

import json
import shlex
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import PackageNotFoundError, distribution
from pkgutil import resolve_name
from typing import Any

from saccade.errors import ConfigError


def import_optional(library: str, extra: str) -> Any:
    """Import a library of an extra of this package.

    Args:
        library: name of the module.
        extra: that installs it.

    Raises:
        ConfigError: it is not installed; the message has the command that installs it.
    """
    try:
        return import_module(library)
    except ImportError as error:
        raise ConfigError(
            f"{extra}: needs {library}, which is not installed; {install_command(extra)}"
        ) from error


def install_command(extra: str) -> str:
    """The shell command that installs an extra.

    This is `uv sync` in a clone (an editable installation, or none). Elsewhere pip installs the
    requirements by their own names: `saccade` on PyPI is another project.
    """
    try:
        package = distribution("saccade")
        origin = json.loads(package.read_text("direct_url.json") or "{}")  # PEP 610
        editable = origin.get("dir_info", {}).get("editable", False)
    except PackageNotFoundError:
        editable = True
    if editable:
        return f"uv sync --extra {extra}"
    lines = (line.partition(";") for line in package.requires or ())
    required = (name.strip() for name, _, marker in lines if f"'{extra}'" in marker)
    return f"pip install {shlex.join(required)}"


def import_function(what: str, name: str) -> Callable[..., Any]:
    """The function at module:function.

    Raises:
        ConfigError: there is no such function; the message begins with `what`.
    """
    try:
        found = resolve_name(name)
    except Exception as error:  # whatever the module raises
        raise ConfigError(f"{what}: {name}: cannot be imported: {error}") from error
    if not callable(found):
        raise ConfigError(f"{what}: {name}: expected a function, found {type(found).__name__}")
    function: Callable[..., Any] = found
    return function
