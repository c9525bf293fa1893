"""Libraries that only some of the work needs."""

from importlib import import_module
from typing import Any

from saccade.errors import ConfigError


def extra(module: str, name: str) -> Any:
    """Import a library that an extra of this package brings.

    Args:
        module: what to import.
        name: the extra that brings it.

    Raises:
        ConfigError: it is not installed; says how to install it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise ConfigError(
            f"{module}: expected to be installed, found that it is not; "
            f"pip install 'saccade[{name}]'"
        ) from error
