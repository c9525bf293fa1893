"""`saccade evaluate trajectory`: errors of estimated trajectories against the truth."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isnan
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from saccade.cli.options import OUTPUT, FigureFiles, Options, ReportOptions
from saccade.cli.output import Result, print_message
from saccade.datasets import write_table
from saccade.datasets.drives.sidecar_files import read_tum_poses
from saccade.errors import LogError, require
from saccade.evaluation.trajectory import (
    PoseErrorConfig,
    PoseScores,
    coverage_remarks,
    none_if_nan,
    score_poses,
    statistics,
)
from saccade.io.files import as_text
from saccade.types import FloatArray
from saccade.viewing import save_figure
from saccade.viewing.evaluation import ComparedTrajectory, trajectory_figure
from saccade.viewing.page import Picture, figure_uri
from saccade.viewing.report import Table

LEAD = "Errors of estimated trajectories against the truth."
COLUMNS = ["", "RMSE", "mean", "median", "std", "min", "max"]
MEANING = (
    "ATE: distance from the true position at the same time, after rigid alignment of all positions "
    "(aligned), after alignment of the first pose (first pose), and as it is (unaligned), which is "
    "right for an estimate in the frame of the truth. RPE: error of the motion from one pose to a "
    "later one. Segments: the same over 100 to 800 m of the true path, by its length, as in "
    "KITTI's benchmark. Definitions as in evo."
)


ERRORS = {
    "ate_aligned_m": ("ATE aligned [m]", "aligned.translation"),
    "ate_first_pose_m": ("ATE first pose [m]", "first_aligned.translation"),
    "ate_unaligned_m": ("ATE unaligned [m]", "unaligned.translation"),
    "rotation_aligned_deg": ("rotation aligned [deg]", "aligned.rotation"),
    "rotation_first_pose_deg": ("rotation first pose [deg]", "first_aligned.rotation"),
    "rotation_unaligned_deg": ("rotation unaligned [deg]", "unaligned.rotation"),
    "rpe_m": ("RPE translation [m]", "relative.translation"),
    "rpe_deg": ("RPE rotation [deg]", "relative.rotation"),
    "segments_percent": ("segments [%]", "segments.translation"),
    "segments_deg_per_100m": ("segments [deg / 100 m]", "segments.rotation"),
}
"""Errors in the JSON output: their names in tables, and where `PoseScores` has them."""


@dataclass(frozen=True)
class EstimateArguments(Options):
    """Estimated trajectories."""

    estimates: list[Path]
    """Estimated trajectories: TUM files."""


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions(ReportOptions, EstimateArguments):
    """Options of `saccade evaluate trajectory`."""

    truth: Path
    """True trajectory: a TUM file."""
    figure: FigureFiles = None
    csv: Annotated[Path | None, OUTPUT] = None
    """Also write the errors of each pose as CSV."""


def trajectory(
    options: TrajectoryOptions,
    *,
    config: Annotated[PoseErrorConfig, Parameter("*")] = PoseErrorConfig(),
) -> Result:
    """Score trajectories against the truth: absolute and relative errors (ATE, RPE).

    TUM files have lines of time x y z qx qy qz qw. A pose is compared with the
    true one nearest in time.

    Example: saccade evaluate trajectory mapped/trajectory.tum --truth groundtruth.tum
    """
    truth = options.truth
    true = read_tum_poses(truth)
    scores: dict[str, PoseScores] = {}
    for path in dict.fromkeys(options.estimates):
        try:
            scores[as_text(str(path))] = score_poses(read_tum_poses(path), true, config)
        except LogError as error:
            name = "" if str(error).startswith(str(path)) else f"{path}: "
            raise LogError(f"{name}{error}") from error
    if options.csv is not None:
        _write_csv(options.csv, scores)
    drawn = options.figure or options.report is not None
    report = [_drawn(scores, options.figure or [])] if drawn else []
    estimates_row = {name: _summary(each) for name, each in scores.items()}
    row = {"truth": str(truth), **asdict(config), "estimates": estimates_row}
    rows: list[list[str]] = []
    for name, each in scores.items():
        rows += [[name, *[""] * (len(COLUMNS) - 1)]] if len(scores) > 1 else []
        rows += _rows(each)
        for remark in coverage_remarks(len(each.estimate.time), each.poses):
            print_message(f"{name}: {remark}")
    title = f"against {truth}" if len(scores) > 1 else f"{next(iter(scores))} against {truth}"
    return Result(row, [Table(title, COLUMNS, rows)], lead=LEAD, report=report)


def _errors(scores: PoseScores) -> dict[str, FloatArray]:
    """The errors by their names in the JSON output."""
    return {name: attrgetter(path)(scores) for name, (_, path) in ERRORS.items()}


def _rows(scores: PoseScores) -> list[list[str]]:
    compared = [f"poses (of {scores.poses})", str(len(scores.estimate.time))]
    return [[*compared, *[""] * (len(COLUMNS) - 2)]] + [
        [ERRORS[key][0], *("" if isnan(x) else f"{x:.3f}" for x in statistics(errors))]
        for key, errors in _errors(scores).items()
        if len(errors)
    ]


def _summary(scores: PoseScores) -> dict[str, Any]:
    row: dict[str, Any] = {
        "poses": len(scores.estimate.time),
        "estimated_poses": scores.poses,
        "pairs": len(scores.first),
        "scale": scores.scale,
    }
    for key, errors in _errors(scores).items():
        found = statistics(errors)._asdict()
        row[key] = {each: none_if_nan(value) for each, value in found.items()}
    return row


def _write_csv(path: Path, scores: Mapping[str, PoseScores]) -> None:
    """One row for each pose of each estimate; the relative errors where their pair ends."""
    require(path.suffix == ".csv", "--csv", "a file that ends in .csv", str(path))
    parts: list[dict[str, np.ndarray[Any, Any]]] = []
    for name, each in scores.items():
        n = len(each.estimate.time)
        columns: dict[str, np.ndarray[Any, Any]] = {"estimate": np.full(n, name)}
        columns["time"] = each.estimate.time
        columns |= dict(zip("xyz", each.estimate.position.T, strict=True))
        columns |= {key: errors for key, errors in _errors(each).items() if "segments" not in key}
        for key, errors in zip(("rpe_m", "rpe_deg"), each.relative, strict=True):
            columns[key] = np.full(n, np.nan)
            columns[key][each.second] = errors
        parts.append(columns)
    write_table(path, {key: np.concatenate([part[key] for part in parts]) for key in parts[0]})


def _drawn(scores: Mapping[str, PoseScores], paths: Sequence[Path]) -> Table:
    """Write the figure of the trajectories; returns the table of the report that holds it."""
    figure = trajectory_figure(
        [
            ComparedTrajectory(
                name,
                each.estimate.time,
                each.estimate.position,
                each.truth.position,
                {"aligned": each.aligned.translation, "unaligned": each.unaligned.translation},
            )
            for name, each in scores.items()
        ]
    )
    for path in paths:
        save_figure(figure, path)
    picture = Picture(
        figure_uri(figure),
        "The trajectories from above, and their errors over time",
        "Aligned trajectories from above, and distances from the true positions over time.",
    )
    rows = [[f"{name}: {row[0]}", *row[1:]] for name, each in scores.items() for row in _rows(each)]
    return Table("Errors", COLUMNS, rows, MEANING, "estimate and error", [picture])
