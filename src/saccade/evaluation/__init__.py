"""Scores of saliency maps, keypoints, trajectories, maps and landmark selection."""

from importlib import import_module
from typing import Any

_METRICS = {
    "fixations": (
        *("auc", "correlation", "divergence", "fixation_density", "information_gain", "nss"),
        *("score", "shuffled_auc", "similarity"),
    ),
    "scanpaths": ("GazePath", "ScanMatchConfig", "scanmatch"),
    "trajectory": ("landmark_rmse", "position_rmse", "score_drive"),
    "features": ("corner_error", "mean_precision", "score_detector", "score_pair"),
}
_MODULE_OF = {name: module for module, names in _METRICS.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """Load a metric when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'saccade.evaluation' has no attribute {name!r}")
    return getattr(import_module(f"saccade.evaluation.{_MODULE_OF[name]}"), name)
