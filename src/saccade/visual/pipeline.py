"""The whole chain: attend, detect, track, observe, associate, update, and manage the map."""

from collections.abc import Callable
from dataclasses import fields, replace
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.frames import Drive, Frame
from saccade.pyramid import FloatMap
from saccade.slam.checkpoint import Checkpoint
from saccade.slam.results import Expectation
from saccade.slam.snapshots import Recorder
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import Sightings, is_inside, some, to_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Motion, camera_motion
from saccade.visual.frame_features import Memory, Senses
from saccade.visual.frontend import (
    Followed,
    View,
    bearing_alone,
    observe,
    tells_depth,
    track,
)
from saccade.visual.ground_scale import Road
from saccade.visual.prefetch import Ahead, side_by_side
from saccade.visual.reidentification import (
    ASIDE,
    TOLERANCE,
    agreeing,
    borne_out,
    keep_apart,
    look_alikes,
    rehearsed,
    within_gate,
)
from saccade.visual.result import VisualResult
from saccade.visual.run_log import FOLLOWED, RECOGNIZED, TAKEN_IN, Recording
from saccade.visual.selection import preference
from saccade.visual.triangulation import CameraWay
from saccade.visual.visual_map import VisualMap


def run(
    drive: Drive,
    config: VisualConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    recorder: Recorder | None = None,
    memory: Memory | None = None,
    checkpoint: Checkpoint | None = None,
) -> VisualResult:
    """Map a drive.

    Args:
        drive: frames and odometry.
        config: how to look and to map.
        progress: called with the number of frames done and of all frames.
        recorder: takes snapshots of the map while it grows.
        memory: of earlier runs over the same frames.
        checkpoint: where the run saves itself, and goes on if it was interrupted.

    Returns:
        The way, the map, and what was seen of it when.

    Raises:
        DriveError: images that do not fit the calibration.
    """
    config = config or VisualConfig()
    pipeline = Pipeline(drive, config, memory)
    done = 0
    if checkpoint is not None:
        data = [getattr(drive, each.name) for each in fields(drive) if each.name != "load"]
        done = checkpoint.resume(drive, (config, *data), {**pipeline.state, "recorder": recorder})
        pipeline.go_on_from(done)
    with side_by_side():
        for number in range(done, len(drive)):
            pipeline.step(number)
            if recorder is not None:
                followed = pipeline.followed
                seen = pipeline.world.landmarks.rows(followed.landmark[followed.known])
                recorder.add(number, len(drive), pipeline.world.ekf, seen)
            if checkpoint is not None:
                checkpoint.keep(number + 1, {**pipeline.state, "recorder": recorder})
            if progress is not None:
                progress(number + 1, len(drive))
    return pipeline.result()


class Pipeline:
    """A drive on its way through the chain, frame by frame.

    Args:
        drive: frames and odometry.
        config: how to look and to map.
        memory: of earlier runs over the same frames.
    """

    def __init__(self, drive: Drive, config: VisualConfig, memory: Memory | None = None) -> None:
        self.drive, self.config = drive, config
        self.followed = Followed()
        self.recording = Recording(drive)
        self.ranged = tells_depth(drive)
        self.world = VisualMap(drive, config, self.ranged)
        self._senses = Senses(drive, config, memory)
        self._glances = Ahead(self._senses.glance, len(drive), config.every)
        self._last = View(Frame(float(drive.time[0])))
        self._way = CameraWay()
        self._road = Road(drive.camera)

    @property
    def state(self) -> dict[str, Any]:
        """What changes from frame to frame, for a checkpoint."""
        return {
            "world": self.world,
            "recording": self.recording,
            "followed": self.followed,
            "way": self._way,
        }

    def go_on_from(self, done: int) -> None:
        """Take up a drive whose state has been restored after so many frames."""
        if done > 0 and self.recording.sighted >= 0:
            self._last = self._senses.glance(self.recording.sighted).view

    def step(self, number: int) -> None:
        """Go on by one frame."""
        note, world, start = self.recording, self.world, perf_counter()
        with note.timed("wait"):
            glance = self._glances(number)
        view = note.glanced(glance).view
        before = world.ekf.pose
        if number > 0:
            self._move(number, view)
        else:
            note.moved(np.zeros(3), None)
        with note.timed("update"):
            self._meet(number, FOLLOWED, self.followed[self.followed.known])
        if glance.found is not None:
            self._renew(number, view, glance.found)
        world.moved(number, before, len(self.followed))
        note.believed(world.ekf.pose, world.pose_covariance, perf_counter() - start)
        if not view.blind:
            self._last, note.sighted = view, number

    def result(self) -> VisualResult:
        """What has come of it so far."""
        return self.recording.result(self.world)

    def _move(self, number: int, view: View) -> None:
        """Follow the points to a frame, and the robot with them."""
        note, world, camera, config = self.recording, self.world, self.drive.camera, self.config
        expected = world.foretell(number)
        with note.timed("track"):
            self.followed, motion = track(
                camera, self._last, view, self.followed, expected, config, self._senses.follow
            )
            note.moved(expected[0], motion)
        with note.timed("road"):
            if motion is not None and not self.ranged:
                motion = self._along_road(view, motion)
        with note.timed("predict"):
            world.predict(number, expected, motion)
        if motion is None:
            self._way.moved(*camera_motion(camera, expected[0]))
            return
        self._way.moved(motion.rotation, motion.shift)
        if not self.ranged:
            with note.timed("range"):
                points = self.followed
                depth, sigma = self._way.triangulate(
                    camera, points.born, points.first, points.xy, config.pixel_sigma
                )
                self.followed = replace(points, depth=depth, depth_sigma=sigma)

    def _along_road(self, view: View, motion: Motion) -> Motion:
        """The motion with what the road says of its length."""
        before = self._last.left
        if before is None or view.left is None:
            return motion
        road = self._road.motion(before, view.left, motion)
        return motion if road is None else self.world.along_road(motion, road)

    def _renew(self, number: int, view: View, found: Followed) -> None:
        """Find what is in view: landmarks that were lost from sight, and new ones."""
        note, world, config = self.recording, self.world, self.config
        with note.timed("associate"):
            if config.selection.startswith("proven") and view.left is not None:
                self.followed = rehearsed(self.followed, found, config.ratio)
            found = found[~_near(found, self.followed[self.followed.known], config.apart / 2)]
            pairs = self._recognize(found)
            known = replace(
                found[pairs[:, 0]],
                landmark=world.landmarks.id[pairs[:, 1]],
                again=np.ones(len(pairs), np.bool_),
            )
        with note.timed("update"):
            self._meet(number, RECOGNIZED, known)
            others = self.followed[~_near(self.followed, known, config.apart / 2)]
            self.followed = others.joined(known)
        with note.timed("attend"):
            new = found[~_near(found, self.followed, config.apart / 2)]
            places = max(0, config.followed - len(self.followed))
            strongest = np.argsort(-new.response, kind="stable")[:places]
            self.followed = self.followed.joined(new[strongest])
            chosen = self._choose(number, self._senses.attend(view, number))
        with note.timed("manage"):
            self._take_in(number, chosen)

    def _choose(self, number: int, saliency: FloatMap | None) -> IntArray:
        """(m,) which of the followed points become landmarks."""
        config, camera, points = self.config, self.drive.camera, self.followed
        seen, useful = self._observed(points)
        free = np.flatnonzero(useful & ~points.known)
        share = np.sqrt(seen.covariance[free, 0, 0]) / seen.z[free, 0]
        shape = (camera.height, camera.width)
        taken = points.xy[points.known]
        order = free[preference(points[free], share, saliency, shape, taken, config, number)]
        places = max(0, config.in_view - int(points.known.sum()))
        count = min(config.new_per_frame * config.every, places)
        return keep_apart(points.xy, order, taken, config.apart, count)

    def _take_in(self, number: int, chosen: IntArray) -> None:
        """Make landmarks of some of the followed points, and keep to the budget."""
        world, points = self.world, self.followed
        new = points[chosen]
        seen, _ = self._observed(new)
        landmark = points.landmark.copy()
        landmark[chosen] = world.take_in(seen, new.descriptor, number)
        self.recording.meetings(number, TAKEN_IN, landmark[chosen], new.xy, seen)
        self.followed = replace(points, landmark=landmark)
        world.shrink(landmark[landmark >= 0], number)
        gone = (landmark >= 0) & (world.landmarks.rows(landmark) < 0)
        self.followed = self.followed[~gone]

    def _recognize(self, points: Followed) -> IntArray:
        """(m, 2) points and rows of the landmarks that they are."""
        world, config = self.world, self.config
        rows = self._in_view()
        if len(rows) == 0 or len(points) == 0:
            return np.zeros((0, 2), np.int64)
        known = world.landmarks.descriptor[rows]
        pairs = look_alikes(points.keypoints, known, config.ratio)
        pairs[:, 1] = rows[pairs[:, 1]]
        expected = world.expect(pairs[:, 1])
        seen, useful = self._sighted(points[pairs[:, 0]], expected.z[:, 0])
        height = world.landmarks.height[pairs[:, 1]]
        fits = useful & within_gate(seen, expected, height, config.gate)
        pairs, seen = pairs[fits], some(seen, fits)
        tolerance = TOLERANCE if self.ranged else ASIDE
        alike = agreeing(seen.z, world.ekf.landmarks[pairs[:, 1]], tolerance)
        pairs, seen = pairs[alike], some(seen, alike)
        pairs = pairs[borne_out(*world.innovations(pairs[:, 1], seen), config.gate)]
        missed = rows[~np.isin(rows, pairs[:, 1])]
        world.landmarks.missed[missed] += 1
        self.recording.missed += len(missed)
        return pairs

    def _sighted(
        self, points: Followed, reach: FloatArray
    ) -> tuple[Sightings, npt.NDArray[np.bool_]]:
        """What is seen of landmarks that are expected at ranges (k,), and whether it is of use."""
        if self.ranged:
            return self._observed(points)
        tilt = self.world.plane.tilt
        seen = bearing_alone(self.drive.camera, points.xy, reach, self.config, tilt)
        return seen, np.ones(len(points), np.bool_)

    def _observed(self, points: Followed) -> tuple[Sightings, npt.NDArray[np.bool_]]:
        """Range and bearing of points, and whether each is of use."""
        tilt = self.world.plane.tilt
        known = points.xy, points.depth, points.depth_sigma
        return observe(self.drive.camera, *known, self.config, tilt)

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

    def _meet(self, number: int, kind: int, points: Followed) -> None:
        expected = self.world.expect(self.world.landmarks.rows(points.landmark))
        seen, useful = self._sighted(points, expected.z[:, 0])
        points, seen = points[useful], some(seen, useful)
        expected = Expectation(expected.z[useful], expected.covariance[useful])
        surprise = self.world.surprise(seen, expected, points.again)
        self.world.meet(points.landmark, seen, points.again, number)
        self.recording.meetings(number, kind, points.landmark, points.xy, seen, surprise)


def _near(points: Followed, others: Followed, apart: float) -> npt.NDArray[np.bool_]:
    """(n,) whether points are within some pixels of one of others."""
    if len(points) == 0 or len(others) == 0:
        return np.zeros(len(points), np.bool_)
    square = np.square(points.xy[:, None] - others.xy).sum(2)
    return np.asarray((square < apart**2).any(1))
