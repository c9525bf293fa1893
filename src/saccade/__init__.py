"""Active vision: attention, interest points, and EKF-SLAM.

Saliency models predict where people look, interest points are detected and matched, and EKF-SLAM
maps landmarks.
"""

from importlib import import_module
from typing import Any

from saccade.lazy import lazy_names
from saccade.pictured import Pictured

__version__ = "0.1.0"

__all__, __getattr__ = lazy_names(__name__, __file__)


def _draw(result: Any) -> str:
    """Draws a result; the drawing library is loaded with the first picture."""
    html: str = import_module("saccade.pictures").result_html(result)
    return html


Pictured.to_html = staticmethod(_draw)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
