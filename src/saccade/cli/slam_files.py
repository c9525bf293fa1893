"""What `saccade slam` writes."""

from collections.abc import Callable
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from saccade.slam import SlamResult, SmoothResult
    from saccade.types import FloatArray, LandmarkLog, LandmarkMap, MapSnapshot, Trajectory

FILM_RATE = 24
"""Frames per second."""
NEAREST = 0.9
"""Share of the places by GPS that count: the others may be reflections."""


def write_tables(
    out: Path, log: "LandmarkLog", result: "SlamResult", smoothed: "SmoothResult | None"
) -> dict[str, Path]:
    """Trajectory, landmarks and innovations; returns where each is.

    The tables are CSV, and Parquet too where pyarrow is installed.
    """
    from saccade.datasets import write_landmarks, write_table, write_tum

    best = result if smoothed is None else smoothed
    files = {
        "trajectory": out / "trajectory.tum",
        "landmarks": out / "landmarks.csv",
    }
    write_tum(files["trajectory"], best.trajectory)
    write_landmarks(files["landmarks"], best.map)
    if smoothed is not None:
        files["filter"] = out / "filter.tum"
        write_tum(files["filter"], result.trajectory)
    tables = {"poses": pose_table(best.trajectory), "innovations": innovation_table(log, result)}
    for name, table in tables.items():
        for kind in ("csv", "parquet") if find_spec("pyarrow") else ("csv",):
            files[name if kind == "csv" else f"{name}_{kind}"] = out / f"{name}.{kind}"
            write_table(out / f"{name}.{kind}", table)
    return files


def pose_table(trajectory: "Trajectory") -> dict[str, "np.ndarray[Any, Any]"]:
    """Each pose with its covariance, as columns."""
    from saccade.datasets import symmetric_columns

    axes = ("x", "y", "heading")
    columns = {"time": trajectory.time}
    columns |= dict(zip(axes, trajectory.pose.T, strict=True))
    if trajectory.covariance is not None:
        columns |= symmetric_columns(axes, trajectory.covariance)
    return columns


def innovation_table(log: "LandmarkLog", result: "SlamResult") -> dict[str, "np.ndarray[Any, Any]"]:
    """Each observation with its innovation, as columns; NaN where it corrected nothing."""
    import numpy as np

    from saccade.datasets import symmetric_columns

    used = result.association >= 0
    landmark = np.full(len(used), -1)
    landmark[used] = result.map.id[result.association[used]]
    return {
        "pose": log.observation_pose,
        "time": log.time[log.observation_pose],
        "landmark": landmark,
        "range": log.observation[:, 0],
        "bearing": log.observation[:, 1],
        "innovation_1": result.innovation[:, 0],
        "innovation_2": result.innovation[:, 1],
        **symmetric_columns(("1", "2"), result.innovation_covariance),
        "nis": result.consistency.nis,
    }


def write_pictures(
    out: Path, log: "LandmarkLog", result: "SlamResult", smoothed: "SmoothResult | None"
) -> dict[str, Path]:
    """The map and the innovations; returns where each is."""
    from saccade.slam.consistency import chi_square_band
    from saccade.viewing import innovation_figure, map_figure, save_figure

    files = {"picture": out / "map.png", "innovation_picture": out / "innovations.png"}
    best = result if smoothed is None else smoothed
    save_figure(
        map_figure(
            best.trajectory,
            best.map,
            result.dead_reckoning,
            truth=log.truth if is_in_frame(log.truth) else None,
            landmark_truth=log.landmark_truth,
            filtered=None if smoothed is None else result.trajectory,
        ),
        files["picture"],
    )
    consistency, window = result.consistency, window_of(result.consistency.nis)
    save_figure(
        innovation_figure(
            log.time[log.observation_pose],
            consistency.nis,
            consistency.dof,
            window,
            chi_square_band(consistency.dof, window),
            result.trajectory,
        ),
        files["innovation_picture"],
    )
    return files


def window_of(nis: "FloatArray") -> int:
    """Observations in the running mean of what a filter says of itself.

    Args:
        nis: of each, NaN where it corrected nothing.
    """
    import numpy as np

    corrected = int(np.isfinite(nis).sum())
    return int(np.clip(corrected // 50, 5, 500))


def write_film(
    path: Path,
    snapshots: "list[MapSnapshot]",
    log: "LandmarkLog",
    result: "SlamResult",
    progress: Callable[[int, int], None],
) -> Path:
    """The map while it grows, as an MP4."""
    from saccade.video import video_writer
    from saccade.viewing import map_frames

    with video_writer(path, FILM_RATE) as write:
        for number, frame in enumerate(map_frames(snapshots, log.time, result.dead_reckoning)):
            write(frame)
            progress(min(number + 1, len(snapshots)), len(snapshots))
    return path


def summary(
    log: "LandmarkLog", result: "SlamResult", smoothed: "SmoothResult | None"
) -> dict[str, Any]:
    """What a run says of itself in numbers; distances from the truth where that is known."""
    low, high = result.consistency.band
    row: dict[str, Any] = {
        "log": log.name,
        "poses": len(result.trajectory),
        "observations": len(log.observation),
        "observations_used": int((result.association >= 0).sum()),
        "landmarks": len(result.map),
        "landmarks_dropped": result.removed,
        **_odometry_end(log, result),
        "odometry_bias": _bias(result),
        "nis_mean": finite(result.consistency.mean),
        "nis_band": [low, high],
        "warning": result.consistency.warning,
        "remark": result.consistency.remark,
    }
    drives = {"odometry": result.dead_reckoning, "position": result.trajectory}
    maps = {"landmark": result.map}
    if smoothed is not None:
        row["smoothing_iterations"] = smoothed.iterations
        drives["smoothed_position"] = smoothed.trajectory
        maps["smoothed_landmark"] = smoothed.map
    return row | _distances(log, drives, maps)


def _odometry_end(log: "LandmarkLog", result: "SlamResult") -> dict[str, float]:
    """How far odometry alone ends from the truth, or, without one, from the filter's estimate."""
    import numpy as np

    reckoned, other, name = result.dead_reckoning, result.trajectory, "odometry_end_from_estimate_m"
    if log.truth is not None and is_in_frame(log.truth):
        other, name = log.truth, "odometry_end_error_m"
    end = np.array([min(reckoned.time[-1], other.time[-1])])
    return {name: float(np.hypot(*(reckoned.at(end) - other.at(end))[0, :2]))}


def _bias(result: "SlamResult") -> dict[str, float] | None:
    """What the odometry turned out to be off by; None where that is no part of the state."""
    if result.odometry_bias is None:
        return None
    names = ("share_of_way", "turn_rad_per_m", "way_m_per_rad")
    return dict(zip(names, result.odometry_bias.tolist(), strict=True))


def finite(value: float) -> float | None:
    """A number, or None where there is none: JSON has no NaN."""
    return value if isfinite(value) else None


def _distances(
    log: "LandmarkLog", drives: dict[str, "Trajectory"], maps: dict[str, "LandmarkMap"]
) -> dict[str, float | None]:
    from saccade.evaluation.trajectory import landmark_rmse, position_rmse

    found: dict[str, float] = {}
    if log.truth is not None:
        exact = is_in_frame(log.truth)
        ending = "rmse_m" if exact else "gps_rmse_m"
        for name, drive in drives.items():
            rmse = position_rmse(drive, log.truth, keep=1.0 if exact else NEAREST)
            found[f"{name}_{ending}"] = rmse
    if log.landmark_truth is not None:
        for name, landmarks in maps.items():
            found[f"{name}_rmse_m"] = landmark_rmse(landmarks, log.landmark_truth)
    return {name: finite(value) for name, value in found.items()}


def is_in_frame(truth: "Trajectory | None") -> bool:
    """Whether a truth has headings: what has none, as GPS, is not in the frame of the log."""
    return truth is not None and bool(isfinite(truth.pose[:, 2].sum()))
