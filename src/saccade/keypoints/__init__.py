"""What to keep."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade.keypoints.matching import match
    from saccade.keypoints.must import Must
    from saccade.keypoints.must_config import MustConfig
    from saccade.keypoints.sift import Sift
    from saccade.keypoints.sift_config import SiftConfig
    from saccade.keypoints.symroid import SymRoid
    from saccade.keypoints.symroid_config import SymRoidConfig
    from saccade.keypoints.verification import Verification, verify

_HOME_OF = {
    "Must": "must",
    "MustConfig": "must_config",
    "Sift": "sift",
    "SiftConfig": "sift_config",
    "SymRoid": "symroid",
    "SymRoidConfig": "symroid_config",
    "Verification": "verification",
    "match": "matching",
    "verify": "verification",
}

__all__ = [
    "Must",
    "MustConfig",
    "Sift",
    "SiftConfig",
    "SymRoid",
    "SymRoidConfig",
    "Verification",
    "match",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Load a detector when it is first used: one does not wait for the libraries of the others."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'saccade.keypoints' has no attribute {name!r}")
    value = getattr(import_module(f"saccade.keypoints.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value
