"""A robot that is carried away notices that it is lost, says so, and is found in its map."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from saccade import datasets, visual
from saccade.evaluation.trajectory import score_drive
from saccade.frames import Frame
from saccade.simulation import DriveConfig, simulate_drive
from saccade.slam.consistency import normalized_squared
from saccade.slam.kidnapping import KidnappingDetector
from saccade.types import THREE_SIGMA_2D, Trajectory
from saccade.viewing.snapshots import SnapshotRecorder
from saccade.visual import VisualConfig
from saccade.visual.lost import ImageEvidence
from saccade.visual.optical_flow import PreparedFrame
from saccade.visual.relocalization import MAX_IMAGE_EVIDENCE
from support.short_ring import short_ring

FRAMES, LONG = 56, 64


@pytest.fixture(scope="module")
def drive():
    return short_ring(FRAMES)


@pytest.fixture(scope="module")
def long_drive():
    return short_ring(LONG)


def kidnapped(drive, kept, still=(), black=()):
    """The `kept` frames of a drive, some of them black; odometry knows nothing of those left out.

    Nor of `still` steps: it reports that there was none.
    """
    kept, still = np.asarray(kept), list(still)
    control, covariance = drive.control[kept[:-1]], drive.control_covariance[kept[:-1]]
    control[still] = covariance[still] = 0.0
    time = 0.1 * np.arange(len(kept))

    def load(number):
        frame = replace(drive.load(int(kept[number])), time=float(time[number]))
        dark = np.zeros_like(frame.image)
        return replace(frame, image=dark, right=dark) if number in black else frame

    truth = Trajectory(time, drive.truth.pose[kept])
    made = {"time": time, "control": control, "control_covariance": covariance}
    return replace(drive, load=load, truth=truth, **made)


def error_at_the_end(result, drive):
    return score_drive(result.trajectory, drive.truth).end_m


JUMP, AFTER = [*range(32), *range(42, FRAMES)], 32


@pytest.fixture(scope="module")
def carried(drive):
    """The drive of a robot that was carried away on its way back, its result and its snapshots."""
    moved, recorder = kidnapped(drive, JUMP), SnapshotRecorder()
    return moved, visual.run(moved, recorder=recorder), recorder.snapshots


def test_a_robot_that_was_carried_away_is_found_in_its_map(drive, carried):
    moved, result, _ = carried
    distance = np.hypot(*(drive.truth.pose[42] - drive.truth.pose[32])[:2])
    assert distance > 1.5
    assert not result.lost[:AFTER].any()
    assert result.lost[AFTER]
    assert not result.lost[-1]
    assert error_at_the_end(result, moved) < 0.1
    sigma = np.sqrt(result.filtered.covariance[:, 0, 0])
    assert 3 * sigma[AFTER] > distance > 10 * sigma[AFTER - 1]
    assert sigma[-1] < 0.1
    offset = np.hypot(*(result.trajectory.pose - moved.truth.pose)[:, :2].T)
    assert offset[result.lost].max() < 0.1  # led back from where it was found


@pytest.mark.nightly
def test_a_robot_that_was_carried_in_the_dark_is_found(long_drive):
    kept, after = [*range(44), *range(54, LONG)], 44
    moved = kidnapped(long_drive, kept, still=range(35, 44), black=range(36, 44))
    result = visual.run(moved)
    assert result.lost[after]
    assert not result.lost[-1]
    assert error_at_the_end(result, moved) < 0.1
    sigma = np.sqrt(result.filtered.covariance[:, 0, 0])
    assert (np.diff(sigma[after - 8 : after]) > 0).all()  # from the first black frame on


@pytest.mark.nightly
def test_a_robot_that_stands_in_the_dark_goes_on_where_it_stood(long_drive):
    kept = [*range(44), *([43] * 11), *range(44, LONG)]
    stood = kidnapped(long_drive, kept, still=range(43, 54), black=range(44, 54))
    result = visual.run(stood)
    assert result.lost[53]
    assert not result.lost[54:].any()
    assert error_at_the_end(result, stood) < 0.1
    assert score_drive(result.trajectory, stood.truth).inside_3sigma == 1.0


@pytest.mark.nightly
def test_a_robot_in_an_unknown_place_stays_lost_and_keeps_its_map():
    ring = simulate_drive(DriveConfig(frames=130))
    moved = kidnapped(ring, [*range(24), *range(110, 130)])
    result = visual.run(moved)
    assert result.lost[24:].all()
    assert result.map.xy[:, 0].max() < 8  # nothing was added beyond the first corner
    error = (result.trajectory.pose - moved.truth.pose)[-1:, :2]
    inside = normalized_squared(error, result.trajectory.covariance[-1:, :2, :2])
    assert np.hypot(*error[0]) > 5
    assert inside[0] < THREE_SIGMA_2D


def test_the_times_at_which_it_was_lost_are_reported(carried, run, tmp_path, monkeypatch):
    moved, *mapped = carried
    datasets.save_drive(tmp_path / "carried", moved)
    monkeypatch.setattr("saccade.cli.drive_run.map_recorded", lambda drive, *_: (drive, *mapped))
    code, out, _ = run("drive", tmp_path / "carried", "--out", tmp_path / "out")
    assert code == 0
    (times,) = json.loads((tmp_path / "out" / "run.json").read_text())["lost"]
    assert times[0] == pytest.approx(moved.time[AFTER])
    assert times[0] < times[1] < times[0] + 1
    assert f"{times[0]:.1f} to {times[1]:.1f} s" in out
    assert f"{times[0]:.1f} to {times[1]:.1f} s" in (tmp_path / "out" / "report.html").read_text()


def test_a_robot_that_shall_not_recover_is_never_lost(carried):
    moved, *_ = carried
    assert not visual.run(moved.until(AFTER + 2), VisualConfig(recover=False)).lost.any()


STEP = np.array([0.1, 0.0, 0.0])
SMALL = np.diag([1e-4, 1e-4, 1e-4])


def scenery(rng):
    """An image (60, 80) with structures of a few pixels and more."""
    return cv2.resize(rng.integers(0, 256, (8, 10)).astype(np.uint8), (80, 60))


def seen(image):
    return PreparedFrame(Frame(0.0), image)


def driven(rng, frames=30):
    """A test that has seen so many frames of a steady drive, and its last image."""
    test = ImageEvidence(KidnappingDetector(False, 0.99, MAX_IMAGE_EVIDENCE), (2.0, 0.5))
    image = scenery(rng)
    for _ in range(frames):
        image = np.roll(image, 1, axis=1)
        assert test.add_motion(seen(image), (STEP, SMALL), (STEP, SMALL), 0.1, 100, 90)
    assert test.detector.evidence == 0.0
    return test, image


def test_wheels_that_slip_are_no_evidence_while_the_camera_moves_as_before(rng):
    test, image = driven(rng)
    test.add_motion(seen(image), (10 * STEP, SMALL), (STEP, SMALL), 0.1, 100, 90)
    assert test.detector.evidence == 0.0
    test.add_motion(seen(image), (STEP, SMALL), (10 * STEP, SMALL), 0.1, 100, 90)
    assert test.detector.kidnapped


def test_a_view_that_resembles_the_last_one_is_no_evidence(rng):
    test, image = driven(rng)
    test.add_motion(seen(np.roll(image, 1, axis=1)), (STEP, SMALL), None, 0.1, 100, 0)
    assert test.detector.evidence == 0.0
    test.add_motion(seen(scenery(rng)), (STEP, SMALL), None, 0.1, 100, 0)
    assert test.detector.kidnapped


def test_missed_landmarks_add_to_other_evidence_and_found_ones_refute_it(rng):
    test, _ = driven(rng)
    for _ in range(100):
        test.add_landmarks(expected=20, found=0, elsewhere=0)
    assert test.detector.evidence == 0.0
    test.add_landmarks(expected=20, found=0, elsewhere=9)
    test.add_landmarks(expected=20, found=0, elsewhere=9)
    assert 0 < test.detector.evidence < MAX_IMAGE_EVIDENCE
    test.add_motion(seen(scenery(rng)), (STEP, SMALL), None, 0.1, 10, 0)
    assert test.detector.kidnapped
    test.add_landmarks(expected=20, found=8, elsewhere=0)
    assert test.detector.evidence == 0.0
