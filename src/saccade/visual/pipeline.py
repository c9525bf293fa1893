"""The whole chain: attend, detect, track, observe, associate, update, and manage the map."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.frames import Drive, Frame
from saccade.slam.recording import Recorder
from saccade.types import IntArray, Keypoints
from saccade.visual.camera import Sightings, is_inside, to_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.frontend import Detector, Followed, View, look, observe, track
from saccade.visual.mapping import VisualMap
from saccade.visual.recognition import agreeing, keep_apart, look_alikes, within_gate
from saccade.visual.recording import FOLLOWED, RECOGNIZED, TAKEN_IN, Recording
from saccade.visual.result import VisualResult
from saccade.visual.selection import attend, preference


def run(
    drive: Drive,
    config: VisualConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    recorder: Recorder | None = None,
) -> VisualResult:
    """Map a drive.

    Args:
        drive: frames and odometry.
        config: how to look and to map.
        progress: called with the number of frames done and of all frames.
        recorder: takes snapshots of the map while it grows.

    Returns:
        The way, the map, and what was seen of it when.

    Raises:
        DriveError: images that do not fit the calibration.
    """
    pipeline = Pipeline(drive, config or VisualConfig())
    for number in range(len(drive)):
        pipeline.step(number)
        if recorder is not None:
            seen = pipeline.world.landmarks.rows(pipeline.followed.landmark)
            recorder.add(number, len(drive), pipeline.world.ekf, seen)
        if progress is not None:
            progress(number + 1, len(drive))
    return pipeline.result()


class Pipeline:
    """A drive on its way through the chain, frame by frame.

    Args:
        drive: frames and odometry.
        config: how to look and to map.
    """

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        self.drive, self.config = drive, config
        self.world = VisualMap(drive, config)
        self.followed = Followed()
        self.recording = Recording(drive)
        self._detect = Detector(config)
        self._last = View(Frame(float(drive.time[0])))

    def step(self, number: int) -> None:
        """Go on by one frame."""
        note, world, camera = self.recording, self.world, self.drive.camera
        with note.timed("read"):
            view = look(self._load(number), camera)
        with note.timed("track"):
            self.followed, motion = track(camera, self._last, view, self.followed)
        with note.timed("predict"):
            before = world.ekf.pose
            expected = world.predict(number, motion) if number > 0 else np.zeros(3)
        with note.timed("observe"):
            seen, useful = observe(camera, self.followed.xy, self.followed.depth, self.config)
        with note.timed("update"):
            self._meet(number, FOLLOWED, self.followed[useful], _some(seen, useful))
        if number % self.config.every == 0 and not view.blind:
            self._renew(number, view)
        world.moved(number, before, len(self.followed))
        note.moved(expected, motion)
        note.believed(world.ekf.pose, world.ekf.pose_covariance)
        if not view.blind:
            self._last = view

    def result(self) -> VisualResult:
        """What has come of it so far."""
        return self.recording.result(self.world)

    def _renew(self, number: int, view: View) -> None:
        """Find what is in view: landmarks that were lost from sight, and new ones."""
        note, world, camera, config = self.recording, self.world, self.drive.camera, self.config
        with note.timed("detect"):
            points = self._detect(view)
            depth = self._detect.depths(camera, view, points)
            seen, useful = observe(camera, points.xy, depth, config)
            free = useful & ~self._near(points)
            points, depth, seen = points[free], depth[free], _some(seen, free)
            named = view.frame.tracks
            tracks = np.full(len(points), -1) if named is None else named.id[free]
        with note.timed("associate"):
            pairs = self._recognize(points, seen)
        with note.timed("update"):
            known = Followed(
                points.xy[pairs[:, 0]],
                depth[pairs[:, 0]],
                world.landmarks.id[pairs[:, 1]],
                tracks[pairs[:, 0]],
            )
            self._meet(number, RECOGNIZED, known, _some(seen, pairs[:, 0]))
            self.followed = self.followed.joined(known)
        with note.timed("attend"):
            image = view.frame.image
            saliency = None if image is None else attend(image, config)
            share = np.sqrt(seen.covariance[:, 0, 0]) / seen.z[:, 0]
            shape = (camera.height, camera.width)
            order = preference(points, share, saliency, shape, config, number)
            order = order[~np.isin(order, pairs[:, 0])]
            free_places = max(0, config.in_view - len(self.followed))
            count = min(config.new_per_frame * config.every, free_places)
            chosen = keep_apart(points.xy, order, self.followed.xy, config.apart, count)
        with note.timed("manage"):
            assert points.descriptors is not None
            new = _some(seen, chosen)
            landmark = world.take_in(new, points.descriptors[chosen], number)
            added = Followed(points.xy[chosen], depth[chosen], landmark, tracks[chosen])
            note.meetings(number, TAKEN_IN, landmark, added.xy, new)
            self.followed = self.followed.joined(added)
            world.shrink(self.followed.landmark, number)
            self.followed = self.followed[world.landmarks.rows(self.followed.landmark) >= 0]

    def _recognize(self, points: Keypoints, seen: Sightings) -> IntArray:
        """(m, 2) points and rows of the landmarks that they are."""
        world, config = self.world, self.config
        rows = self._in_view()
        if len(rows) == 0 or len(points) == 0:
            return np.zeros((0, 2), np.int64)
        pairs = look_alikes(points, world.landmarks.descriptor[rows], config.ratio)
        pairs[:, 1] = rows[pairs[:, 1]]
        expected = world.expect(pairs[:, 1])
        height = world.landmarks.height[pairs[:, 1]]
        fits = within_gate(_some(seen, pairs[:, 0]), expected, height, config.gate)
        pairs = pairs[fits]
        agree = agreeing(seen.z[pairs[:, 0]], world.ekf.landmarks[pairs[:, 1]])
        pairs = pairs[agree]
        missed = rows[~np.isin(rows, pairs[:, 1])]
        world.landmarks.missed[missed] += 1
        self.recording.missed += len(missed)
        return pairs

    def _in_view(self) -> IntArray:
        """(m,) rows of landmarks that are not followed and should be in view."""
        world, camera = self.world, self.drive.camera
        if len(world.landmarks) == 0:
            return np.zeros(0, np.int64)
        z, S = world.ekf.expect()
        slack = 3 * np.sqrt(S[:, 1, 1])
        xyz = np.stack(
            [z[:, 0] * np.cos(z[:, 1]), z[:, 0] * np.sin(z[:, 1]), world.landmarks.height], 1
        )
        xy, _ = to_pixels(camera, xyz)
        border = -camera.fx * np.tan(slack.clip(0, 1.5))
        inside = is_inside(camera, xy, np.maximum(border, -camera.width))
        inside &= z[:, 0] < self.config.reach[1] + 3 * np.sqrt(S[:, 0, 0])
        inside[world.landmarks.rows(self.followed.landmark)] = False
        return np.flatnonzero(inside)

    def _near(self, points: Keypoints) -> npt.NDArray[np.bool_]:
        """(n,) whether points are on one that is followed."""
        if len(self.followed) == 0 or len(points) == 0:
            return np.zeros(len(points), np.bool_)
        apart = points.xy[:, None] - self.followed.xy
        return np.asarray((np.square(apart).sum(2) < (self.config.apart / 2) ** 2).any(1))

    def _meet(self, number: int, kind: int, points: Followed, seen: Sightings) -> None:
        self.world.meet(points.landmark, seen, number)
        self.recording.meetings(number, kind, points.landmark, points.xy, seen)

    def _load(self, number: int) -> Frame:
        """The frame, empty where it cannot be read."""
        try:
            return self.drive.load(number)
        except ImageError as error:
            self.recording.remarks.append(str(error))
            return Frame(float(self.drive.time[number]))


def _some(seen: Sightings, index: npt.NDArray[Any]) -> Sightings:
    return Sightings(seen.z[index], seen.covariance[index], seen.height[index])
