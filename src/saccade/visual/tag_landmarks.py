"""Tags in the images of a drive as landmarks of its map.

Tags correct the pose whenever they are seen, close loops by their labels, and locate a lost robot.
A tag that contradicts the map is not used: alone it has moved, and is mapped anew; if two agree on
another pose, the robot has.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from saccade.errors import DriveError, require
from saccade.frames import Drive
from saccade.landmark_names import FIRST_TEXT
from saccade.slam.consistency import chi_square_gate, normalized_squared
from saccade.slam.filter.predictions import PredictedObservations
from saccade.tags import TagConfig, TagSightings
from saccade.types import BoolArray, FloatArray, IntArray
from saccade.visual.egomotion import MotionEstimate
from saccade.visual.points import RangeBearings, TrackedPoints
from saccade.visual.result import ObservationKind, RunLog, VisualResult
from saccade.visual.tag_pose import LatestTags
from saccade.visual.visual_map import VisualMap

TAG_GATE = chi_square_gate(2, 0.9999)
"""Largest normalized innovation squared of a tag that agrees with the map."""
CONFIRM_AFTER = 2
"""Sightings of a tag that make it a landmark; fewer may be of a phantom."""
MAX_TAG_SIGMAS = (1.0, 0.3)
"""Largest standard deviations of an expected range and bearing, in meters and radians, of a tag
that confirms the pose of a robot that counts as lost."""
MOVED_AFTER = 10
"""Contradicting sightings in a row after which a tag has moved."""


def require_tags(drive: Drive, config: TagConfig) -> None:
    """Raises an error unless tags can be landmarks of a drive.

    Raises:
        ConfigError: their size is unknown.
        DriveError: the unit of lengths of the drive is unknown.
    """
    require(config.size is not None, "size", "the side of the tags in meters", None)
    if drive.scale != "metric":
        raise DriveError(
            f"{drive.name}: expected lengths in meters for tags, found a single camera without "
            "odometry, whose scale is unknown; add odometry.csv, or a second camera or depth"
        )


def with_labels(result: VisualResult, labels: Mapping[int, str]) -> VisualResult:
    """The result with the labels of tags as the names of their landmarks."""
    rows = [row for row, id_ in enumerate(result.map.id.tolist()) if id_ in labels]
    if not rows:
        return result
    ids = result.map.id.copy()
    names = tuple(labels[id_] for id_ in ids[rows].tolist())
    ids[rows] = FIRST_TEXT + np.arange(len(rows))
    named = replace(result.map, id=ids, text_names=names)
    return replace(result, map=named, tags=dict(labels))


class TagLandmarks:
    """The tags in the map of a drive."""

    def __init__(self, visual_map: VisualMap) -> None:
        self._map = visual_map
        self._id_of = dict[str, int]()  # of labels in the map
        self._sightings = Counter[str]()  # of labels that are not in the map
        self._contradicted = Counter[str]()  # sightings in a row
        self._unmatched = set[str]()  # contradicted labels since a tag agreed
        self._latest = LatestTags()
        self.agree = False
        """Whether a tag in the last frame agrees with the pose."""

    @property
    def labels(self) -> dict[int, str]:
        """Labels of the tags in the map, by landmark id."""
        known = set(self._map.landmarks.id.tolist())
        return {id_: label for label, id_ in self._id_of.items() if id_ in known}

    def predict(self, motion: MotionEstimate) -> None:
        """Moves the latest sightings into the robot's frame after a motion."""
        self._latest.predict(*motion)

    def observe(self, number: int, seen: TagSightings, log: RunLog) -> bool:
        """Updates the filter by the tags of a frame, and initializes new ones.

        Returns whether tags agree on another pose than the filter's.
        """
        labels, observations, xy = _unique(seen)
        self._latest.add(labels, observations)
        self.agree = False
        rows = self._rows(labels)
        known = np.flatnonzero(rows >= 0)
        expected = self._map.predict_observations(rows[known])
        at_known = observations[known]
        agree = normalized_squared(*self._map.innovations(at_known, expected)) <= TAG_GATE
        self._judge([labels[i] for i in known.tolist()], agree)
        if self._unmatched and self._agree_elsewhere():
            return True
        chosen = known[agree]
        if len(chosen):
            points = _as_points(xy[chosen], self._map.landmarks.id[rows[chosen]])
            predicted = PredictedObservations(expected.z[agree], expected.covariance[agree])
            innovation = self._map.update(points, observations[chosen], predicted, number)
            log.add_observations(
                number, ObservationKind.REIDENTIFIED, points, observations[chosen], innovation
            )
            self.agree = True
        if not self._unmatched:
            new = [i for i in np.flatnonzero(rows < 0).tolist() if self._is_confirmed(labels[i])]
            self._initialize(number, np.array(new, np.int64), labels, observations, xy, log)
        return False

    def locate(self, seen: TagSightings) -> tuple[FloatArray, FloatArray] | None:
        """Pose (3,) of a lost robot by its latest sightings, with covariance; None if unknown."""
        labels, observations, _ = _unique(seen)
        self._latest.add(labels, observations)
        rows = self._rows(labels)
        known = np.flatnonzero(rows >= 0)
        if len(known) == 0:
            return None
        ekf, expected = self._map.ekf, self._map.predict_observations(rows[known])
        squared = normalized_squared(*self._map.innovations(observations[known], expected))
        sharp = np.sqrt(np.diagonal(expected.covariance, axis1=1, axis2=2)) < MAX_TAG_SIGMAS
        if (squared[sharp.all(1)] <= TAG_GATE).any():
            return ekf.pose, ekf.pose_covariance
        return self._pose()

    def end_search(self) -> None:
        """Forgets contradictions, after the robot was found."""
        self._unmatched.clear()
        self._contradicted.clear()

    def _rows(self, labels: list[str]) -> IntArray:
        """(k,) rows of labels in the map, -1 for none."""
        ids = np.array([self._id_of.get(label, -1) for label in labels], np.int64)
        return self._map.landmarks.rows(ids)

    def _judge(self, labels: list[str], agree: BoolArray) -> None:
        """Counts contradictions of labels (k,) in the map; tags that have moved leave it."""
        if agree.any():
            self._unmatched.clear()
        else:
            self._unmatched.update(labels)
        for label, agrees in zip(labels, agree.tolist(), strict=True):
            self._contradicted[label] = 0 if agrees else self._contradicted[label] + 1
            if self._contradicted[label] >= MOVED_AFTER and len(self._unmatched) < 2:
                self._map.remove(self._rows([label]))
                del self._id_of[label], self._contradicted[label]
                self._unmatched.discard(label)

    def _agree_elsewhere(self) -> bool:
        """Whether two contradicted tags agree on a pose."""
        return len(self._unmatched) > 1 and self._pose(self._unmatched) is not None

    def _pose(self, only: set[str] | None = None) -> tuple[FloatArray, FloatArray] | None:
        landmarks = self._map.ekf
        rows = self._rows(list(self._id_of))
        places = {
            label: (landmarks.landmarks[row], landmarks.landmark_covariances[row])
            for label, row in zip(self._id_of, rows.tolist(), strict=True)
            if row >= 0 and (only is None or label in only)
        }
        return self._latest.pose(places)

    def _is_confirmed(self, label: str) -> bool:
        self._sightings[label] += 1
        return self._sightings[label] >= CONFIRM_AFTER

    def _initialize(
        self,
        number: int,
        new: IntArray,
        labels: list[str],
        observations: RangeBearings,
        xy: FloatArray,
        log: RunLog,
    ) -> None:
        """Augments the map by the tags with indices `new` (m,)."""
        if len(new) == 0:
            return
        none = np.zeros((len(new), 128), np.uint8)
        ids = self._map.initialize(observations[new], none, number)
        self._map.landmarks.is_tag[self._map.landmarks.rows(ids)] = True
        for i, id_ in zip(new.tolist(), ids.tolist(), strict=True):
            self._id_of[labels[i]] = id_
            del self._sightings[labels[i]]
        points = _as_points(xy[new], ids)
        log.add_observations(number, ObservationKind.INITIALIZED, points, observations[new])


def _unique(seen: TagSightings) -> tuple[list[str], RangeBearings, FloatArray]:
    """Labels (k,), observations (k,) and pixels (k, 2) of tags that occur once in a frame."""
    assert seen.z is not None
    assert seen.R is not None
    assert seen.height is not None
    _, first, count = np.unique(seen.id, return_index=True, return_counts=True)
    once = np.sort(first[count == 1])
    labels = [seen.labels[i] for i in once.tolist()]
    return labels, RangeBearings(seen.z, seen.R, seen.height)[once], seen.xy[once]


def _as_points(xy: FloatArray, landmark: IntArray) -> TrackedPoints:
    """Points (k,) at pixels (k, 2) whose landmarks correct the pose."""
    return TrackedPoints.zeros(
        len(xy),
        xy=xy.astype(np.float32),
        landmark=landmark,
        reidentified=np.ones(len(xy), np.bool_),
    )
