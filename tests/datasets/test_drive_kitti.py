"""KITTI's layout, and the tracks that come with it."""

import numpy as np
import pytest

from saccade.datasets import load_drive, save_drive
from saccade.errors import DriveError, ImageError
from saccade.evaluation.trajectory import position_rmse
from saccade.slam.filter.robot_models import compose
from saccade.types import Trajectory
from support.error_checks import refuses
from support.odometry_alone import followed
from support.small_drive import small_drive


@pytest.fixture
def folder(tmp_path):
    save_drive(tmp_path / "07", small_drive(8))
    return tmp_path / "07"


def test_steps_across_a_missing_image_are_joined(folder):
    whole = load_drive("auto", folder)
    (folder / "image_0" / "000003.png").unlink()
    (folder / "image_0" / "000004.png").unlink()
    (folder / "image_1" / "000006.png").unlink()
    drive = load_drive("auto", folder)
    kept = [0, 1, 2, 5, 6, 7]
    np.testing.assert_allclose(
        followed(drive.start, drive.control), followed(whole.start, whole.control)[kept], atol=1e-12
    )
    assert "2 images are missing, first number 3" in drive.remarks[0]
    assert drive.load(4).right is None
    np.testing.assert_array_equal(drive.load(3).image, whole.load(5).image)


def test_covariances_are_joined_as_samples_are(folder):
    rng = np.random.default_rng(0)
    whole = load_drive("auto", folder)
    for number in (3, 4):
        (folder / "image_0" / f"{number:06d}.png").unlink()
    joined = load_drive("auto", folder).control_covariance[2] * 1e-6
    steps = [
        rng.multivariate_normal(whole.control[i], whole.control_covariance[i] * 1e-6, 4000)
        for i in (2, 3, 4)
    ]
    ends = []
    for path in zip(*steps, strict=True):
        pose = np.zeros(3)
        for control in path:
            pose = compose(pose, control)[0]
        ends.append(pose)
    turn = np.array(ends)[:, 2]
    ends = np.column_stack([np.array(ends)[:, :2], np.unwrap(turn - turn[0])])
    np.testing.assert_allclose(np.cov(ends.T), joined, atol=0.06 * np.abs(joined).max())


def test_without_camera_file_the_projections_are_read(folder):
    whole = load_drive("auto", folder)
    (folder / "camera.toml").unlink()
    drive = load_drive("auto", folder)
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(drive.camera, name) == getattr(whole.camera, name)
    assert drive.camera.baseline == pytest.approx(0.2)
    np.testing.assert_allclose(drive.start, whole.start, atol=1e-8)


def test_what_does_not_fit_is_named(folder):
    def replaced(name, old, new):
        path = folder / name
        text = path.read_text()
        path.write_text(text.replace(old, new))
        return path, text

    for name, old, new, kind, message in (
        ("camera.toml", "width = 32", "width = 64", ImageError, "64 x 24 px as in the calibration"),
        ("times.txt", "3.100000000", "soon", DriveError, "times.txt, line 2: expected a finite"),
        (
            "times.txt",
            "3.700000000\n",
            "",
            DriveError,
            "000007.png: expected a frame number below 7",
        ),
        ("times.txt", "3.200000000", "9.9", DriveError, "frames in the order of their times"),
    ):
        path, text = replaced(name, old, new)
        with refuses(kind, message):
            load_drive("kitti", folder).load(0)
        path.write_text(text)
    (folder / "camera.toml").unlink()
    path, text = replaced("calib.txt", "1.55", "4.55")
    with refuses(DriveError, "a principal point inside the images of 32 x 24 px, found 45.5"):
        load_drive("kitti", folder)
    path.write_text("P0: 1 2 3\n")
    with refuses(DriveError, "calib.txt: expected (3, 4) projections", "found 3 numbers"):
        load_drive("kitti", folder)


def test_poses_of_the_benchmark_are_found(folder):
    (folder / "groundtruth.tum").unlink()
    (folder.parent / "sequences").mkdir()
    folder = folder.rename(folder.parent / "sequences" / "07")
    poses = folder.parent.parent / "poses" / "07.txt"
    poses.parent.mkdir()
    lines = [f"1 0 0 {0.1 * i} 0 1 0 0 0 0 1 {i}" for i in range(8)]
    poses.write_text("\n".join(lines))
    drive = load_drive("kitti", folder)
    np.testing.assert_allclose(drive.truth.pose, [[i, -0.1 * i, 0] for i in range(8)], atol=1e-12)
    poses.write_text("\n".join(lines[:5]))
    with refuses(DriveError, "07.txt: expected 8 poses as in times.txt, found 5"):
        load_drive("kitti", folder)


@pytest.mark.shared
def test_tracks_of_kitti_and_their_odometry(shared):
    drive = load_drive("auto", shared / "data" / "drives" / "kitti07" / "stereo_tracks_clean.npz")
    assert len(drive) == 1101
    assert drive.camera.baseline == pytest.approx(0.537, abs=1e-3)
    np.testing.assert_allclose(drive.camera.position[:2], [1.144, -0.313], atol=1e-3)
    alone = Trajectory(drive.time, followed(drive.start, drive.control))
    assert position_rmse(alone, drive.truth) == pytest.approx(14.4, abs=0.1)
    first, second = drive.load(0).tracks, drive.load(1).tracks
    common, a, b = np.intersect1d(first.id, second.id, return_indices=True)
    assert len(common) > 50
    near = np.median(first.disparity) * 0.2
    assert (np.abs(first.xy[a] - second.xy[b]) < 40).all()
    assert (np.abs(first.disparity[a] - second.disparity[b]) < max(near, 10)).mean() > 0.95
