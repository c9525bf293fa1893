"""The hook by which results show themselves in notebooks; drawing is set from above."""

from collections.abc import Callable
from typing import Any, ClassVar


class Pictured:
    """Base class of results with a picture in notebooks."""

    to_html: ClassVar[Callable[[Any], str] | None] = None
    """Draws a result as HTML; `saccade/__init__.py` sets it."""

    def _repr_html_(self) -> str | None:
        return None if Pictured.to_html is None else Pictured.to_html(self)
