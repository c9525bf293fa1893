"""Optional dependencies and functions that users name."""

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
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
            f"{extra}: needs {library}, which is not installed; "
            f"pip install 'pysaccade[{extra}]', or in a clone: uv sync --extra {extra}"
        ) from error


def import_function(what: str, name: str) -> Callable[..., Any]:
    """The function at module:function; the module may lie in the current folder.

    Raises:
        ConfigError: there is no such function; the message begins with `what`.
    """
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)  # also for the workers that this process starts
    try:
        found = resolve_name(name)
    except Exception as error:  # whatever the module raises
        raise ConfigError(f"{what}: {name}: cannot be imported: {error}") from error
    if not callable(found) and not hasattr(found, "log_density"):
        raise ConfigError(f"{what}: {name}: expected a function, found {type(found).__name__}")
    function: Callable[..., Any] = found
    return function


def name_of(function: str | Callable[..., Any]) -> str:
    """The name of a function as module:function, or the name given."""
    if isinstance(function, str):
        return function
    kind = function if hasattr(function, "__qualname__") else type(function)
    return f"{kind.__module__}:{kind.__qualname__}"
