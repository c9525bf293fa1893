"""Sessions: a `Slam` is saved as a map file, and loaded for another log or robot."""

from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from scipy.linalg import block_diag

from saccade.errors import ConfigError, LogError, require
from saccade.io.checkpoint import Arrays, merge, select
from saccade.landmark_names import stored_texts
from saccade.slam.association.rule import Association, KnownIdentity
from saccade.slam.config import RETRACTIONS, EkfConfig
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.validation import check_covariance
from saccade.slam.map_file import SavedMap, read_map, write_map
from saccade.slam.models import MOTIONS, MotionModel, Sensor
from saccade.slam.online import Slam
from saccade.slam.relocalization import Relocalizer
from saccade.types import FloatArray, LandmarkLog

AnySlam = TypeVar("AnySlam", bound=Slam)
START_SIGMA = (0.5, 0.5, 0.1)
"""Metres and radians: standard deviation of a start in a map, if neither it nor the settings say
one."""
FILTER, COUNTS = "hypotheses.0.ekf", "hypotheses.0.culling"
"""Parts of a map file: the filter, and the counts of its landmarks."""
FOUND = 0.99
"""Probability from which a hypothesis of the pose is right."""
MIN_MATCHED = 3
"""Observed points that must be landmarks of the map for the robot to be found."""
MAX_SCANS = 50
"""Scans after which a robot that was not found is not in the map."""


def save(slam: Slam, path: str | Path) -> None:
    """See `Slam.save`."""
    if slam.mode == "localize":
        raise ConfigError("mode: expected continue for a map to be saved, found localize")
    ekf = merge({FILTER: slam.ekf.to_arrays(spare=False)})  # first: it changes the filter's arrays
    arrays = slam.to_arrays()
    arrays = {name: each for name, each in arrays.items() if not name.startswith(f"{FILTER}.")}
    arrays |= ekf
    arrays["robot_size"] = np.array(len(slam.ekf.robot_state))
    arrays["sessions"] = np.array(slam.sessions)
    if slam.descriptors is not None:
        arrays["descriptors"] = slam.descriptors
    write_map(path, SavedMap(slam.config, {**_names(slam), **slam.arguments}, arrays))


def load(
    cls: type[AnySlam],
    path: str | Path,
    mode: Literal["continue", "localize"],
    config: EkfConfig | None,
    start: FloatArray | tuple[float, float, float] | None,
    covariance: FloatArray | None,
    motion: MotionModel | None,
    sensor: Sensor,
    association: Association | None,
    odometry_bias: tuple[float, float, float] | None,
) -> AnySlam:
    """See `Slam.load`."""
    saved = read_map(path)
    config, names, arrays = config or saved.config, saved.models, saved.arrays
    if motion is None:
        require(names["motion"] in MOTIONS, "motion", f"the model of {path}", None)
        motion = MOTIONS[names["motion"]]
    kind = saved.config.filter
    require(config.filter == kind, "filter", f"{kind!r}, as in {path}", config.filter)
    biases = names["odometry_bias"] if start is None or odometry_bias is None else odometry_bias
    slam = cls(
        config,
        start=(0.0, 0.0, 0.0) if start is None else start,
        motion=motion,
        sensor=sensor,
        association=association,
        odometry_bias=tuple(biases),
        mode=mode,
    )
    for name in ("sensor", "association"):
        found = _names(slam)[name]
        require(found == names[name], name, f"{names[name]}, as in {path}", found)
    if start is None:
        estimated, expected = (
            size > 3 for size in (len(slam.ekf.robot_state), int(arrays["robot_size"]))
        )
        setting = "estimate_odometry_bias"
        require(estimated == expected, setting, f"{expected}, as in {path}", estimated)
        slam.from_arrays(arrays)
    else:
        _place(slam, arrays, covariance)
        slam.associate.from_arrays(select(arrays, "associate"))
        slam.culling.from_arrays(select(arrays, COUNTS))
    if start is not None or mode == "localize":
        drop_candidates(slam)
    slam.text_names = stored_texts(arrays)
    slam.sessions = [*arrays["sessions"].tolist(), slam.ekf.num_added]
    slam.descriptors = arrays.get("descriptors")
    return slam


def _place(slam: Slam, arrays: Arrays, covariance: FloatArray | None) -> None:
    """Give a new filter the landmarks of a saved map, independent of its robot."""
    P = slam.ekf.covariance
    if covariance is None and not any(slam.config.start_sigma):
        covariance = np.diag(np.square(START_SIGMA))
    if covariance is not None:
        P[:3, :3] = check_covariance("covariance of the start", covariance, 3)
    r = int(arrays["robot_size"])
    other = EkfSlam(np.zeros(r), np.zeros((r, r)), retraction=RETRACTIONS[slam.config.filter])
    other.from_arrays(select(arrays, FILTER))
    mean = np.concatenate([slam.ekf.robot_state, other.state[r:]])
    slam.ekf.set_gaussian(mean, block_diag(P, other.covariance[r:, r:]), other.ids)


def drop_candidates(slam: Slam) -> None:
    """Remove the landmarks that are not in the map yet."""
    landmarks, confirmed = len(slam.ekf), slam.culling.is_confirmed
    if isinstance(slam.associate, KnownIdentity) or len(confirmed) < landmarks:
        return
    candidates = np.flatnonzero(~confirmed[:landmarks] & (slam.identities < 0))
    slam.culling.remove_culled(candidates)
    slam.remove(candidates, np.empty(0, np.int64))


def _names(slam: Slam) -> dict[str, Any]:
    """Names of the models, for a map file."""
    motions = [name for name, model in MOTIONS.items() if model is slam.motion]
    return {
        "motion": motions[0] if motions else "custom",
        "sensor": type(slam.ekf.sensor).__qualname__,
        "association": type(slam.associate).__qualname__,
    }


def find_start(slam: Slam, log: LandmarkLog) -> tuple[FloatArray, FloatArray]:
    """Find the first pose of a log in a map, by its first scans and without a prior.

    This looks ahead to the scan that decides; `Relocalizer` finds a live robot at that scan.

    Args:
        slam: with the map, as `Slam.load` gives it.
        log: of which the first scans are used, as many as are needed.

    Returns:
        The first pose (3,) in the frame of the map, and its covariance (3, 3), which includes
        the uncertainty of the landmarks around.

    Raises:
        LogError: no pose is certain.
    """
    ekf = slam.ekf
    r = len(ekf.robot_state)
    search = Relocalizer(ekf.landmarks, ekf.covariance[r:, r:], motion=slam.motion)
    moved, moved_covariance, scans, best = np.zeros(3), np.zeros((3, 3)), 0, 0.0
    for step in range(len(log.time)):
        if step > 0:
            u, U = log.control[step - 1], log.control_covariance[step - 1]
            search.predict(u, U)
            moved, moved_covariance = _moved(slam.motion, moved, moved_covariance, u, U)
        scan = log.observation_pose == step
        if not scan.any() or scans == MAX_SCANS:
            continue
        found = search.add(log.observation[scan], log.observation_covariance[scan])
        scans += 1
        if len(found) == 0:
            continue
        best, association = float(found.probability[0]), found.association[0]
        matched = association[association >= 0]
        if best > FOUND and len(matched) >= MIN_MATCHED:
            covariance = found.covariance[0].copy()
            covariance[:2, :2] += ekf.landmark_covariances[matched].mean(0)
            return _before(found.pose[0], covariance, moved, moved_covariance)
    raise LogError(
        f"start: expected a pose in the map that is certain, found a probability of {best:.2f} "
        f"after {scans} scans; give the start"
    )


def _moved(
    motion: MotionModel, pose: FloatArray, P: FloatArray, u: FloatArray, U: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Dead reckoning by one control."""
    pose, Fx, Fu = motion(pose, u)
    return pose, Fx @ P @ Fx.T + Fu @ U @ Fu.T


def _before(
    pose: FloatArray, C: FloatArray, moved: FloatArray, moved_covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The pose from which a motion (3,) with its covariance leads to a pose."""
    heading = pose[2] - moved[2]
    c, s = np.cos(heading), np.sin(heading)
    R = np.array([[c, -s], [s, c]])
    arm = R @ moved[:2]
    J, K = np.eye(3), np.zeros((3, 3))
    J[:2, 2] = arm[1], -arm[0]
    K[:2, :2], K[:2, 2], K[2, 2] = -R, [-arm[1], arm[0]], -1.0
    return np.append(pose[:2] - arm, heading), J @ C @ J.T + K @ moved_covariance @ K.T
