"""A fovea: its pixels, how exactly it tracks, and drives that it looks at."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import fourier_shift, gaussian_filter

from saccade import visual
from saccade.errors import ConfigError, DriveError
from saccade.evaluation.drives import summarize_drive
from saccade.frames import AHEAD, Camera, CameraTurn, Drive, Frame, Gaze, Periphery
from saccade.simulation import DriveConfig, simulate_drive
from saccade.viewing.fovea import foveated_image
from saccade.visual.camera import reduced_camera, to_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.depth import measure_depth
from saccade.visual.fovea import Fovea, FoveaConfig, reduced_drive
from saccade.visual.gaze_policies import POLICIES
from saccade.visual.optical_flow import prepare_frame, track_frame

WIDTH, HEIGHT = 642, 203  # no multiples of the reduction
CAMERA = Camera(WIDTH, HEIGHT, 400, 400, 320, 100, 0.2, np.array([0.0, 0.0, 1.2]), AHEAD)
SMALL = DriveConfig(size=(7.0, 5.5), frames=24, frames_per_lap=120, image_size=(640, 192))


def texture(seed):
    """Gray levels (HEIGHT, WIDTH) with structure at full and at reduced resolution."""
    noise = np.random.default_rng(seed).standard_normal((HEIGHT, WIDTH))
    layers = [gaussian_filter(noise, sigma, mode="wrap") * sigma for sigma in (2, 7)]
    return sum(layers)


def gray(image):
    scaled = 128 + 90 * image / np.abs(texture(0)).max()
    return np.rint(scaled.clip(0, 255)).astype(np.uint8)


def moved(image, dx, dy=0.0):
    """The image shifted to the right and down, exactly, around its edges."""
    return np.fft.ifft2(fourier_shift(np.fft.fft2(image), (dy, dx))).real


def drive_of(images, right=None, camera=CAMERA):
    """A drive that stands and sees the images, one a second."""
    n = len(images)
    pairs = list(zip(images, right or [None] * n, strict=True))
    zero = np.zeros((n - 1, 3))
    covariance = np.tile(np.eye(3), (n - 1, 1, 1))
    load = [Frame(float(i), *pair) for i, pair in enumerate(pairs)].__getitem__
    return Drive("images", camera, np.arange(float(n)), zero, covariance, load)


def points(rng, left, right, n=60):
    """(n, 2) pixels between two columns, in the rows of the window."""
    return rng.uniform((left, 75), (right, HEIGHT - 75), (n, 2)).astype(np.float32)


@pytest.mark.parametrize(("budget", "reduction", "height"), [(0.25, 4, 0.5), (0.4, 2, 1.0)])
def test_a_window_and_the_mean_of_each_block_are_all_that_is_seen(budget, reduction, height):
    image = gray(texture(0))
    fovea = Fovea(drive_of([image] * 3), FoveaConfig(budget, reduction, height))
    frame = fovea.drive.load(0)
    seen = frame.periphery
    assert frame.image.size + seen.image.size <= budget * image.size
    assert frame.image.size + seen.image.size > 0.98 * budget * image.size
    column, row = seen.corner
    h, w = frame.image.shape
    assert (w, h) == fovea.window
    assert_array_equal(frame.image, image[row : row + h, column : column + w])
    r = reduction
    blocks = image[: HEIGHT // r * r, : WIDTH // r * r].reshape(HEIGHT // r, r, WIDTH // r, r)
    assert_allclose(seen.image, blocks.mean((1, 3)), atol=0.51)
    assert abs(column + (w - 1) / 2 - CAMERA.cx) <= 1
    assert frame.gaze.pan == pytest.approx(0, abs=0.002)


def test_pixels_of_a_reduced_image_have_the_rays_of_their_middle():
    whole = np.array([[4.0, -1.0, 0.7], [7.0, 2.0, 1.9]])
    xy, _ = to_pixels(CAMERA, whole)
    own, _ = to_pixels(reduced_camera(CAMERA, 4), whole)
    assert_allclose((xy + 0.5) / 4, own + 0.5)


def test_the_window_follows_a_command_after_the_latency_and_between_detections():
    config = FoveaConfig(interval=4, latency=3)
    fovea = Fovea(drive_of([gray(texture(0))] * 20), config)
    left, right = fovea.candidates.pan.max(), fovea.candidates.pan.min()
    fovea.turn_to(1.0, Gaze(left, reason="explore"))
    fovea.turn_to(6.0, Gaze(right, reason="re-detect"))
    numbers = np.random.default_rng(0).permutation(20).tolist()  # in any order
    seen = {number: fovea.drive.load(number).periphery for number in numbers}
    assert [seen[i].corner[0] for i in range(4)] == [seen[0].corner[0]] * 4
    assert [seen[i].corner[0] for i in range(4, 12)] == [0] * 8
    assert [seen[i].corner[0] for i in range(12, 20)] == [WIDTH - fovea.window[0]] * 8
    assert [seen[i].reason for i in (0, 4, 12)] == ["", "explore", "re-detect"]
    assert seen[4].pan == pytest.approx(left)


def test_the_candidates_overlap_by_half_and_cover_the_image():
    fovea = Fovea(drive_of([gray(texture(0))] * 2))
    x = CAMERA.cx - CAMERA.fx * np.tan(fovea.candidates.pan)  # of the middle of each
    width = fovea.window[0]
    assert x[0] == pytest.approx((width - 1) / 2)
    assert x[-1] == pytest.approx(WIDTH - 1 - (width - 1) / 2)
    assert (np.diff(x) <= 0.6 * width).all()


def frames_apart(dx, dy, pans):
    """Two frames of a texture that moves, and where the window looks in each."""
    image = texture(0)
    drive = drive_of([gray(image), gray(image), gray(moved(image, dx, dy))])
    fovea = Fovea(drive, FoveaConfig(interval=1, latency=1))
    for time, pan in enumerate(pans):
        fovea.turn_to(float(time), Gaze(pan))
    return [prepare_frame(fovea.drive.load(number), CAMERA) for number in (1, 2)]


@pytest.mark.parametrize("pans", [(0.0, 0.0), (0.0, 0.1)])
def test_points_are_tracked_finely_in_the_window_and_coarsely_around_it(rng, pans):
    dx, dy = 5.3, -2.6
    before, now = frames_apart(dx, dy, pans)
    assert (before.window.corner == now.window.corner) == (pans[0] == pans[1])
    width = before.window.left.shape[1]
    left = max(each.window.corner[0] for each in (before, now)) + 30
    right = min(each.window.corner[0] for each in (before, now)) + width - 30
    for begin, end, size, error in ((left, right, 1, 0.1), (480, 600, 4, 0.6)):
        xy = points(rng, begin, end)
        found, ok, pixel_size = track_frame(before, now, xy)
        assert ok.mean() > 0.8
        assert (pixel_size[ok] == size).all()
        deviation = np.abs(found[ok] - xy[ok] - (dx, dy))
        assert np.quantile(deviation, 0.9) < error


def test_a_stereo_window_converges_and_measures_finely_what_the_periphery_measures_coarsely(rng):
    disparity = 31.4
    image = texture(0)
    rig = drive_of([gray(image)] * 2, [gray(moved(image, -disparity))] * 2)
    frame = prepare_frame(Fovea(rig).drive.load(0), CAMERA)
    assert abs(frame.window.shift - disparity) <= 4
    true = CAMERA.fx * CAMERA.baseline / disparity
    (column, _), (_, width) = frame.window.corner, frame.window.left.shape
    config = VisualConfig()
    sigmas = []
    for begin, end, error in ((column + 40, column + width - 40, 0.1), (480, 600, 0.8)):
        xy = points(rng, begin, end)
        depth, sigma = measure_depth(CAMERA, frame, xy, config)
        known = np.isfinite(depth)
        assert known.mean() > 0.7
        measured = CAMERA.fx * CAMERA.baseline / depth[known]
        assert np.quantile(np.abs(measured - disparity), 0.8) < error
        sigmas.append(np.median(sigma[known]))
    expected = true**2 * config.disparity_sigma / (CAMERA.fx * CAMERA.baseline)
    assert_allclose(sigmas, (expected, 4 * expected), rtol=0.05)


@pytest.fixture(scope="module")
def ring():
    drive = simulate_drive(SMALL, 2)
    frames = [drive.load(i) for i in range(len(drive))]
    return replace(drive, load=frames.__getitem__)


@pytest.mark.parametrize("policy", ["sweep", "informative"])
def test_a_drive_is_mapped_with_a_quarter_of_the_pixels(ring, policy):
    results = []
    for _ in range(2):  # frames are read ahead by another thread
        fovea = Fovea(ring)
        results.append(visual.run(fovea.drive, gaze=fovea.control(POLICIES[policy](0))))
    assert_array_equal(results[0].trajectory.pose, results[1].trajectory.pose)
    summary = summarize_drive(ring, results[0])
    assert summary["ate_m"] < 0.03
    assert summary["inside_3sigma"] > 0.95
    assert summary["landmarks"] > 10


def test_a_window_that_sweeps_moves_and_its_decisions_say_why(ring):
    fovea = Fovea(ring)
    control = fovea.control(POLICIES["sweep"](0))
    visual.run(fovea.drive, gaze=control)
    assert len(control.decisions) == len(ring) / fovea.config.interval
    columns = {fovea.drive.load(i).periphery.corner[0] for i in range(len(ring))}
    assert len(columns) > 3
    assert fovea.drive.load(len(ring) - 1).gaze.reason == "sweep"


def test_the_middle_alone_is_a_camera_of_its_own(ring):
    fovea = Fovea(ring)
    middle = fovea.middle()
    image, whole = middle.load(0).image, ring.load(0).image
    assert image.shape[:2] == (middle.camera.height, middle.camera.width)
    xyz = np.array([[3.0, 0.2, 0.9]])
    (x, y), (u, v) = (to_pixels(each.camera, xyz)[0][0] for each in (middle, ring))
    column, row = round(u - x), round(v - y)
    h, w = image.shape[:2]
    assert_array_equal(image, whole[row : row + h, column : column + w])


def test_an_evenly_reduced_drive_has_the_blocks_and_the_rays_of_the_whole(ring):
    small = reduced_drive(ring, 2)
    whole, image = ring.load(0).image, small.load(0).image
    assert image.shape[:2] == (small.camera.height, small.camera.width) == (96, 320)
    assert_allclose(image[3, 5], whole[6:8, 10:12].mean((0, 1)), atol=0.51)
    xyz = np.array([[3.0, 0.2, 0.9]])
    own, xy = (to_pixels(each.camera, xyz)[0] for each in (small, ring))
    assert_allclose(own, (xy + 0.5) / 2 - 0.5)


@pytest.mark.parametrize(
    ("changed", "match"),
    [({"budget": 0.05}, "budget: expected more than 0.0625"), ({"reduction": 1}, "reduction")],
)
def test_settings_out_of_range_are_named(changed, match):
    with pytest.raises(ConfigError, match=match):
        FoveaConfig(**changed)


def test_a_periphery_of_another_size_is_named():
    image = gray(texture(0))
    odd = Periphery(image[::4, ::8], None, 4, (10, 10), 10, 0.0)
    with pytest.raises(DriveError, match="expected an image of 160 x 50"):
        prepare_frame(Frame(0.0, image[10:60, 10:200], periphery=odd), CAMERA)


@pytest.mark.parametrize("pan", [np.pi / 2, np.pi, -2.0])
def test_a_camera_that_looks_to_the_side_or_back_has_a_fovea_too(pan):
    camera = CAMERA.turned(CameraTurn(pan))
    fovea = Fovea(drive_of([gray(texture(0))] * 20, camera=camera))
    middle = fovea.drive.load(0).periphery
    assert abs(middle.corner[0] + (fovea.window[0] - 1) / 2 - (WIDTH - 1) / 2) <= 1
    assert abs((middle.pan - pan + np.pi) % (2 * np.pi) - np.pi) < 0.01
    assert np.ptp(fovea.candidates.pan) < 1.2
    fovea.turn_to(0.0, Gaze(pan + 2.0 - 2 * np.pi))  # beyond the image, a turn less
    assert fovea.drive.load(8).periphery.corner[0] == 0


def test_images_too_small_for_a_fovea_are_told():
    small = replace(CAMERA, width=60, height=40)
    with pytest.raises(DriveError, match=r"found 22 x 20 pixels of 60 x 40"):
        Fovea(drive_of([gray(texture(0))[:40, :60]] * 2, camera=small))


def test_landmarks_count_as_far_as_a_robot_comes_in_four_seconds():
    for speed, expected in ((0.5, 8.0), (5.0, 20.0), (90.0, 100.0)):
        drive = drive_of([gray(texture(0))] * 5)
        drive = replace(drive, control=np.tile([speed, 0.0, 0.0], (4, 1)))
        assert Fovea(drive).limits.max_range == pytest.approx(expected)
    assert Fovea(drive, FoveaConfig(max_range=3.0)).limits.max_range == 3.0


def test_a_frame_is_shown_whole_its_periphery_in_coarse_pixels():
    image = gray(texture(0))
    fovea = Fovea(drive_of([image] * 2))
    frame = fovea.drive.load(0)
    shown, (column, row), (h, w) = foveated_image(frame), frame.periphery.corner, frame.image.shape
    assert shown.shape == (200, 640)
    inside = np.s_[row : row + h, column : column + w]
    assert_array_equal(shown[inside], image[inside])
    assert_array_equal(shown[:4, :4], frame.periphery.image[0, 0])
    assert foveated_image(Frame(0.0, image)) is image


def test_depth_images_are_cut_and_reduced_as_the_images_are():
    image = gray(texture(0))
    depth = 1.0 + np.arange(image.size, dtype=float).reshape(image.shape)
    drive = drive_of([image] * 2)
    drive = replace(drive, load=lambda i: Frame(float(i), image, depth=depth))
    fovea = Fovea(drive)
    column, row = fovea.drive.load(0).periphery.corner
    w, h = fovea.window
    middle = fovea.middle().load(0)
    assert_array_equal(middle.depth, depth[row : row + h, column : column + w])
    assert middle.depth.shape == middle.image.shape
    small = reduced_drive(drive, 4).load(0)
    assert_array_equal(small.depth[:50, :160], depth[2:202:4, 2:642:4])
