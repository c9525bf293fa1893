"""The Victoria Park log, raw and as GTSAM has it, and cityTrees: real sizes, outside answers."""

from importlib.resources import files

import gtsam
import numpy as np
import pytest
from scipy.io import savemat

from saccade import slam
from saccade.datasets import load
from saccade.datasets.logs.published import center_motion
from saccade.slam import compose, inverse_observe
from support.alignment import align


@pytest.fixture(scope="module")
def text_log():
    return files("saccade") / "data" / "victoria_park.txt"


@pytest.fixture(scope="module")
def filtered(text_log):
    """Without weights: the loss of GTSAM's graphs here is the plain one."""
    log = load("victoria-park", text_log)
    return log, slam.run(log, slam.EkfConfig(huber=np.inf, association="known"))


def _smoothed_map(graph, pose_keys, result):
    """GTSAM's map from a graph without a fixed pose, begun at the filter's estimate."""
    values = gtsam.Values()
    for key, pose in zip(pose_keys, result.trajectory.pose, strict=True):
        values.insert(key, gtsam.Pose2(*pose))
    landmark_keys = [gtsam.symbol("l", i) for i in result.map.id.tolist()]
    for key, xy in zip(landmark_keys, result.map.xy, strict=True):
        values.insert(key, xy)
    fixed = gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)
    graph.add(gtsam.PriorFactorPose2(pose_keys[0], gtsam.Pose2(0, 0, 0), fixed))
    best = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return np.array([best.atPoint2(key) for key in landmark_keys])


def _median_distance(ours, theirs):
    apart = np.hypot(*(align(ours, theirs) - theirs).T)
    print(f"\nlandmarks from GTSAM's: median {np.median(apart):.3f} m, largest {apart.max():.3f} m")
    return np.median(apart)


def test_map_agrees_with_gtsams_own_reading_of_the_file(text_log, filtered):
    log, result = filtered
    graph, _ = gtsam.load2D(str(text_log))
    smoothed = _smoothed_map(graph, log.time.astype(int).tolist(), result)
    assert len(result.map) == 151
    assert _median_distance(result.map.xy, smoothed) < 0.65


def _to_gps(trajectory, gps, keep=0.9):
    """Distances from GPS, of the nearest share `keep`, which alone decide the alignment."""
    inside = (gps.time >= trajectory.time[0]) & (gps.time <= trajectory.time[-1])
    at, there = gps.time[inside], gps.pose[inside, :2]
    here = np.stack([np.interp(at, trajectory.time, trajectory.pose[:, i]) for i in (0, 1)], 1)
    near = np.ones(len(at), bool)
    for _ in range(30):
        apart = np.hypot(*(align(here, there, near) - there).T)
        near = apart <= np.quantile(apart, keep)
    return apart[near]


@pytest.fixture(scope="module")
def raw_log(shared):
    return load("auto", shared / "data/logs/victoria_park/VictoriaParkSinSincronizar.mat")


@pytest.mark.shared
@pytest.mark.parametrize(
    "noise", [1.0, *(pytest.param(each, marks=pytest.mark.nightly) for each in (0.5, 2.0))]
)
def test_raw_log_without_names_comes_close_to_gps(raw_log, noise):
    result = slam.run(raw_log, slam.EkfConfig(motion_noise_scale=noise, sensor_noise_scale=noise))
    assert len(result.trajectory) == 7249
    apart = _to_gps(result.trajectory, raw_log.truth)
    rmse = np.sqrt((apart**2).mean())
    print(f"\n{len(result.map)} landmarks, {rmse:.3f} m from GPS (the nearest 90 %)")
    assert rmse < 1.45
    assert np.sqrt((_to_gps(result.dead_reckoning, raw_log.truth) ** 2).mean()) > 20
    assert 180 <= len(result.map) <= 290
    assert np.isfinite(result.trajectory.covariance).all()


@pytest.mark.shared
def test_city_of_trees_is_found_where_it_was_made(shared):
    folder = shared / "data/logs/citytrees"
    log = load("auto", folder / "cityTrees10000.txt")
    truth = slam.dead_reckon(load("auto", folder / "cityTrees10000_groundtruth.txt")).pose
    result = slam.run(log)
    used = np.flatnonzero(result.association >= 0)
    first = used[np.unique(result.association[used], return_index=True)[1]]
    exact = load("isam", folder / "cityTrees10000_groundtruth.txt").observation
    from_pose = truth[log.observation_pose[first]]
    trees = np.array(
        [inverse_observe(p, z)[0] for p, z in zip(from_pose, exact[first], strict=True)]
    )
    apart = np.hypot(*(align(result.map.xy, trees) - trees).T)
    assert len(result.map) == 100
    assert np.sqrt((apart**2).mean()) < 0.1
    path = result.trajectory.pose[:, :2]
    off = np.hypot(*(align(path, truth[:, :2]) - truth[:, :2]).T)
    assert np.sqrt((off**2).mean()) < 1.5
    assert result.consistency.band[0] < result.consistency.mean < result.consistency.band[1]


def _scans(first, second):
    scans = np.empty(2, object)
    scans[0], scans[1] = first, second
    return scans


def _tiny(path, **change):
    trees = np.array([[10.0, 20.0], [np.pi / 2, np.pi / 4], [0.3, 0.4]])
    variables = {
        "time": np.arange(0, 2, 0.025)[None],
        "u": np.tile([[2.0], [0.3]], (1, 80)),
        "TLsr": np.array([[0.0, 1.0]]),
        "zt": _scans(trees, np.empty((3, 0))),
    }
    savemat(path, variables | change)
    return path


def test_car_goes_in_a_circle_about_its_turning_point(tmp_path):
    """The laser keeps its distance from the point about which the car turns."""
    log = load("auto", _tiny(tmp_path / "car.mat"))
    np.testing.assert_allclose(log.observation, [[10, 0], [20, -np.pi / 4]])
    speed, rate = center_motion(np.array([2.0]), np.array([0.3]))
    radius = 2.83 / np.tan(0.3)
    np.testing.assert_allclose(speed / rate, radius)
    np.testing.assert_allclose((radius - 0.76) * rate, 2.0)  # the left wheel is what counts
    center = np.array([0, radius]) - np.array([3.78, 0.5])
    moved, _, _ = compose(np.zeros(3), log.control[0])
    np.testing.assert_allclose(moved[2], rate)
    np.testing.assert_allclose(np.hypot(*(moved[:2] - center)), np.hypot(*center))
