"""Tracks that a run records are a drive of their own, without images."""

from dataclasses import replace

import numpy as np
import pytest

from saccade import datasets, visual
from saccade.errors import DriveError, OutputError
from saccade.evaluation.trajectory import score_drive
from support.short_ring import short_ring
from support.small_drive import small_drive
from support.track_recorder import record_tracks

FRAMES = 36


@pytest.fixture(scope="module")
def drive():
    return short_ring(FRAMES)


@pytest.mark.nightly
def test_recorded_tracks_close_the_same_loop(drive, tmp_path):
    by_images, recorded = record_tracks(drive)
    datasets.save_drive(tmp_path / "tracks", recorded)
    loaded = datasets.load_drive("auto", tmp_path / "tracks")
    assert len(loaded) == FRAMES
    assert loaded.load(8).image is None
    by_tracks = visual.run(loaded)
    error = [score_drive(r.trajectory, drive.truth).ate_m for r in (by_images, by_tracks)]
    assert error[1] < 1.2 * error[0] + 0.005
    for result in (by_images, by_tracks):
        assert (result.observations.kind == 2).sum() > 20

    def undescribed(i):
        frame = loaded.load(i)
        return replace(frame, tracks=replace(frame.tracks, descriptor=None))

    open_ = visual.run(replace(loaded, load=undescribed))
    assert (open_.observations.kind == 2).sum() == 0
    assert len(by_tracks.map) < len(open_.map)


def test_tracks_are_read_from_a_file_in_any_order(tmp_path):
    rng = np.random.default_rng(0)
    frame, track = rng.permutation(np.repeat(np.arange(4), 9)), rng.permutation(36)
    xy, disparity = rng.uniform(20, 400, (36, 2)), rng.uniform(1, 9, 36)
    descriptors = rng.integers(0, 255, (36, 128)).astype(np.uint8)
    order = np.argsort(frame, kind="stable")
    uvlr = np.column_stack([xy, xy[:, 0] - disparity, xy[:, 1]])
    np.savez(
        tmp_path / "stereo_tracks.npz", frame=frame[order], uvlr=uvlr[order],
        track=track[order], descriptors=descriptors[order],
    )  # fmt: skip
    K = np.array([[400, 0, 320], [0, 400, 240], [0, 0, 1.0]])
    np.savez(tmp_path / "calib.npz", K=K, b=0.3, cam_T_imu=np.eye(4))
    (tmp_path / "times.txt").write_text("0\n1\n2\n3\n")
    drive = datasets.load_drive("tracks", tmp_path)
    for i in range(4):
        read, expected = drive.load(i).tracks, frame == i
        order = np.argsort(track[expected])
        assert sorted(read.id) == sorted(track[expected])
        now = np.argsort(read.id)
        np.testing.assert_array_equal(read.descriptor[now], descriptors[expected][order])
        np.testing.assert_allclose(read.disparity[now], disparity[expected][order])


def test_what_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.md").write_text("mine")
    with pytest.raises(DriveError, match="whose scale is unknown"):
        datasets.save_drive(tmp_path / "bare", replace(small_drive(), scale="assumed"))
    with pytest.raises(OutputError, match="found 'notes"):
        datasets.save_drive(tmp_path / "mine", small_drive())
