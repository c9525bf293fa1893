"""Tables and figures of `saccade slam`."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from saccade.slam import SlamResult, SmoothResult
    from saccade.types import FloatArray, LandmarkLog, Trajectory


def write_tables(
    out: Path, log: "LandmarkLog", result: "SlamResult", smoothed: "SmoothResult | None"
) -> dict[str, Path]:
    """Write trajectory, landmarks and innovations; returns the files.

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
    """Each observation with its innovation, as columns; NaN where it was not used."""
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


def write_figures(
    out: Path, log: "LandmarkLog", result: "SlamResult", smoothed: "SmoothResult | None"
) -> dict[str, Path]:
    """Write figures of the map and of the innovations; returns the files."""
    from saccade.evaluation.slam_runs import has_headings
    from saccade.slam.consistency import chi_square_band
    from saccade.viewing import innovation_figure, map_figure, save_figure

    files = {"picture": out / "map.png", "innovation_picture": out / "innovations.png"}
    best = result if smoothed is None else smoothed
    save_figure(
        map_figure(
            best.trajectory,
            best.map,
            result.dead_reckoning,
            truth=log.truth if log.truth is not None and has_headings(log.truth) else None,
            landmark_truth=log.landmark_truth,
            filtered=None if smoothed is None else result.trajectory,
        ),
        files["picture"],
    )
    consistency, window = result.consistency, averaging_window(result.consistency.nis)
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


def averaging_window(nis: "FloatArray") -> int:
    """Number of observations in the running mean of the NIS (k,), NaN where one was not used."""
    import numpy as np

    used = int(np.isfinite(nis).sum())
    return int(np.clip(used // 50, 5, 500))
