"""Results as short tables in a notebook."""

from collections.abc import Mapping
from html import escape


class NotebookTable:
    """Base of results that notebooks show as a table of their sizes and key numbers."""

    def summary(self) -> Mapping[str, str]:
        """Sizes and key numbers, by name."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
            for name, value in self.summary().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"
