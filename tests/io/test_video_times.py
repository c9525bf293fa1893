"""Frames of a video have the times of the container, also at a variable rate."""

import struct

import cv2
import numpy as np
import pytest

from saccade.cli.look_video import repeats_of
from saccade.errors import ImageError
from saccade.io.video import LiveVideo, VideoFrames, frame_times, read_video, video_writer

SLOW = 20
"""Number of the first frame at a fifth of the rate."""
TIMES = np.r_[np.arange(SLOW) / 25, SLOW / 25 + np.arange(10) / 5]


def boxes(data, *names):
    """Position of each nested MP4 box."""
    start = 0
    for name in names:
        start = data.index(name, start)
        yield start


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """An MP4 whose last ten frames take five times as long, by its table of durations."""
    path = tmp_path_factory.mktemp("film") / "variable.mp4"
    with video_writer(path, 25) as write:
        for k in range(len(TIMES)):
            write(np.full((48, 64, 3), 40 + 5 * k, np.uint8))
    data = bytearray(path.read_bytes())
    at = data.index(b"stts")
    _, count, delta = struct.unpack(">III", data[at + 8 : at + 20])
    data[at + 8 : at + 20] = struct.pack(">IIIII", 2, SLOW, delta, count - SLOW, 5 * delta)
    for box in boxes(data, b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        size = struct.unpack(">I", data[box - 4 : box])[0]
        data[box - 4 : box] = struct.pack(">I", size + 8)
    longer = (SLOW + 5 * (count - SLOW)) / count
    for name, place in ((b"mdhd", 20), (b"mvhd", 20), (b"tkhd", 24), (b"elst", 12)):
        at = data.index(name) + place
        length = struct.unpack(">I", data[at : at + 4])[0]
        data[at : at + 4] = struct.pack(">I", round(length * longer))
    path.write_bytes(data)
    return path


def test_frames_have_the_times_of_the_container(film):
    np.testing.assert_allclose([time for time, _ in read_video(film)], TIMES, atol=1e-3)
    np.testing.assert_allclose([time for time, _ in read_video(film, 3)], TIMES[::3], atol=1e-3)
    np.testing.assert_allclose(VideoFrames(film).times, TIMES, atol=1e-3)
    assert VideoFrames(film).rate == pytest.approx(25, abs=0.1)
    with LiveVideo(str(film)) as live:
        times = [seen[0] for _ in TIMES if (seen := live.read())]
    np.testing.assert_allclose(times, TIMES, atol=1e-3)


def test_a_film_at_a_constant_rate_keeps_the_times(film):
    repeats = repeats_of(frame_times(film), 25.0)
    shown = np.cumsum([0, *repeats]) / 25
    np.testing.assert_allclose(shown, np.append(TIMES, TIMES[-1] + 0.2), atol=0.021)
    assert repeats_of(np.array([0.0]), 25.0) == [1]
    assert max(repeats_of(np.array([0.0, 1e5, 1e5 + 0.04]), 25.0)) == 250


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif"])
def test_an_image_with_the_name_of_a_video_is_none(tmp_path, suffix):
    cv2.imwrite(str(tmp_path / f"a{suffix}"), np.zeros((8, 9), np.uint8))
    path = (tmp_path / f"a{suffix}").rename(tmp_path / "a.mp4")
    with pytest.raises(ImageError, match=r"a\.mp4: expected a video, found a \w+ image"):
        next(read_video(path))
