"""Drives without a calibration: guessed cameras, names of folders, and lengths up to scale."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image as Pillow

from saccade import visual
from saccade.datasets import load_drive, save_drive
from saccade.datasets.drives.folder import (
    CameraOptions,
    assume_speed,
    read_calib,
)
from saccade.errors import DriveError
from saccade.simulation import DriveConfig, simulate_drive

GIVEN = CameraOptions((90.0, 91.0, 39.0, 29.0), 0.2)


def write_images(folder, count=4, exif=None):
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        pixels = np.random.default_rng(i).integers(0, 255, (60, 80), np.uint8)
        options = {} if exif is None else {"exif": exif}
        Pillow.fromarray(pixels).save(folder / f"IMG_{i}.jpg", **options)


def test_the_camera_of_bare_images_is_guessed_and_said(tmp_path):
    write_images(tmp_path)
    drive = load_drive("auto", tmp_path)
    camera = drive.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (96, 96, 39.5, 29.5)
    assert drive.scale == "assumed"
    assert "guessed a focal length of 96 px" in drive.assumptions[0]
    assert "the scale is unknown" in drive.assumptions[1]


def test_exif_and_given_intrinsics_replace_the_guess(tmp_path):
    exif = Pillow.Exif()
    exif[0x8769] = {0xA405: 72}
    write_images(tmp_path, exif=exif)
    drive = load_drive("auto", tmp_path)
    assert drive.camera.fx == 160  # twice the width of the film
    assert drive.scale == "held"
    camera = load_drive("auto", tmp_path, GIVEN).camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == GIVEN.intrinsics


@pytest.mark.parametrize(
    "names", [("image_l", "image_r"), ("left", "right"), ("cam0/data", "cam1/data"), ("l", "r")]
)
def test_pairs_of_folders_have_many_names(tmp_path, names):
    for name in names:
        write_images(tmp_path / name)
    drive = load_drive("auto", tmp_path, GIVEN)
    assert drive.load(2).right is not None
    assert drive.scale == "metric"
    left = load_drive("auto", tmp_path)
    assert left.load(2).right is None
    assert any("--baseline" in remark for remark in left.assumptions)


@pytest.mark.parametrize(
    ("text", "baseline"),
    [
        ("90 0 39 0 0 91 29 0 0 0 1 0\n90 0 39 -18 0 91 29 0 0 0 1 0\n", 0.2),
        ("90 0 39\n0 91 29\n0 0 1\n", 0.0),
        ("K: 90 0 39 0 91 29 0 0 1\n", 0.0),
        ("90 91 39 29 0.2", 0.2),
    ],
)
def test_a_calib_without_row_names_is_read(tmp_path, text, baseline):
    write_images(tmp_path / "image_0")
    (tmp_path / "calib.txt").write_text(text)
    found = read_calib(tmp_path / "calib.txt", (80, 60))
    assert (found.fx, found.fy, found.cx, found.cy) == GIVEN.intrinsics
    assert found.baseline == pytest.approx(baseline)
    drive = load_drive("auto", tmp_path)
    assert (drive.camera.fx, drive.camera.baseline, drive.scale) == (90, 0, "held")
    (tmp_path / "calib.txt").write_text("1 2 3")
    with pytest.raises(DriveError, match=r"calib.txt: expected .* found 3 numbers"):
        load_drive("auto", tmp_path)


@pytest.mark.nightly
def test_a_single_camera_finds_its_path_up_to_scale():
    drive = simulate_drive(DriveConfig(frames=60), 0)
    camera = replace(drive.camera, baseline=0.0, position=np.zeros(3))

    def load(i):
        return replace(drive.load(i), right=None)

    single = assume_speed(replace(drive, camera=camera, has_odometry=False, load=load))
    assert single.scale == "held"
    estimate = visual.run(single).trajectory.pose[:, :2] @ [1, 1j]
    true = drive.truth.at(drive.time)[:, :2] @ [1, 1j]
    estimate, true = estimate - estimate.mean(), true - true.mean()
    scale = np.vdot(estimate, true) / np.vdot(estimate, estimate)
    assert (
        np.sqrt(np.mean(np.abs(scale * estimate - true) ** 2)) < 0.02 * np.abs(np.diff(true)).sum()
    )


def rows_of(trajectory, kept):
    """Lines of a TUM file."""
    poses = zip(trajectory.time[kept].tolist(), trajectory.pose[kept].tolist(), strict=True)
    turns = [(t, x, y, np.sin(h / 2), np.cos(h / 2)) for t, (x, y, h) in poses]
    return "".join(f"{t} {x} {y} 0 0 0 {s} {c}\n" for t, x, y, s, c in turns)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    drive = simulate_drive(DriveConfig(frames=14), 2)
    folder = tmp_path_factory.mktemp("simulated") / "drive"
    save_drive(folder, drive)
    return drive, folder


@pytest.mark.parametrize("file", ["groundtruth.tum", "groundtruth_tum.txt"])
@pytest.mark.parametrize("given", [True, False])
def test_a_start_pose_is_never_taken_from_another_time(simulated, tmp_path, file, given):
    """Motion capture begins with the seventh frame."""
    drive, folder = simulated
    copy = tmp_path / "drive"
    shutil.copytree(folder, copy)
    (copy / "groundtruth.tum").unlink()
    (copy / file).write_text(rows_of(drive.truth, slice(7, None)))
    if not given:
        lines = (copy / "camera.toml").read_text().splitlines()
        first = next(i for i, line in enumerate(lines) if line.startswith("start"))
        (copy / "camera.toml").write_text("\n".join(lines[:first]))  # it is the last entry
    late = load_drive("auto", copy)
    assert late.start_known == given
    assert late.start.tolist() == (drive.start.tolist() if given else [0, 0, 0])
    assert any("does not cover the first pose" in each for each in late.assumptions) != given
    assert (late.aligned_truth is None) != given
    assert np.isnan(late.truth.at(late.time)[:7]).all()
    save_drive(tmp_path / "again", late)
    assert load_drive("auto", tmp_path / "again").start_known == given


@pytest.mark.parametrize("style", ["{}", "frame{:03d}", "frame{}", "img_{}_left"])
def test_frames_are_in_the_order_of_their_numbers(simulated, tmp_path, style):
    _, folder = simulated
    (tmp_path / "images").mkdir()
    for i in range(14):
        name = f"{style.format(i)}.png"
        shutil.copy(folder / f"image_0/{i:06d}.png", tmp_path / "images" / name)
    read = load_drive("folder", tmp_path, CameraOptions((200.0, 200.0, 159.5, 119.5)))
    expected = load_drive("auto", folder)
    for i in range(14):
        np.testing.assert_array_equal(read.load(i).image, expected.load(i).image)
