"""Drives without a calibration: guessed cameras, names of folders, and lengths up to scale."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image as Pillow

from saccade import visual
from saccade.datasets import load_drive
from saccade.datasets.drives.folder import (
    CameraOptions,
    assume_speed,
    read_intrinsics,
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
    exif.get_ifd(0x8769)[0xA405] = 72
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
    values, found = read_intrinsics(tmp_path / "calib.txt")
    assert values == GIVEN.intrinsics
    assert found == pytest.approx(baseline)
    drive = load_drive("auto", tmp_path)
    assert (drive.camera.fx, drive.camera.baseline, drive.scale) == (90, 0, "held")
    (tmp_path / "calib.txt").write_text("1 2 3")
    with pytest.raises(DriveError, match=r"calib.txt: expected .* found 3 numbers"):
        load_drive("auto", tmp_path)


def test_a_single_camera_finds_its_path_up_to_scale():
    drive = simulate_drive(DriveConfig(frames=60), 0)
    camera = replace(drive.camera, baseline=0.0, position=np.zeros(3))

    def load(i):
        return replace(drive.load(i), right=None)

    single = assume_speed(replace(drive, camera=camera, control=0 * drive.control, load=load))
    assert single.scale == "held"
    estimate = visual.run(single).trajectory.pose[:, :2] @ [1, 1j]
    true = drive.truth.at(drive.time)[:, :2] @ [1, 1j]
    estimate, true = estimate - estimate.mean(), true - true.mean()
    scale = np.vdot(estimate, true) / np.vdot(estimate, estimate)
    assert (
        np.sqrt(np.mean(np.abs(scale * estimate - true) ** 2)) < 0.02 * np.abs(np.diff(true)).sum()
    )
