"""Maps of earlier runs, for `saccade slam --map`."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from saccade.errors import ConfigError
from saccade.slam import EkfConfig, Slam, SlamResult
from saccade.slam.run import motion_of
from saccade.slam.sessions import find_start
from saccade.types import FloatArray, LandmarkLog


@dataclass(frozen=True)
class Session:
    """The part of a run that concerns other runs."""

    slam: Slam | None = None
    """With the map that was loaded; None to begin one."""
    file: Path | None = None
    """From which it was loaded."""
    mode: str = "continue"
    start: str = "log"
    save: Path | None = None
    """Where the map is saved."""

    def figures(self, result: SlamResult) -> dict[str, Any]:
        """Figures of the session for run.json, after the run."""
        observations = result.map.observations
        if self.slam is None or result.session is None or observations is None:
            return {"map": None}
        session = len(self.slam.sessions) - 1
        loaded = result.session < session
        return {
            "map": str(self.file),
            "map_mode": self.mode,
            "map_start": self.start,
            "map_sessions": session,
            "map_landmarks": int(loaded.sum()),
            "map_landmarks_observed": int((observations[loaded] > 0).sum()),
            "map_landmarks_new": int((~loaded).sum()),
        }


def open_map(
    log: LandmarkLog,
    file: Path,
    mode: str,
    start: str | None,
    settings: EkfConfig | None,
    save: Path | None,
) -> Session:
    """Load a map for a log.

    Args:
        log: of the session.
        file: the map file.
        mode: "continue" or "localize".
        start: "last", "search", "log", three numbers, or None for the default of the mode.
        settings: None for those of the map.
        save: where the map will be saved.

    Raises:
        ConfigError, LogError: as `Slam.load` and `find_start`; or the start is something else.
    """
    start = start or ("search" if mode == "localize" else "last")
    if mode == "localize" and save is not None:
        raise ConfigError("--save-map: expected --mode continue, found localize")
    kind, motion = cast("Literal['continue', 'localize']", mode), motion_of(log, None)
    if start == "last":
        return Session(Slam.load(file, kind, settings, motion=motion), file, mode, start, save)
    load = partial(Slam.load, file, kind, settings, motion=motion, odometry_bias=log.odometry_bias)
    pose, covariance = _first_pose(load(start=log.start), log, start)
    return Session(load(start=pose, covariance=covariance), file, mode, start, save)


def _first_pose(slam: Slam, log: LandmarkLog, start: str) -> tuple[FloatArray, FloatArray | None]:
    """The first pose in the frame of the map, and its covariance; None for that of `Slam.load`."""
    if start == "search":
        return find_start(slam, log)
    if start == "log":
        return log.start, np.diag(np.square(slam.config.start_sigma))
    try:
        pose = np.array([float(number) for number in start.split(",")])
    except ValueError:
        pose = np.empty(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ConfigError(f"--start: expected last, search, log or X,Y,HEADING, found {start!r}")
    return pose, None
