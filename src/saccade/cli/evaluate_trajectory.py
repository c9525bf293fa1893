"""`saccade evaluate trajectory`: errors of estimated trajectories against the truth."""

from dataclasses import asdict, dataclass
from math import isnan
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from saccade.cli.options import JsonOptions, Options
from saccade.cli.output import Result, Table, print_message
from saccade.datasets.drives.sidecar_files import read_tum_poses
from saccade.errors import LogError
from saccade.evaluation.trajectory import (
    PoseErrorConfig,
    PoseScores,
    coverage_remarks,
    none_if_nan,
    score_poses,
    statistics,
)
from saccade.types import FloatArray

COLUMNS = ["", "RMSE", "mean", "median", "std", "min", "max"]
ERRORS = {
    "ate_aligned_m": ("ATE aligned [m]", "aligned.translation"),
    "ate_unaligned_m": ("ATE unaligned [m]", "unaligned.translation"),
    "rotation_aligned_deg": ("rotation aligned [deg]", "aligned.rotation"),
    "rotation_unaligned_deg": ("rotation unaligned [deg]", "unaligned.rotation"),
    "rpe_m": ("RPE translation [m]", "relative.translation"),
    "rpe_deg": ("RPE rotation [deg]", "relative.rotation"),
    "segments_percent": ("segments [%]", "segments.translation"),
    "segments_deg_per_100m": ("segments [deg / 100 m]", "segments.rotation"),
}
"""Errors in the JSON output: column titles, and attributes of `PoseScores`."""


@dataclass(frozen=True)
class EstimateArguments(Options):
    """Estimated trajectories."""

    estimates: list[Path]
    """Estimated trajectories: TUM files."""


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions(JsonOptions, EstimateArguments):
    """Options of `saccade evaluate trajectory`."""

    truth: Path
    """Ground-truth trajectory: a TUM file."""


def trajectory(
    options: TrajectoryOptions,
    *,
    config: Annotated[PoseErrorConfig, Parameter("*")] = PoseErrorConfig(),
) -> Result:
    """Score trajectories against ground truth: absolute and relative errors (ATE, RPE).

    TUM files have lines of time x y z qx qy qz qw. Each pose is compared with
    the true pose nearest in time.

    docs/evaluation.md defines the figures.

    Example: saccade evaluate trajectory mapped/trajectory.tum --truth groundtruth.tum
    """
    truth = options.truth
    true = read_tum_poses(truth)
    scores: dict[str, PoseScores] = {}
    for path in dict.fromkeys(options.estimates):
        try:
            scores[str(path)] = score_poses(read_tum_poses(path), true, config)
        except LogError as error:
            name = "" if str(error).startswith(str(path)) else f"{path}: "
            raise LogError(f"{name}{error}") from error
    rows: list[list[str]] = []
    for name, each in scores.items():
        rows += [[name, *[""] * (len(COLUMNS) - 1)]] if len(scores) > 1 else []
        rows += _rows(each)
        for remark in coverage_remarks(len(each.estimate.time), each.poses):
            print_message(f"{name}: {remark}")
    title = f"against {truth}" if len(scores) > 1 else f"{next(iter(scores))} against {truth}"
    estimates = {name: _summary(each) for name, each in scores.items()}
    row = {"truth": str(truth), **asdict(config), "estimates": estimates}
    return Result(row, [Table(title, COLUMNS, rows)])


def _errors(scores: PoseScores) -> dict[str, FloatArray]:
    """Errors by their names in the JSON output."""
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
        "scale": scores.scale,
    }
    for key, errors in _errors(scores).items():
        found = statistics(errors)._asdict()
        row[key] = {each: none_if_nan(value) for each, value in found.items()}
    return row
