"""Visual SLAM on a simulated drive, out and back, under good conditions and bad ones."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from saccade import datasets, visual
from saccade.cli.drive_run import drive_tables
from saccade.datasets.drives.odometry import OdometryIncrements, compose_increments
from saccade.errors import DriveError, ImageError
from saccade.evaluation.runs import correct_associations, summarize_drive
from saccade.evaluation.trajectory import score_drive
from saccade.simulation import DriveConfig, simulate_drive
from saccade.slam.consistency import chi_square_gate, normalized_squared
from saccade.slam.filter.robot_models import wrap
from saccade.visual import VisualConfig
from saccade.visual.contradictions import StepSource
from support.short_ring import short_ring

FRAMES, LONG = 32, 48


@pytest.fixture(scope="module")
def drive():
    return short_ring(FRAMES)


@pytest.fixture(scope="module")
def long_drive():
    return short_ring(LONG)


@pytest.fixture(scope="module")
def mapped(drive):
    return visual.run(drive)


def changed(drive, change):
    """The drive with some frames as `change(number, frame)` makes them."""
    return replace(drive, load=lambda number: change(number, drive.load(number)))


def test_the_map_corrects_odometry(drive, mapped):
    ours, odometry = (
        score_drive(each, drive.truth) for each in (mapped.trajectory, mapped.odometry)
    )
    assert ours.ate_m < 0.03
    assert ours.ate_m < odometry.ate_m / 4
    assert ours.end_m < 0.05
    assert ours.inside_3sigma > 0.95
    assert np.isnan(odometry.inside_3sigma)
    assert not mapped.lost.any()
    assert summarize_drive(drive, mapped)["lost"] == []


def test_a_loop_is_smoothed(drive, mapped):
    smoothed, filtered = (
        each.covariance[1:, :2, :2].trace(0, 1, 2) for each in (mapped.trajectory, mapped.filtered)
    )
    assert mapped.estimate == "smoothed"
    assert (smoothed < 1.05 * filtered).all()
    assert smoothed.mean() < 0.9 * filtered.mean()


def test_smoothing_leaves_the_filter_as_it_is(drive):
    plain, smoothed = (
        visual.run(drive.until(10), VisualConfig(smooth=smooth)) for smooth in (False, True)
    )
    assert plain.estimate == "filtered"
    np.testing.assert_array_equal(plain.trajectory.pose, smoothed.filtered.pose)
    np.testing.assert_array_equal(plain.map.id, smoothed.map.id)


def test_reidentified_landmarks_are_the_same(drive, mapped):
    observations = mapped.observations
    right = correct_associations(
        observations.frame,
        observations.landmark,
        observations.z,
        observations.sigma,
        drive.truth.at(drive.time),
    )
    assert (observations.kind == 2).sum() > 10
    assert right[observations.kind == 2].mean() > 0.95
    assert right[observations.kind == 0].all()


def test_innovations_are_logged_of_reidentified_landmarks(mapped):
    observations = mapped.observations
    there = np.isfinite(observations.innovation).all(1)
    assert np.isfinite(observations.innovation_covariance[there]).all()
    assert there[observations.kind == 2].all()
    assert not there[observations.kind == 0].any()
    sigma = np.sqrt(np.diagonal(observations.innovation_covariance[there], axis1=1, axis2=2))
    assert (
        np.abs(observations.innovation[there]) < 3 * sigma
    ).mean() > 0.97  # of a right filter 0.997
    assert (sigma > observations.sigma[there]).all()  # of the observation and of the map


def test_every_frame_is_read_once(drive):
    read = []
    visual.run(changed(drive.until(3), lambda number, frame: read.append(number) or frame))
    assert sorted(read) == [0, 1, 2]


def test_the_map_keeps_to_its_budget(drive):
    few = visual.run(drive.until(12), VisualConfig(max_landmarks=30))
    assert len(few.map) == len(few.descriptors) == 30
    assert (np.diff(few.map.id) > 0).all()


def test_blank_and_garbled_frames_are_bridged(drive, mapped, rng):
    def hidden(number, frame):
        if number in (6, 7, 8):
            return replace(frame, image=np.zeros_like(frame.image), right=None)
        if number == 13:
            raise ImageError("13.png: cannot be read: no such file")
        if number == 20:
            pixels = rng.integers(0, 256, frame.image.shape, np.uint8)
            return replace(frame, image=pixels, right=pixels)
        return frame

    result = visual.run(changed(drive, hidden))
    assert len(result.trajectory) == len(drive)
    assert np.flatnonzero(result.sources == StepSource.DROPPED).tolist() == [20]
    assert not result.lost.any()
    assert result.remarks == ("13.png: cannot be read: no such file",)
    spread = np.linalg.det(result.filtered.covariance[:, :2, :2])
    assert spread[8] > 1.2 * np.linalg.det(mapped.filtered.covariance[8, :2, :2])
    assert score_drive(result.trajectory, drive.truth).ate_m < 0.06


@pytest.mark.nightly
def test_a_hand_over_the_lens_adds_no_error(long_drive, rng):
    noise = rng.integers(0, 256, (LONG, 240, 320), np.uint8)

    def covered(number, frame):
        hand = cv2.GaussianBlur(noise[number], (0, 0), 3)
        return replace(frame, image=hand, right=hand) if 24 <= number < 30 else frame

    result = visual.run(changed(long_drive, covered))
    assert score_drive(result.trajectory, long_drive.truth).ate_m < 0.1


@pytest.mark.nightly
def test_lamps_that_flicker_change_nothing_but_the_last_digits(long_drive):
    gain = np.exp(0.25 * np.random.default_rng(5).standard_normal(LONG))

    def lit(number, frame):
        left, right = (
            cv2.convertScaleAbs(each, alpha=0.6 * gain[number])
            for each in (frame.image, frame.right)
        )
        return replace(frame, image=left, right=right)

    ours, steady = (
        score_drive(visual.run(each).trajectory, long_drive.truth)
        for each in (changed(long_drive, lit), long_drive)
    )
    assert ours.ate_m < steady.ate_m + 0.01
    assert ours.inside_3sigma > 0.95


@pytest.mark.nightly
def test_odometry_that_jumps_is_rejected(long_drive):
    drive = long_drive.until(30)
    control = drive.control.copy()
    control[15] += [2.0, 0.0, 0.5]
    result = visual.run(replace(drive, control=control))
    ours, odometry = (
        score_drive(each, drive.truth) for each in (result.trajectory, result.odometry)
    )
    assert odometry.ate_m > 0.5
    assert ours.ate_m < 0.2


def test_the_first_of_many_unusable_frames_are_named(drive):
    def lost(number, frame):
        if number in range(4, 16):
            raise ImageError(f"{number}.png: expected an image, found an empty file")
        return frame

    remarks = visual.run(changed(drive.until(18), lost)).remarks
    assert remarks[0].startswith("4.png: expected")
    assert len(remarks) == 6
    assert remarks[-1] == "7 more frames could not be used"


def test_a_drive_without_usable_frames_is_refused(drive):
    def lost(number, frame):
        raise ImageError(f"{number}.png: expected 640 x 480 px as the calibration, found 8 x 8")

    with pytest.raises(DriveError, match=r"^0.png: expected 640 .*; no frame of the drive can be"):
        visual.run(changed(drive, lost))


@pytest.mark.nightly
def test_a_camera_that_drops_out_leaves_a_consistent_map():
    """Odometry alone for 3 s; its systematic errors must be in the covariance."""
    squared = []
    for seed in range(2):
        ring = simulate_drive(DriveConfig(frames=64), seed)
        kept = np.concatenate([np.arange(30), np.arange(60, 64)])
        steps = compose_increments(
            OdometryIncrements(ring.control, ring.control_covariance), kept, "odometry"
        )
        gone = replace(
            ring,
            time=ring.time[kept],
            control=steps.control,
            control_covariance=steps.covariance,
            load=lambda number, ring=ring, kept=kept: ring.load(int(kept[number])),
        )
        estimate = visual.run(gone).trajectory
        assert score_drive(estimate, ring.truth).inside_3sigma > 0.97
        error = estimate.pose[30] - ring.truth.pose[60]
        error[2] = wrap(error[2])
        squared.append(normalized_squared(error, estimate.covariance[30]))
        declared = steps.covariance[29, :2, :2]
        assert np.linalg.det(estimate.covariance[30, :2, :2]) > 10 * np.linalg.det(declared)
    assert np.sum(squared) < chi_square_gate(6, 0.975)


def test_a_calibration_of_other_images_is_refused(drive):
    camera = replace(drive.camera, width=640)
    with pytest.raises(DriveError, match=r"expected an image of 640 x 240 px .* found 320 x 240"):
        visual.run(replace(drive, camera=camera))


def test_drive_writes_its_files(drive, run, tmp_path):
    datasets.save_drive(tmp_path / "ring", drive.until(6))
    (tmp_path / "few.toml").write_text("max_landmarks = 25\n")
    words = ("--out", "made", "--config", "few.toml", "--film", "--json")
    code, out, _ = run("drive", tmp_path / "ring", *words)
    assert code == 0
    row = json.loads(out)
    assert row["frames"] == 6
    assert row["landmarks"] == 25
    assert row["ate_m"] < row["odometry"]["ate_m"]
    for path in row["files"].values():
        assert (tmp_path / path).stat().st_size > 100
    film = cv2.VideoCapture(str(tmp_path / "made" / "drive.mp4"))
    assert film.read()[0]
    assert json.loads((tmp_path / "made" / "run.json").read_text())["settings"]["gate"] == 0.99


def test_there_are_no_errors_of_odometry_where_there_is_none(drive, mapped):
    row = summarize_drive(replace(drive, has_odometry=False), mapped)
    errors, _ = drive_tables(row, "ring")
    assert [name for name, *_ in errors.rows] == ["smoothed", "filtered", "egomotion"]
    assert row["odometry"]["ate_m"] is None
    assert summarize_drive(drive, mapped)["odometry"]["ate_m"] > 0
