"""Flicker, motion and gaze in films whose answer is known."""

import cv2
import numpy as np
import pytest

import saccade
import saccade.attention.video
from saccade.attention.video import camera_motion
from saccade.errors import ConfigError, ImageError

H, W = 180, 320
RATE = 25.0


def disc(frame, x, y, radius=5.0, level=1.0):
    """Draw an anti-aliased disc, its center to a sixteenth of a pixel."""
    center = round(16 * x), round(16 * y)
    cv2.circle(frame, center, round(16 * radius), level, -1, cv2.LINE_AA, 4)
    return frame


def plain(number):
    return np.full((H, W), 0.4, np.float32)


def with_dots(number):
    """Still dots, among which that at (160, 90) is missing."""
    frame = plain(number)
    for x in range(40, W, 60):
        for y in (30, 90, 150):
            if (x, y) != (160, 90):
                disc(frame, x, y)
    return frame


def texture():
    """Of a scene larger than the image."""
    noise = np.random.default_rng(0).random((300, 600)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    return ((smooth - smooth.mean()) / smooth.std() * 0.15 + 0.5).clip(0, 1)


def panned(number, scene=None):
    """The scene moves 2.3 pixels to the left and 0.7 upwards per frame."""
    scene = texture() if scene is None else scene
    shift = np.array([[1, 0, -100 - 2.3 * number], [0, 1, -40 - 0.7 * number]])
    return cv2.warpAffine(scene, shift, (W, H), flags=cv2.INTER_CUBIC).clip(0, 1)


def watch(frames, rate=RATE, config=None):
    """Maps of each frame; the static saliency is flat, so that only changes count."""
    video = saccade.VideoSaliency(config, lambda frame: np.zeros((23, 40), np.float32))
    return [video(frame, number / rate) for number, frame in enumerate(frames)]


def position(values):
    """x and y in pixels of the maximum of a map."""
    row, column = np.unravel_index(values.argmax(), values.shape)
    return np.array([(column + 0.5) * W / values.shape[1], (row + 0.5) * H / values.shape[0]]) - 0.5


def test_a_still_video_has_the_saliency_of_its_frame_to_the_bit():
    frame = (panned(0) * 255).astype(np.uint8)
    video = saccade.VideoSaliency()
    expected = saccade.attention_saliency(frame).saliency
    for number in range(5):
        maps = video(frame, number / RATE)
        np.testing.assert_array_equal(maps.saliency, expected)
        assert not maps.flicker.any()
        assert not maps.motion.any()


def test_a_moving_dot_is_the_maximum_among_still_ones():
    video = saccade.VideoSaliency()
    for number in range(8):
        x, y = 100 + 2 * number, 60
        maps = video(disc(with_dots(number), x, y), number / RATE)
    assert abs(position(maps.motion) - (x, y)).max() < 10
    assert abs(position(maps.saliency) - (x, y)).max() < 10
    assert maps.static.max() < 2 * maps.static[maps.saliency < 0.9].max()  # it is not by itself


def test_a_blinking_dot_is_the_maximum_of_flicker():
    frames = [
        disc(with_dots(n), 160, 90) if n % 4 < 2 else with_dots(n) for n in range(7)
    ]  # the last change is at 6
    maps = watch(frames)[-1]
    assert abs(position(maps.flicker) - (160, 90)).max() < 8
    assert abs(position(maps.saliency) - (160, 90)).max() < 8
    assert maps.flicker.max() > 0.5


@pytest.mark.parametrize("direction", range(4))
def test_motion_is_found_in_its_direction(direction):
    step = [(1.5, 0), (0, 1.5), (-1.5, 0), (0, -1.5)][direction]
    frames = [disc(plain(n), 160 + step[0] * n, 90 + step[1] * n) for n in range(3)]
    peaks = watch(frames)[-1].directions.max((1, 2))
    assert peaks[direction] > 0.3
    assert peaks[(direction + 2) % 4] < 0.1 * peaks[direction]  # the opposite
    across = peaks[(direction + 1) % 4], peaks[(direction + 3) % 4]
    assert max(across) < 0.6 * peaks[direction]


def test_a_pan_leaves_only_what_moves_by_itself():
    scene = texture()
    alone = watch([panned(n, scene) for n in range(6)])[-1]
    both = watch([disc(panned(n, scene), 200 - 4 * n, 100, 7, 0.95) for n in range(6)])[-1]
    for name in ("flicker", "motion"):
        changes, object_changes = getattr(alone, name), getattr(both, name)
        assert changes.max() < 0.1 * object_changes.max()
        assert changes.mean() < 0.02
    assert abs(position(both.motion) - (180, 100)).max() < 16


def test_the_motion_of_the_camera_is_that_of_most_of_the_image():
    expected = [[1, 0, -2.3], [0, 1, -0.7], [0, 0, 1]]
    np.testing.assert_allclose(camera_motion(panned(0), panned(1)), expected, atol=0.1)
    lone = [cv2.resize(disc(plain(0), x, 90, 12), (160, 90)) for x in (160, 166)]
    np.testing.assert_array_equal(camera_motion(*lone), np.eye(3))


def test_noise_is_no_change(rng):
    scene = panned(0)
    frames = [(scene + rng.normal(0, 0.01, scene.shape)).clip(0, 1) for _ in range(4)]
    maps = watch(frames)[-1]
    assert max(maps.flicker.max(), maps.motion.max()) < 0.05


def test_maps_and_gaze_depend_on_no_later_frame():
    frames = [disc(with_dots(n), 100 + 2 * n, 60) for n in range(14)]
    whole, prefix = watch(frames), watch(frames[:9])
    for a, b in zip(whole, prefix, strict=False):
        np.testing.assert_array_equal(a.saliency, b.saliency)
        assert a.gaze == b.gaze


@pytest.mark.parametrize("rate", [25.0, 50.0])
def test_the_time_constant_is_in_seconds(rate):
    """A change is seen for the delay of 0.04 s, and fades by exp(-t / 0.1 s), at any rate."""
    frames = [plain(0), *[disc(plain(0), 160, 90)] * round(0.24 * rate)]
    maps = watch(frames, rate)
    expected = maps[1].flicker.max() * (1 - np.exp(-0.04 / 0.1)) * np.exp(-0.2 / 0.1)
    assert maps[-1].saliency.max() == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_gaze_pursues_a_slow_dot(seed):
    track = np.array([(60 + 1.2 * n, 90) for n in range(100)])
    maps = watch([disc(plain(0), *xy) for xy in track], config=saccade.VideoConfig(seed=seed))
    gaze = np.array([each.gaze for each in maps])
    assert ((gaze >= 0) & (gaze <= (W - 1, H - 1))).all()
    error = np.hypot(*(gaze - track).T)[25:]
    assert (error < 12).mean() > 0.7
    steps = np.diff(gaze[25:], axis=0)[(error[1:] < 12) & (error[:-1] < 12)]
    np.testing.assert_allclose(np.median(steps, 0), (1.2, 0), atol=0.1)


def test_invalid_frames_and_settings_are_named():
    video = saccade.VideoSaliency(static=lambda frame: np.zeros((23, 40), np.float32))
    video(plain(0), 1.0)
    with pytest.raises(ImageError, match=r"frame: expected \(180, 320\) px as before"):
        video(plain(0)[1:], 2.0)
    with pytest.raises(ConfigError, match="time: expected later than the frame before"):
        video(plain(0), 1.0)
    with pytest.raises(ConfigError, match="static_interval: expected 0 to"):
        saccade.VideoConfig(static_interval=-1)
