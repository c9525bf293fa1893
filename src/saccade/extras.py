"""Libraries that only some of the work needs."""

from importlib import import_module
from typing import Any

from saccade.errors import ConfigError


def import_optional(library: str, extra: str) -> Any:
    """A library that an extra of this package brings.

    Args:
        library: what to import.
        extra: what brings it.

    Raises:
        ConfigError: it is not installed; says how to install it.
    """
    try:
        return import_module(library)
    except ImportError as error:
        raise ConfigError(
            f"{extra}: needs {library}, which is not installed; pip install 'saccade[{extra}]'"
        ) from error
