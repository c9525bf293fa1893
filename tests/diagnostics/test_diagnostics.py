"""What `saccade check` finds, in drives with one defect each."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from saccade.datasets import load_drive
from saccade.diagnostics import check_drive, drop_repeated
from saccade.diagnostics.checks import report_on
from saccade.diagnostics.survey import survey_drive
from saccade.errors import ImageError
from saccade.frames import Drive, Frame
from saccade.types import Trajectory
from support.winding_drive import winding


@pytest.fixture(scope="module")
def drive():
    return winding()


@pytest.fixture(scope="module")
def survey(drive):
    return survey_drive(drive, 300)


def found(report):
    return {finding.check: finding for finding in report.findings if finding.severity != "note"}


def turned(camera, axis, degrees):
    turn, _ = cv2.Rodrigues(np.deg2rad(degrees) * np.array(axis, float))
    return replace(camera, rotation=turn @ camera.rotation)


def test_a_drive_without_defects_is_clean(drive, survey):
    report = report_on(drive, survey)
    assert report.clean
    assert report.figures["turn_scale"] == pytest.approx(1, abs=0.02)
    assert report.figures["translation_scale"] == pytest.approx(1, abs=0.02)
    assert report.figures["turn_noise_deg"] == pytest.approx(np.rad2deg(0.01), rel=0.2)
    assert report.figures["translation_noise_m"] == pytest.approx(0.01, rel=0.2)
    assert report.figures["clock_lag_frames"] == 0


def turn_bias(degrees_per_second):
    turn = np.array([0, 0, np.deg2rad(degrees_per_second) * 0.1])
    return lambda d: replace(d, control=d.control + turn)


def jump(drive):
    control = drive.control.copy()
    control[40, 0] += 3.0
    control[100, 2] += 1.0
    return replace(drive, control=control)


def gap(drive):
    time = drive.time + np.where(np.arange(len(drive)) >= 50, 3.0, 0.0)
    return replace(drive, time=time, truth=Trajectory(time, drive.truth.pose))


def truth(drive, scale=(1, 1, 1), seconds=0.0, **changes):
    pose = Trajectory(drive.truth.time + seconds, drive.truth.pose * scale)
    return replace(drive, truth=pose, **changes)


def other_turns(control):
    order = np.random.default_rng(1).permutation(len(control))
    return np.column_stack([control[:, :2], control[order, 2]])


DEFECTS = {
    "turn sign": (lambda d: replace(d, control=d.control * [1, 1, -1]), -1.0, 0.1),
    "turn scale": (lambda d: replace(d, control=d.control * [1, 1, 1.4]), 1.4, 0.03),
    "turn bias": (turn_bias(-4.0), -4.0, 0.3),
    "turn noise": (
        lambda d: replace(d, control_covariance=d.control_covariance / [[1, 1, 9]]), 0.01, 2e-3,
    ),
    "turn": (lambda d: replace(d, control=other_turns(d.control)), 0, 0.3),
    "clock lag": (lambda d: replace(d, control=np.roll(d.control, 6, 0)), 0.6, 0.11),
    "translation sign": (lambda d: replace(d, control=d.control * [-1, 1, 1]), 0.0, 0.1),
    "translation scale": (lambda d: replace(d, control=d.control * [0.7, 1, 1]), 0.7, 0.02),
    "translation noise": (
        lambda d: replace(d, control_covariance=d.control_covariance / [[16, 1, 1]]), 0.01, 2e-3,
    ),
    "odometry jump": (jump, 2, 0),
    "gaps": (gap, 3.1, 1e-6),
    "camera position": (
        lambda d: replace(d, camera=replace(d.camera, position=np.array([-0.5, -0.1, 1.0]))),
        0.5, 0.1,
    ),
    "truth length": (lambda d: truth(d, (1 / 1.08, 1 / 1.08, 1)), 1.08, 0.01),
    "truth turns": (lambda d: truth(d, (1, -1, -1), control=0 * d.control), -1.0, 0.1),
    "truth clock": (lambda d: truth(d, seconds=0.5, control=0 * d.control), 0.5, 0.11),
    "principal point": (
        lambda d: replace(d, camera=replace(d.camera, width=1280, height=960)), 25, 1,
    ),
    "field of view": (lambda d: replace(d, camera=replace(d.camera, fx=4000.0, fy=4000.0)), 9, 1),
}  # fmt: skip


@pytest.mark.parametrize("check", DEFECTS)
def test_a_defect_is_found_with_its_number(check, drive, survey):
    change, value, within = DEFECTS[check]
    report = report_on(change(drive), survey)
    assert not report.clean
    finding = found(report)[check]
    assert finding.value == pytest.approx(value, abs=within)
    assert set(found(report)) == {check}
    assert finding.frames == {"odometry jump": (41, 101), "gaps": (50,)}.get(check, ())


@pytest.mark.parametrize(
    ("axis", "degrees", "check", "value"),
    [
        ((0, 0, 1), 8, "camera yaw", 8),
        ((0, 1, 0), -6, "camera pitch", 6),
        ((0, 0, 1), 90, "camera rotation", 90),
        ((0, 0, 1), 180, "translation sign", 0),
    ],
)
def test_a_camera_that_looks_elsewhere_is_found(drive, axis, degrees, check, value):
    askew = replace(drive, camera=turned(drive.camera, axis, degrees))
    report = check_drive(askew)
    assert set(found(report)) - {"turn"} == {check}
    assert found(report)[check].value == pytest.approx(value, abs=1)


def test_tracks_that_stand_still_are_found(drive):
    def load(i):
        frame = drive.load(i)
        if i not in (30, 31, 77):
            return frame
        return replace(frame, tracks=drive.load(i - 1 if i != 31 else 29).tracks)

    report = check_drive(replace(drive, load=load))
    assert found(report)["repeated frames"].frames == (30, 31, 77)


def test_without_odometry_it_says_so(drive, survey):
    report = report_on(replace(drive, control=np.zeros_like(drive.control)), survey)
    assert report.clean
    assert [finding.check for finding in report.findings] == ["no odometry"]


class TestImages:
    def test_one_without_defects_is_clean(self, filmed):
        assert not found(check_drive(filmed))

    def test_what_is_wrong_with_single_frames_is_found(self, filmed):
        def load(i):
            frame = filmed.load(i)
            if 5 <= i < 9:
                return replace(frame, image=np.zeros_like(frame.image))
            if i == 12:
                return replace(filmed.load(11), time=frame.time)
            if 20 <= i < 26:
                return replace(frame, image=cv2.GaussianBlur(frame.image, (0, 0), 4))
            if i == 30:
                raise ImageError("30.png: the image is cut short")
            return frame

        report = found(check_drive(replace(filmed, load=load)))
        assert report["black frames"].frames == (5, 6, 7, 8)
        assert report["repeated frames"].frames == (12,)
        assert report["blurred frames"].frames == tuple(range(20, 26))
        assert report["unreadable frames"].frames == (30,)
        assert "30.png: the image is cut short" in str(report["unreadable frames"])

    def test_frames_without_a_common_world_are_found(self, filmed):
        def load(i):
            image = np.random.default_rng(i).integers(0, 255, (120, 160), np.uint8)
            return Frame(i / 10, cv2.GaussianBlur(image, (0, 0), 1.5))

        report = check_drive(replace(filmed, load=load))
        assert found(report)["motion"].value < 40

    def test_a_camera_that_stands_is_no_defect(self, filmed):
        def load(i):
            noise = np.random.default_rng(i).integers(0, 3, (120, 160), np.uint8)
            return Frame(i / 10, filmed.load(0).image // 2 + noise)

        standing = replace(filmed, load=load)
        assert not found(check_drive(standing))
        slipping = replace(standing, control=filmed.control + np.array([0.1, 0.0, 0.0]))
        report = check_drive(slipping)
        assert set(found(report)) == {"standstill"}
        assert found(report)["standstill"].value == pytest.approx(100)

    def test_cameras_that_are_exchanged_are_found(self, filmed):
        def load(i):
            frame = filmed.load(i)
            return replace(frame, image=frame.right, right=frame.image)

        assert found(check_drive(replace(filmed, load=load)))["disparity sign"].value > 90

    def test_rows_that_do_not_fit_are_found(self, filmed):
        def load(i):
            frame = filmed.load(i)
            return replace(frame, right=np.roll(frame.right, 3, 0))

        assert found(check_drive(replace(filmed, load=load)))["rows"].value == pytest.approx(
            3, abs=0.3
        )


@pytest.mark.shared
def test_the_defects_of_kitti_are_found_and_the_mended_file_is_clean(shared):
    folder = shared / "data" / "drives" / "kitti07"
    clean = load_drive("tracks", folder / "stereo_tracks_clean.npz").until(300)
    survey = survey_drive(clean, 300)
    assert len(survey) == 300
    assert not found(report_on(clean, survey))

    matrix = np.load(folder / "calib.npz")["cam_T_imu"]
    as_it_reads = -matrix[:3, :3].T @ matrix[:3, 3]
    wrong = replace(clean, camera=replace(clean.camera, position=as_it_reads))
    assert set(found(report_on(wrong, survey))) == {"camera position"}

    refreshed = load_drive("tracks", folder / "stereo_tracks.npz").until(500)
    report = found(check_drive(refreshed))
    assert set(report) == {"repeated frames"}
    expected = np.load(folder / "stereo_tracks_clean.npz")["refresh"]
    np.testing.assert_array_equal(report["repeated frames"].frames, expected[expected < 500])


@pytest.mark.shared
def test_images_of_kitti_are_clean_and_a_wrong_turn_in_them_is_found(shared):
    drive = load_drive("kitti", shared / "data" / "drives" / "kitti07")
    survey = survey_drive(drive, 60)
    assert not found(report_on(drive, survey))
    mirrored = replace(drive, control=drive.control * [1, 1, -1])
    assert set(found(report_on(mirrored, survey))) == {"turn sign"}


def test_lengths_that_differ_by_8_to_20_percent_are_named(drive):
    """By a wrong baseline, whatever odometry says, and with lengths that vary."""
    for factor in (0.8, 0.92, 1.08, 1.2):
        camera = replace(drive.camera, baseline=factor * drive.camera.baseline)
        findings = found(check_drive(replace(drive, camera=camera, control=0 * drive.control)))
        assert set(findings) == {"truth length"}
        assert findings["truth length"].value == pytest.approx(factor, abs=0.02)


def repeating(drive, numbers):
    """In some frames, tracks repeat the frame before, and go on at other points."""

    def load(i):
        shift = sum(n <= i for n in numbers)
        frame = drive.load(i)
        tracks = replace(frame.tracks, id=(frame.tracks.id + 7 * shift) % 4000)
        if i in numbers:
            tracks = load(i - 1).tracks
        return replace(frame, tracks=tracks)

    return replace(drive, load=load)


def test_repeated_tracks_are_dropped_and_begin_anew(drive):
    numbers = (20, 21, 57, 130)
    repaired = drop_repeated(repeating(drive, numbers))
    assert any("4 frames repeat" in remark for remark in repaired.remarks)
    ids = [set(repaired.load(i).tracks.id.tolist()) for i in range(len(drive))]
    assert all(not ids[i] for i in numbers)
    assert not set.union(*ids[:20]) & set.union(*ids[20:57])
    assert "repeated frames" not in found(check_drive(repaired))
    without_odometry = replace(repeating(drive, numbers), has_odometry=False)
    assert drop_repeated(without_odometry).remarks == repaired.remarks
    assert drop_repeated(drive).load is drive.load


def test_repeated_images_are_errors_only_while_odometry_moves():
    rng = np.random.default_rng(3)
    images = rng.integers(0, 255, (6, 8, 8)).astype(np.uint8)
    images[3] = images[2]
    images[5] = images[4]
    control = np.tile([0.1, 0.0, 0.0], (5, 1))
    control[4] = 0
    still = Drive(
        "still", winding().camera, np.arange(6.0), control, np.zeros((5, 3, 3)),
        lambda i: Frame(float(i), images[i]),
    )  # fmt: skip
    repaired = drop_repeated(still)
    for order in (range(6), (3, 0, 5, 2)):
        for i in order:
            if i == 3:
                with pytest.raises(ImageError, match="frame 3: an exact copy"):
                    repaired.load(i)
            else:
                np.testing.assert_array_equal(repaired.load(i).image, images[i])
