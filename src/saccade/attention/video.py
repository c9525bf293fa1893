"""Video saliency: static saliency, flicker and motion, with a simulated gaze.

Flicker is the temporal difference of luminance, motion its opponent (Reichardt) correlation in four
directions. Both compare a frame with an earlier frame, after compensating for camera motion. Like
the features of contrast saliency, both pass through center-surround differences over a pyramid and
the normalization N.

Source: Itti, Dhavale & Pighin (2003), *Realistic avatar eye and head animation using a
neurobiological model of visual attention*. They correlate oriented filters, where this module
correlates differences of neighboring levels, and they do not compensate for camera motion.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np

from saccade.attention.channels import intensity
from saccade.attention.combined import attention_maps
from saccade.attention.contrast import existing_scales
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.contrast_steps import MIRRORED, difference, normalize_map
from saccade.attention.maps import SaliencyMaps
from saccade.attention.normalize import smooth
from saccade.attention.scanpath_model import ScanpathModelConfig, next_fixation_density
from saccade.errors import ImageError, Settings, require, setting
from saccade.io.image import check_image, in_unit_range, repeat_gray
from saccade.scale.pyramid import FloatMap, cell_centers, halve, resize
from saccade.types import BoolArray, Float32Array, FloatArray, Image

WINDOW = (15, 15)
"""Width and height of the tracking window in pixels."""
MAX_CAMERA_CORNERS = 200
"""Maximum number of corners for the estimate of camera motion."""
QUALITY = 0.01
"""Minimum quality of a corner, as a fraction of the best corner's quality."""
MIN_CORNER_SPACING = 8
"""Minimum distance between corners, in pixels."""
RANSAC_DISTANCE = 1.0
"""Maximum residual in pixels of a point that moves with the camera."""
TILES = 4
"""Number of tiles along each side of the image."""
MIN_TILES = 5
"""Minimum number of tiles with points that move with the camera; a single object covers fewer."""


def tracked(
    before: Float32Array, now: Float32Array, points: Float32Array
) -> tuple[Float32Array, BoolArray]:
    """Tracks points from one image to the next (pyramidal Lucas-Kanade).

    Args:
        before: (H, W) earlier image in [0, 1].
        now: (H, W) later image.
        points: (n, 2) x and y in pixels.

    Returns:
        (n, 2) new positions in pixels, and (n,) True for the points that were found.
    """
    first, second = (np.rint(image * 255).astype(np.uint8) for image in (before, now))
    after, found, _ = cv2.calcOpticalFlowPyrLK(first, second, points, points.copy(), winSize=WINDOW)
    return np.asarray(after, np.float32), np.asarray(found, np.bool_).ravel()


def camera_motion(before: Float32Array, now: Float32Array) -> FloatArray:
    """Camera motion between two images: (3, 3) similarity in homogeneous pixels.

    The result is the identity if too few corners agree or the corners lie close together, since an
    object moving before a uniform background is not camera motion. Arguments as for `tracked`.
    """
    corners = np.asarray(
        cv2.goodFeaturesToTrack(before, MAX_CAMERA_CORNERS, QUALITY, MIN_CORNER_SPACING), np.float32
    )
    points = corners.reshape(-1, 2) if corners.ndim == 3 else np.zeros((0, 2), np.float32)
    if len(points) < MIN_TILES:
        return np.eye(3)
    after, found = tracked(before, now, points)
    points, after = points[found], after[found]
    if len(points) < MIN_TILES:
        return np.eye(3)
    similarity, inliers = cv2.estimateAffinePartial2D(
        points, after, ransacReprojThreshold=RANSAC_DISTANCE
    )
    tiles = np.floor(points[np.ravel(inliers) == 1] * TILES / before.shape[::-1])
    if len(np.unique(tiles, axis=0)) < MIN_TILES:
        return np.eye(3)
    return np.vstack([similarity, [0, 0, 1]])


def moved(
    image: Float32Array,
    motion: FloatArray,
    shape: tuple[int, ...],
    onto: Float32Array | None = None,
) -> Float32Array:
    """The image warped by a motion.

    Args:
        image: (h, w).
        motion: (3, 3) homogeneous motion, in pixels of the image at size `shape`.
        shape: (H, W) for which the motion is given.
        onto: (h, w) values where the warped image has no pixel; None for the image itself.
    """
    y, x = (h / H for h, H in zip(image.shape, shape, strict=True))
    scaling = np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])
    rescaled = (scaling @ motion @ np.linalg.inv(scaling))[:2]
    under = (image if onto is None else onto).copy()
    size = image.shape[1], image.shape[0]
    result = cv2.warpAffine(image, rescaled, size, under, borderMode=cv2.BORDER_TRANSPARENT)
    return np.asarray(result, np.float32)


CHANGES = ContrastConfig(scales=((1, 3), (2, 4), (3, 5)), scale_weights=(1.0, 1.0, 1.0))
"""Scales and normalization of flicker and motion."""
SEMISATURATION = 0.05
"""Change of luminance, in [0, 1], with half the maximum response. Without it, the normalization
would raise noise to the level of motion."""
DELAY = 0.04
"""Nominal delay between the compared frames in seconds; the nearest earlier frame is used."""
TIME_CONSTANT = 0.1
"""Time constant of the saliency's low-pass filter, in seconds."""
POOLING = 2.0
"""Standard deviation, in cells, of the Gaussian that averages the correlations."""
REACH = 2
"""Radius in cells within which a saccade lands on the most salient cell."""
MAX_TRACKED_FIXATIONS = 20
"""Number of past fixations that are tracked; the inhibition by earlier fixations has decayed."""


@dataclass(frozen=True)
class VideoConfig(Settings):
    """Settings of static saliency and gaze; times are in seconds, independent of the frame rate."""

    static_interval: float = setting(0.1, 0, 2**31)
    """Interval between updates of the static saliency, the slowest step; in between, the map is
    warped with the scene. 0 updates it at each frame."""
    scanpath: ScanpathModelConfig = field(default_factory=lambda: ScanpathModelConfig(exponent=2))
    """Model of the gaze. The exponent is not fitted: after the onset, gazes differ more between
    subjects in a photograph than in a video (Dorr, Martinetz, Gegenfurtner & Barth 2010,
    *Variability of eye movements when viewing dynamic natural scenes*)."""
    seed: int = setting(0, 0, 2**31)
    """Seed of the random numbers of the gaze."""


@dataclass(frozen=True, eq=False, repr=False)
class VideoMaps(SaliencyMaps):
    """Saliency and gaze at a frame, computed causally. Maps are (h, w) float32.

    The saliency is in [0, 1] and equals `static` while nothing changes.
    """

    static: Float32Array
    """Static saliency of the frame, or of a frame up to `static_interval` earlier, warped to it."""
    flicker: Float32Array
    """(h, w) flicker in [0, 1]; a single strong change reaches 1."""
    directions: Float32Array
    """(4, h, w) motion to the right, down, to the left and up relative to the scene, in [0, 1]; a
    single moving object of high contrast reaches 1."""
    gaze: tuple[float, float]
    """x and y of the gaze in pixels of the frame."""

    @property
    def motion(self) -> Float32Array:
        """(h, w) sum of the directions."""
        return np.asarray(self.directions.sum(0))

    @property
    def layers(self) -> dict[str, Float32Array]:
        """The maps by name."""
        return {name: getattr(self, name) for name in ("saliency", "static", "flicker", "motion")}


class _Past(NamedTuple):
    """An earlier frame."""

    time: float
    luminance: Float32Array
    """Luminance at the finest level of the scales."""
    camera: FloatArray
    """(3, 3) motion of the scene since then, in cells of that level."""


class VideoSaliency:
    """Computes saliency and gaze of a video, frame by frame.

    The gaze starts at the center. Each fixation lasts for a duration drawn from the scanpath model;
    the next fixation is drawn from `next_fixation_density` of the current saliency, and the gaze
    stays if it is adjacent. During a fixation the gaze pursues its target, and inhibition of return
    moves with the earlier targets.

    Args:
        config: static saliency and gaze.
        static: function that returns the nonnegative saliency (h, w) of a single frame, scaled down
            to a maximum of 1 if necessary; None for `attention_saliency`.

    Examples:
        >>> import numpy as np
        >>> video = saccade.VideoSaliency()
        >>> frames = np.zeros((2, 90, 160), np.float32)
        >>> frames[0, 40:50, 20:30] = frames[1, 40:50, 23:33] = 1
        >>> maps = [video(frame, number / 25) for number, frame in enumerate(frames)][-1]
        >>> int(maps.directions.max((1, 2)).argmax())  # to the right
        0
    """

    def __init__(
        self,
        config: VideoConfig | None = None,
        static: Callable[[Image], FloatMap] | None = None,
    ) -> None:
        self.config = config or VideoConfig()
        self._compute_static = static or (lambda frame: attention_maps(frame).saliency)
        self._static_due = -np.inf  # in seconds
        self._past = deque[_Past]()
        self._static = self._summed = np.zeros((0, 0), np.float32)  # of the last frame
        self._shape: tuple[int, ...] = ()  # of the frames
        self._gaze = _Gaze(self.config)

    def __call__(self, frame: Image, time: float) -> VideoMaps:
        """Saliency and gaze at the next frame.

        Args:
            frame: (H, W) or (H, W, 3) RGB, the same size as earlier frames.
            time: time in seconds, later than the previous frame.

        Raises:
            ImageError: as `attention_saliency`, or the size has changed.
            ConfigError: the time is not finite or not later.
        """
        pixels = check_image(frame)
        shape = pixels.shape[0], pixels.shape[1]
        if self._shape and shape != self._shape:
            raise ImageError(f"frame: expected {self._shape} px as before, found {shape}")
        require(np.isfinite(time), "time", "a finite number of seconds", time)
        contrast = CHANGES.at_size(shape)
        luminance = luminance_at(pixels, min(center for center, _ in contrast.scales))
        if not self._shape:  # the first frame is compared to itself
            self._past = deque([_Past(-np.inf, luminance, np.eye(3))])
        last = self._past[-1]
        require(time > last.time, "time", "later than the frame before", time)

        camera = camera_motion(last.luminance, luminance)
        before = self._compared(time - DELAY, camera, luminance)
        static = self._static_map(pixels, time, camera)
        changes = change_maps(before, luminance, contrast, shape, static.shape)
        summed = static + changes.sum(0)
        if self._summed.shape == summed.shape:
            remaining = np.exp((last.time - time) / TIME_CONSTANT)
            filtered = moved(self._summed, camera, luminance.shape)
            summed += np.float32(remaining) * (filtered - summed)
        saliency = summed / np.float32(max(1.0, summed.max()))

        self._gaze.follow(last.luminance, luminance, camera, shape)
        gaze = self._gaze.move(saliency, shape, time)
        self._past.append(_Past(time, luminance, np.eye(3)))
        self._shape, self._static, self._summed = shape, static, summed
        return VideoMaps(saliency, shape, static, changes[0], changes[1:], gaze)

    def _compared(self, time: float, camera: FloatArray, now: Float32Array) -> Float32Array:
        """The earlier luminance nearest to a time, warped with the scene; discards older frames."""
        self._past = deque(past._replace(camera=camera @ past.camera) for past in self._past)
        nearest = min(self._past, key=lambda past: abs(past.time - time))
        while self._past[0] is not nearest:
            self._past.popleft()
        return moved(nearest.luminance, nearest.camera, now.shape, onto=now)

    def _static_map(self, frame: Image, time: float, camera: FloatArray) -> Float32Array:
        """The static saliency, updated if due or else warped with the scene."""
        if time < self._static_due:
            return moved(self._static, camera, self._past[-1].luminance.shape)
        self._static_due = time + self.config.static_interval - 1e-6  # times are rounded
        static = np.asarray(self._compute_static(frame), np.float32)
        return static / np.float32(max(1.0, static.max()))


class _Gaze:
    """The current and past fixations, and the end time of the current fixation."""

    def __init__(self, config: VideoConfig) -> None:
        self._model = config.scanpath
        self._rng = np.random.default_rng(config.seed)
        self._path = np.zeros((0, 2))  # in pixels of the frame, the present fixation last
        self._end = 0.0

    def follow(
        self,
        before: Float32Array,
        now: Float32Array,
        camera: FloatArray,
        shape: tuple[int, int],
    ) -> None:
        """Moves each fixation with its target, or with the scene if tracking fails."""
        if len(self._path) == 0:
            return
        last, scale = np.array(shape[::-1]) - 1, np.divide(now.shape, shape)[::-1]
        points = ((self._path + 0.5) * scale - 0.5).astype(np.float32)
        after, found = tracked(before, now, points)
        with_scene = points @ camera[:2, :2].T + camera[:2, 2]
        path = (np.where(found[:, None], after, with_scene) + 0.5) / scale - 0.5
        path[-1] = path[-1].clip(0, last)
        self._path = path[((path >= 0) & (path <= last)).all(1)]

    def move(
        self, saliency: Float32Array, shape: tuple[int, int], time: float
    ) -> tuple[float, float]:
        """Returns the gaze at a time, after a saccade if the fixation has ended."""
        if len(self._path) == 0:
            self._path = np.array([[(shape[1] - 1) / 2, (shape[0] - 1) / 2]])
            self._end = time + self._duration()
        elif time >= self._end:
            density = next_fixation_density(SaliencyMaps(saliency, shape), self._path, self._model)
            drawn = np.searchsorted(density.cumsum(), self._rng.random())
            row, column = divmod(min(int(drawn), density.size - 1), density.shape[1])
            top, left = max(row - REACH, 0), max(column - REACH, 0)
            near = saliency[top : row + REACH + 1, left : column + REACH + 1]
            row, column = np.add(np.unravel_index(near.argmax(), near.shape), (top, left))
            position = cell_centers([row], [column], density.shape, shape)[0]
            cell = np.divide(shape, density.shape)[::-1]
            if (abs(position - self._path[-1]) <= cell).all():
                position = self._path[-1]
            self._path = np.vstack([self._path[-MAX_TRACKED_FIXATIONS:], position])
            self._end = max(time, self._end + self._duration())
        return float(self._path[-1, 0]), float(self._path[-1, 1])

    def _duration(self) -> float:
        """Draws the duration of a fixation in seconds."""
        shape = self._model.duration_shape
        return float(self._rng.gamma(shape, self._model.duration_mean / shape))


def luminance_at(pixels: Image, level: int) -> Float32Array:
    """Luminance of a validated image at a pyramid level, in [0, 1] (A.1, A.4)."""
    for _ in range(level):
        pixels = halve(pixels)
    return np.asarray(intensity(repeat_gray(in_unit_range(pixels))), np.float32)


def change_maps(
    before: Float32Array,
    now: Float32Array,
    contrast: ContrastConfig,
    image_shape: tuple[int, int],
    map_shape: tuple[int, int],
) -> Float32Array:
    """Flicker, and motion to the right, down, to the left and up: (5, h, w) in [0, 1].

    Args:
        before: earlier luminance, at the finest level of the scales.
        now: later luminance.
        contrast: scales, adapted `at_size` of the image, and normalization.
        image_shape: (H, W) of the frame.
        map_shape: (h, w) of the maps.
    """
    scales = existing_scales(image_shape, contrast, MIRRORED)["intensity"]
    first = min(scale.center for scale in scales)
    changes = list[list[Float32Array]]()  # one for each level
    for _ in range(first, max(scale.surround for scale in scales) + 1):
        coarser = halve(before), halve(now)
        bands = (a - resize(b, a.shape) for a, b in zip((before, now), coarser, strict=True))
        changes.append([abs(now - before), *opponent_motion(*bands)])
        before, now = coarser
    maps = np.zeros((5, *map_shape), np.float32)
    for center, surround, weight in scales:
        pairs = zip(changes[center - first], changes[surround - first], strict=True)
        for total, pair in zip(maps, pairs, strict=True):
            values = difference(*pair, map_shape, contrast)  # A.7-A.10
            values = normalize_map(smooth(values, contrast.smoothing), contrast)
            peak = float(pair[0].max())
            total += weight * peak**2 / (peak**2 + SEMISATURATION**2) * values
    maps /= sum(scale.weight for scale in scales)
    return np.asarray(maps**contrast.sharpening, np.float32)


def opponent_motion(before: FloatMap, now: FloatMap) -> list[Float32Array]:
    """Root of the pooled opponent correlation (Reichardt 1961): right, down, left, up, (h, w) each.

    The correlation to the right is `before(x - 1) now(x) - now(x - 1) before(x)`, averaged with the
    same term at x + 1, and pooled over a neighborhood; only positive means count. Motion to the
    left has the opposite sign.
    """
    correlations = (
        before * cv2.Sobel(now, -1, *axis, ksize=1) - now * cv2.Sobel(before, -1, *axis, ksize=1)
        for axis in ((1, 0), (0, 1))
    )
    across, downward = (smooth(each / 2, POOLING) for each in correlations)
    return [np.sqrt(np.maximum(each, 0)) for each in (across, downward, -across, -downward)]
