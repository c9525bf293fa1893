"""Frames of a live camera: which are taken, and what the commands make of them."""

from threading import Event

import cv2
import numpy as np
import pytest

from saccade.errors import ImageError
from saccade.io import video as live_video
from saccade.io.video import LiveVideo, video_writer


class Device:
    """A camera whose frames are numbered by their gray value; it waits to be told to go on."""

    def __init__(self, count):
        self.numbers, self.may_go_on = iter(range(count)), Event()
        self.is_released, self.is_done = False, Event()

    def get(self, _):
        return 0.0

    def read(self):
        number = next(self.numbers, None)
        if number:
            self.may_go_on.wait(10)
        if number is None:
            self.is_done.set()
            return False, None
        return True, np.full((2, 3, 3), number, np.uint8)

    def release(self):
        self.is_released = True


@pytest.fixture
def device(monkeypatch):
    device = Device(6)
    monkeypatch.setattr(cv2, "VideoCapture", lambda number: device)
    return device


def test_the_latest_frame_of_a_camera_is_taken_and_the_others_counted(device):
    with LiveVideo("0") as video:
        seconds, first = video.read()
        assert seconds == 0
        assert (first == 0).all()
        device.may_go_on.set()
        assert device.is_done.wait(10)
        later, last = video.read()
        assert later > 0
        assert (last == 5).all()
        assert video.dropped == 4
        assert video.read() is None
        assert video.size == (3, 2)
        assert video.rate == live_video.USUAL_RATE
    assert device.is_released


def test_a_camera_without_frames_is_refused(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", lambda number: Device(0))
    with pytest.raises(ImageError, match="camera 0: expected a camera, an address or a video"):
        LiveVideo("0")


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A camera that turns past a wall of random tiles, 8 frames at 10 a second."""
    path = tmp_path_factory.mktemp("film") / "wall.mp4"
    tiles = np.random.default_rng(0).integers(0, 256, (12, 40, 3), np.uint8)
    wall = cv2.resize(tiles, (640, 192), interpolation=cv2.INTER_NEAREST)
    with video_writer(path, 10.0) as write:
        for i in range(8):
            write(wall[:, 4 * i : 4 * i + 256])
    return path


def test_a_drive_of_a_camera_is_that_of_its_recording(run, film, tmp_path):
    camera = ("--intrinsics", "200,200,128,96")
    ride = tmp_path / "ride"
    assert run("drive", ride, "--device", film, *camera, "-o", tmp_path / "live")[0] == 0
    assert run("drive", ride, "-o", tmp_path / "again")[0] == 0
    live, again = ((tmp_path / name / "poses.csv").read_bytes() for name in ("live", "again"))
    assert live == again
    assert len(live.splitlines()) == 9
    code, _, err = run("drive", ride, "--device", film)
    assert code == 2
    assert "expected no images beside the recording" in err
