import numpy as np
import pytest

from saccade.datasets import load_drive, save_drive
from saccade.errors import DriveError, ImageError, OutputError
from saccade.frames import Frame
from support.small_drive import small_drive


def test_what_is_written_is_read_again(tmp_path):
    drive = small_drive()
    save_drive(tmp_path / "small", drive)
    again = load_drive("auto", tmp_path / "small")
    for name in ("time", "control", "control_covariance", "start"):
        np.testing.assert_allclose(getattr(again, name), getattr(drive, name), rtol=1e-12)
    assert again.odometry_bias == drive.odometry_bias
    np.testing.assert_allclose(again.truth.pose, drive.truth.pose, atol=1e-8)
    assert repr(again.camera) == repr(drive.camera)
    for i in range(len(drive)):
        np.testing.assert_array_equal(again.load(i).image, drive.load(i).image)
        np.testing.assert_array_equal(again.load(i).right, drive.load(i).right)


def test_depth_is_written_in_millimetres(tmp_path):
    depth = np.full((24, 32), 1.2345)
    depth[0, 0] = np.nan
    depth[0, 1] = 1000.0
    grey = np.zeros((24, 32), np.uint8)
    save_drive(tmp_path / "rgbd", small_drive(load=lambda i: Frame(i, grey, depth=depth)))
    found = load_drive("kitti", tmp_path / "rgbd").load(2).depth
    assert np.isnan(found[0, :2]).all()
    np.testing.assert_allclose(found[1:], 1.2345, atol=0.0006)


def test_an_earlier_drive_is_replaced_and_nothing_else(tmp_path):
    out = tmp_path / "small"
    save_drive(out, small_drive(7))
    save_drive(out, small_drive(4))
    assert len(list((out / "image_0").iterdir())) == 4
    (out / "notes.md").write_text("mine")
    with pytest.raises(OutputError, match="new or empty folder, found"):
        save_drive(out, small_drive())


def test_a_drive_that_breaks_off_leaves_nothing(tmp_path):
    def load(i):
        if i == 3:
            raise ImageError("frame 3: cannot be read")
        return Frame(i, np.zeros((24, 32), np.uint8))

    with pytest.raises(ImageError):
        save_drive(tmp_path / "small", small_drive(load=load))
    with pytest.raises(DriveError, match="frame 0: expected an image"):
        save_drive(tmp_path / "small", small_drive(load=Frame))
    assert not list(tmp_path.iterdir())
