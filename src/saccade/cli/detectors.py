"""The detectors of this package, with the settings of the command line."""

from pathlib import Path
from typing import Any


def make_detector(
    name: str,
    preset: str | None,
    config: Path | None,
    max_keypoints: int | None = None,
    *,
    spread: bool = False,
) -> Any:
    """A `Sift`, `Must` or `SymRoid`.

    Raises:
        ConfigError: a setting that the detector does not have.
    """
    from dataclasses import replace

    from saccade.errors import require
    from saccade.keypoints import Must, Sift, SymRoid
    from saccade.settings import load_settings

    settings = load_settings(name, preset, config)
    if max_keypoints is not None:
        settings = replace(settings, max_keypoints=max_keypoints)
    if spread:
        require(name != "symroid", "spread", "a detector of points", name)
        settings = replace(settings, spread=True)
    return {"sift": Sift, "must": Must, "symroid": SymRoid}[name](settings)
