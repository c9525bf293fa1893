"""A fovea: of each wide image a window at full resolution, and the whole at a reduced one."""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from saccade.errors import DriveError, require, require_ranges
from saccade.frames import Camera, Drive, Frame, Gaze, GazeLimits, Periphery
from saccade.slam.models import wrap
from saccade.types import FloatArray, Image
from saccade.visual.camera import directions, reduced_camera, to_pixels
from saccade.visual.gaze import Candidates, Policy
from saccade.visual.gaze_control import GazeControl
from saccade.visual.optical_flow import ByteArray, gray_bytes, reduced_image

MIN_SIDE = 8
"""Reduced pixels of the sides of a window, at least."""
FASTEST = 1e3
"""Radians per second: a window jumps at once."""
SECONDS_AHEAD, MIN_RANGE, MAX_RANGE = 4.0, 8.0, 100.0
"""Of the way within which landmarks count, and the least and greatest such range in meters."""


@dataclass(frozen=True)
class FoveaConfig:
    """Budget of pixels, and how often and how late a window moves.

    Raises:
        ConfigError: a setting outside its range, or a budget that the periphery alone exceeds.
    """

    budget: float = 0.25
    """Pixels of window and periphery together, as a fraction of those of the image."""
    reduction: int = 4
    """Pixels of the image along each side of a pixel of the periphery."""
    height: float = 0.5
    """Height of the window, as a fraction of that of the image; it is centered on the horizon."""
    interval: int = 4
    """The window may move in every so many frames: those in which points are detected."""
    latency: int = 4
    """Frames from a decision to the first one that follows it; one less are read ahead."""
    max_range: float | None = None
    """Meters within which landmarks and salient places count; by default the way of 4 seconds at
    the median speed, and at least 8 m."""

    def __post_init__(self) -> None:
        require_ranges(self, budget=(0, 1), reduction=(2, 64), interval=(1, 1000))
        require_ranges(self, latency=(1, 1000), height=(0.01, 1))
        if self.max_range is not None:
            require_ranges(self, max_range=(0.1, 1e4))
        least = 1 / self.reduction**2
        expected = f"more than {least:.3g}, the part of the periphery"
        require(self.budget > least, "budget", expected, self.budget)

    def window_size(self, camera: Camera) -> tuple[int, int]:
        """Width and height of the window in pixels."""
        share = (self.budget - 1 / self.reduction**2) / self.height
        width = min(max(1, int(share * camera.width)), camera.width)
        return width, max(1, int(self.height * camera.height))


class Fovea:
    """A window of the images of a drive that moves as it is told.

    Args:
        drive: a drive with images.
        config: the budget of pixels.

    Raises:
        DriveError: the images are too small for a periphery.
    """

    def __init__(self, drive: Drive, config: FoveaConfig | None = None) -> None:
        self.config = config or FoveaConfig()
        self.drive = replace(drive, load=self._load)
        """The drive with a `Periphery` in each frame; a frame can be loaded once all commands up
        to `FoveaConfig.latency` frames before it were given. `load` raises `DriveError` for tracked
        points."""
        self._source, camera = drive, drive.camera
        self.window = self.config.window_size(camera)
        """Width and height in pixels."""
        width, height = self.window
        if min(width, height) < MIN_SIDE * self.config.reduction:
            raise DriveError(
                f"{drive.name}: expected a fovea's window of at least {MIN_SIDE} reduced pixels on "
                f"each side, found {width} x {height} pixels of {camera.width} x {camera.height}"
            )
        overlapping = max(2 * round(camera.width / width - 1), 2 * (camera.width > width)) + 1
        pan = self._pan(np.linspace(0, camera.width - width, overlapping))
        self._center = float(pan[len(pan) // 2])
        pan = self._center + wrap(pan - self._center)
        seconds = float(np.median(np.diff(drive.time))) if len(drive) > 1 else 0.0
        self._interval = (self.config.interval - 0.5) * seconds  # half a frame of jitter
        latency = self.config.latency * seconds
        self.limits = GazeLimits(
            pan=(float(pan.min()), float(pan.max())),
            rate=FASTEST,
            latency=latency,
            max_range=self.config.max_range or _usual_range(drive),
        )
        """Of its motion: it jumps after the latency."""
        angles = (float(2 * np.arctan(width / 2 / camera.fx)), float(height / camera.fy))
        self.candidates = Candidates(pan, np.zeros(len(pan)), angles)
        """Windows that overlap by half."""
        sees_ahead = self.limits.pan[0] <= 0 <= self.limits.pan[1]
        self._start = self._corner(0.0 if sees_ahead else self._center)
        self._time, self._commands = [-np.inf], [(self._start, "")]

    def control(self, policy: Policy) -> GazeControl:
        """What decides where the window is, for `saccade.visual.run`."""
        arguments = policy, self.candidates, self.limits, self.turn_to
        return GazeControl(*arguments, self._interval, self.config.latency)

    def middle(self) -> Drive:
        """The drive with the window in the middle of its images, and nothing around it."""
        (column, row), (width, height) = self._start, self.window
        camera = self._source.camera
        cx, cy = camera.cx - column, camera.cy - row
        camera = replace(camera, width=width, height=height, cx=cx, cy=cy)

        def crop(image: Image) -> Image:
            return self._crop(image, (column, row))

        return _with_images(self._source, camera, crop, crop)

    def turn_to(self, time: float, gaze: Gaze) -> None:
        """Move the window after the latency; commands come in the order of their times."""
        self._commands.append((self._corner(gaze.pan), gaze.reason))
        self._time.append(time)

    def _corner(self, pan: float) -> tuple[int, int]:
        """First column and row of the window nearest to a pan."""
        camera, limits = self._source.camera, np.array(self.limits.pan)
        pan = self._center + float(np.clip(wrap(pan - self._center), *(limits - self._center)))
        ahead = camera.position + np.array([np.cos(pan), np.sin(pan), 0.0])
        center = to_pixels(camera, ahead[None])[0][0]
        column, row = np.rint(center - (np.array(self.window) - 1) / 2)
        width, height = self.window
        last = camera.width - width, camera.height - height
        return int(np.clip(column, 0, last[0])), int(np.clip(row, 0, last[1]))

    def _pan(self, columns: FloatArray) -> FloatArray:
        """(n,) directions of the middle of windows that begin at columns (n,)."""
        camera = self._source.camera
        xy = np.stack([columns + (self.window[0] - 1) / 2, np.full(len(columns), camera.cy)], 1)
        x, y, _ = (directions(camera, xy) @ camera.rotation.T).T
        return np.asarray(np.arctan2(y, x))

    def _load(self, number: int) -> Frame:
        frame, config, source = self._source.load(number), self.config, self._source
        if frame.tracks is not None:
            raise DriveError(f"{source.name}: expected images for a fovea, found tracked points")
        if frame.image is None:
            return frame
        decided = number - number % config.interval - config.latency
        before = float(source.time[decided]) if decided >= 0 else -np.inf
        corner, reason = self._commands[bisect_right(self._time, before) - 1]
        r, right_column, right, right_window = config.reduction, corner[0], None, None
        whole, window = reduced_image(frame.image, r), self._crop(frame.image, corner)
        if frame.right is not None:
            right = reduced_image(frame.right, r)
            place = (each // r for each in (*corner, *self.window))
            right_column -= r * vergence(gray_bytes(whole), gray_bytes(right), *place)
            right_column = max(right_column, 0)
            right_window = self._crop(frame.right, (right_column, corner[1]))
        pan = float(self._pan(np.array([corner[0]]))[0])
        periphery = Periphery(whole, right, r, corner, right_column, pan, reason)
        return replace(frame, image=window, right=right_window, periphery=periphery)

    def _crop(self, image: Image, corner: tuple[int, int]) -> Image:
        (column, row), (width, height) = corner, self.window
        return np.ascontiguousarray(image[row : row + height, column : column + width])


def _usual_range(drive: Drive) -> float:
    """Meters within which landmarks count for a robot that is as fast as this one."""
    if len(drive) < 2:
        return MIN_RANGE
    seconds = np.maximum(np.diff(drive.time), 1e-6)
    speed = float(np.median(np.hypot(*drive.control[:, :2].T) / seconds))
    return min(max(MIN_RANGE, SECONDS_AHEAD * speed), MAX_RANGE)


def reduced_drive(drive: Drive, reduction: int) -> Drive:
    """A drive whose images are evenly reduced by a whole number, and its camera with them."""

    def nearest(depth: FloatArray) -> FloatArray:
        return depth[reduction // 2 :: reduction, reduction // 2 :: reduction]

    camera = reduced_camera(drive.camera, reduction)
    return _with_images(drive, camera, lambda image: reduced_image(image, reduction), nearest)


def _with_images(
    drive: Drive,
    camera: Camera,
    change: Callable[[Image], Image],
    change_depth: Callable[[FloatArray], FloatArray],
) -> Drive:
    """A drive of another camera, whose images and depth images are changed as they are loaded."""

    def load(number: int) -> Frame:
        frame = drive.load(number)
        left, right = (
            None if image is None else change(image) for image in (frame.image, frame.right)
        )
        depth = None if frame.depth is None else change_depth(frame.depth)
        return replace(frame, image=left, right=right, depth=depth)

    return replace(drive, camera=camera, load=load)


def vergence(
    left: ByteArray, right: ByteArray, column: int, row: int, width: int, height: int
) -> int:
    """Columns by which a window of the left image is found to the left in the right image."""
    rows = slice(row, row + height)
    window = np.ascontiguousarray(left[rows, column : column + width])
    strip = np.ascontiguousarray(right[rows, : column + window.shape[1]])
    match = cv2.matchTemplate(strip, window, cv2.TM_CCOEFF_NORMED)
    return column - int(np.argmax(match[0]))
