"""Values in the requests of the page."""

from collections.abc import Iterable, Mapping
from typing import Any

from saccade.errors import require


def chosen(
    request: Mapping[str, Any], key: str, names: Iterable[str], default: str | None = None
) -> str:
    """The name that a request gives for a key, by default `default` or the first.

    Raises:
        ConfigError: another name, or no text.
    """
    known = list(names)
    name = request.get(key, default or known[0])
    require(name in known, key, f"one of {', '.join(known)}", name)
    return str(name)
