"""Landmark logs as a folder of the UTIAS multi-robot kind; see `mrclam` for its reader."""

from pathlib import Path

import numpy as np

from saccade.datasets.logs.cartesian import to_relative_poses
from saccade.datasets.logs.mrclam import ROBOTS
from saccade.errors import LogError, require
from saccade.files import atomic_write
from saccade.types import FloatArray, LandmarkLog


def write_mrclam(folder: str | Path, log: LandmarkLog, robot: int = 1) -> None:
    """Write the files of one robot.

    The format has speeds and turn rates: a way that is not an arc becomes a turn, a straight
    way and another turn, in a third of its time each. It has no noise. Where the log begins
    is kept by its truth alone. Landmarks with numbers up to 5, which are the robots', get
    numbers from 6 on.

    Args:
        folder: of the files; made if it is missing.
        log: with a clock and the identity of every landmark.
        robot: 1 to 5.

    Raises:
        LogError: a way takes no time, or an observation has no identity.
        OutputError: a file cannot be written.
        ConfigError: no such robot.
    """
    require(1 <= robot <= ROBOTS, "robot", f"a number from 1 to {ROBOTS}", robot)
    if (log.landmark < 0).any():
        raise LogError(f"{log.name}: expected the identity of every landmark, found none for some")
    known = [] if log.landmark_truth is None else log.landmark_truth.id.tolist()
    least = min([*log.landmark.tolist(), *known], default=ROBOTS + 1)
    shift = max(0, ROBOTS + 1 - least)
    subjects = np.union1d(log.landmark, np.array(known, np.int64)) + shift
    everyone = np.concatenate([np.arange(1, ROBOTS + 1), subjects])
    tables = {
        "Barcodes.dat": ("subject barcode", np.stack([everyone, everyone], 1)),
        f"Robot{robot}_Odometry.dat": ("time [s] speed [m/s] turn rate [rad/s]", _odometry(log)),
        f"Robot{robot}_Measurement.dat": (
            "time [s] barcode range [m] bearing [rad]",
            np.column_stack(
                [log.time[log.observation_pose], log.landmark + shift, log.observation]
            ),
        ),
    }
    if log.truth is not None:
        tables[f"Robot{robot}_Groundtruth.dat"] = (
            "time [s] x [m] y [m] heading [rad]",
            np.column_stack([log.truth.time, log.truth.pose]),
        )
    if log.landmark_truth is not None:
        spread = log.landmark_truth.covariance
        sigma = np.zeros((len(known), 2))
        if spread is not None:
            sigma = np.sqrt(spread.diagonal(axis1=1, axis2=2))
        tables["Landmark_Groundtruth.dat"] = (
            "subject x [m] y [m] x sigma [m] y sigma [m]",
            np.column_stack([log.landmark_truth.id + shift, log.landmark_truth.xy, sigma]),
        )
    for name, (columns, table) in tables.items():
        lines = [f"# {columns}", *("\t".join(map(_word, row)) for row in table.tolist())]
        with atomic_write(Path(folder) / name) as temporary:
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _odometry(log: LandmarkLog) -> FloatArray:
    """Samples (n, 3) of time, speed and turn rate that drive each way of the log."""
    control, _ = to_relative_poses(log)
    rows: list[tuple[float, float, float]] = []
    for step, (forward, left, turn) in enumerate(control.tolist()):
        begin, end = log.time[step : step + 2].tolist()
        if begin == end and (forward or left or turn):
            raise LogError(
                f"{log.name}, control {step}: expected a way that takes time, found one from "
                f"{begin:g} s to {end:g} s; the format has speeds"
            )
        if begin == end:
            continue
        whole, third = end - begin, (end - begin) / 3
        if abs(left - forward * np.tan(turn / 2)) < 1e-9 and abs(turn) < np.pi:  # an arc
            length = forward / (np.cos(turn / 2) * np.sinc(turn / (2 * np.pi)))
            rows.append((begin, length / whole, turn / whole))
            continue
        aside, length = float(np.arctan2(left, forward)), float(np.hypot(left, forward))
        if abs(aside) > np.pi / 2:
            aside, length = aside - np.copysign(np.pi, aside), -length
        rows += [
            (begin, 0.0, aside / third),
            (begin + third, length / third, 0.0),
            (begin + 2 * third, 0.0, (turn - aside) / third),
        ]
    return np.array([*rows, (float(log.time[-1]), 0.0, 0.0)])


def _word(value: float) -> str:
    return str(int(value)) if value == int(value) and abs(value) < 1e9 else repr(value)
