"""Active vision: attention, interest points, and EKF-SLAM.

Saliency models predict where people look, interest points are detected and matched, and EKF-SLAM
maps landmarks.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

from saccade.pictured import Pictured

__version__ = "0.1.0"

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_IMPORTS = [node for node in ast.parse(_STUB).body if isinstance(node, ast.ImportFrom)]
_MODULE_OF = {name.name: node.module for node in _IMPORTS for name in node.names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used: `import saccade` stays light."""
    module = _MODULE_OF.get(name)
    if module is None:
        raise AttributeError(f"module 'saccade' has no attribute {name!r}")
    is_package = module == __name__
    value = (
        import_module(f"{module}.{name}") if is_package else getattr(import_module(module), name)
    )
    globals()[name] = value
    return value


def _draw(result: Any) -> str:
    """Draws a result; the drawing library is loaded with the first picture."""
    html: str = import_module("saccade.pictures").result_html(result)
    return html


Pictured.to_html = staticmethod(_draw)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
