"""Which points become landmarks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from saccade import visual
from saccade.simulation import DriveConfig, simulate_drive
from saccade.visual import VisualConfig
from saccade.visual.config import SELECTIONS
from saccade.visual.points import TrackedPoints
from saccade.visual.reidentification import count_rematches
from saccade.visual.result import ObservationKind
from saccade.visual.selection import rematch_rate, saliency_at


@pytest.fixture(scope="module")
def drive():
    made = simulate_drive(DriveConfig(frames=4))
    pictures = [made.load(number) for number in range(len(made))]
    return replace(made, load=pictures.__getitem__)


def points(xy, descriptors=None):
    """Tracked points with nothing else known of them."""
    n = len(xy)
    descriptors = np.zeros((n, 128), np.uint8) if descriptors is None else descriptors
    return TrackedPoints.zeros(n, xy=np.asarray(xy, np.float32), descriptor=descriptors)


def test_every_selection_differs(drive):
    taken = set()
    for selection in SELECTIONS:
        config = VisualConfig(selection=selection, new_per_frame=2, max_tracked=16)
        seen = visual.run(drive, config).observations
        taken.add(seen.xy[seen.kind == ObservationKind.INITIALIZED].tobytes())
        assert (seen.frame[seen.kind == ObservationKind.INITIALIZED] == 0).sum() == 8
    assert len(taken) == len(SELECTIONS)


def test_odometry_without_a_map_has_no_landmarks(drive):
    result = visual.run(drive, VisualConfig(new_per_frame=0))
    assert (len(result.map), len(result.observations)) == (0, 0)
    assert np.abs(result.trajectory.pose - drive.truth.pose).max() < 0.05


def test_the_rematch_rate_is_the_mean_of_the_posterior():
    tried, found = np.array([0, 1, 4, 9]), np.array([0, 1, 1, 9])
    some = replace(points(np.zeros((4, 2))), rematch_attempts=tried, rematches=found)
    assert rematch_rate(some) == pytest.approx(stats.beta(1 + found, 1 + tried - found).mean())


def test_a_point_is_rematched_at_its_tracked_position_alone():
    descriptors = np.eye(4, 128, dtype=np.uint8) * 200
    tracked = points([[10, 10], [50, 10], [90, 10], [130, 10]], descriptors)
    # the second's descriptor is elsewhere, the third's is there twice, the fourth's is not
    found = points([[11, 10], [70, 10], [90, 10], [95, 30]], descriptors[[0, 1, 2, 2]])
    after = count_rematches(count_rematches(tracked, found, 0.8), found, 0.8)
    assert after.rematch_attempts.tolist() == [2, 2, 2, 2]
    assert after.rematches.tolist()[:2] == [2, 0]
    assert after.rematches[3] == 0
    assert tracked.rematch_attempts.tolist() == [0, 0, 0, 0]


def test_symmetry_ranks_points_at_their_own_scale():
    """Of a small and a large disc, each scale prefers the one of its size to an empty place."""
    rows, columns = np.mgrid[:120, :160]
    image = np.full((120, 160), 100, np.uint8)
    image[np.hypot(rows - 60, columns - 40) < 4] = 220
    image[np.hypot(rows - 60, columns - 110) < 16] = 220
    config = VisualConfig(selection="symmetry")
    places = points([[40, 60], [110, 60], [75, 20]])
    for radius, best in ((4, 0), (16, 1)):  # the edge lies within 2.5 scales
        size = np.full(3, radius, np.float32)
        saliency = saliency_at(image, replace(places, size=size), config)
        assert saliency.argmax() == best
    assert not saliency_at(None, places, config).any()
