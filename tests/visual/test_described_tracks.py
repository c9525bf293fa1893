"""Tracks with descriptors close loops; without, they do not."""

from dataclasses import replace

import numpy as np
import pytest

from saccade import visual
from saccade.datasets.drives.tracks import read_tracks_drive
from saccade.evaluation.trajectory import position_rmse
from saccade.frames import AHEAD, Camera, Drive, Frame, Tracks
from saccade.plane import steps_between
from saccade.types import Trajectory

CAMERA = Camera(640, 480, 400.0, 400.0, 320.0, 240.0, 0.3, np.array([0.0, 0.0, 1.0]))
LAP, FRAMES = 60, 130


@pytest.fixture(scope="module")
def circling():
    """Two laps of a circle among points; a point that comes back into view has another id."""
    rng = np.random.default_rng(5)
    angle = 2 * np.pi * np.arange(FRAMES) / LAP
    pose = np.column_stack([3 * np.sin(angle), 3 - 3 * np.cos(angle), angle])
    points = rng.uniform([-9, -6, -0.5], [9, 12, 3], (500, 3))
    descriptors = rng.integers(0, 255, (500, 128)).astype(np.uint8)
    visits, visible, frames = np.zeros(500, np.int64), np.zeros(500, bool), []
    for x, y, heading in pose:
        c, s = np.cos(heading), np.sin(heading)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        z = (points - [x, y, 1.0]) @ turn @ AHEAD
        xy = 400 * z[:, :2] / np.maximum(z[:, 2:], 0.1) + [320, 240]
        inside = (z[:, 2] > 1) & (z[:, 2] < 9) & (xy > 10).all(1) & (xy < [630, 470]).all(1)
        visits += inside & ~visible
        visible = inside
        i = np.flatnonzero(inside)
        disparity = 120 / z[i, 2] + 0.2 * rng.standard_normal(len(i))
        seen = xy[i] + 0.3 * rng.standard_normal((len(i), 2))
        frames.append(Tracks(i + 500 * visits[i], seen, disparity, descriptors[i]))
    control = steps_between(pose)
    time = 0.1 * np.arange(FRAMES)
    return Drive(
        "circling", CAMERA, time, control * [1, 1, 1.05],
        np.tile(np.diag([0.02, 0.02, 0.02]) ** 2, (FRAMES - 1, 1, 1)),
        lambda i: Frame(float(time[i]), tracks=frames[i]),
        truth=Trajectory(time, pose),
    )  # fmt: skip


def test_tracks_with_descriptors_close_the_loop(circling):
    def undescribed(i):
        frame = circling.load(i)
        return replace(frame, tracks=replace(frame.tracks, descriptor=None))

    closed = visual.run(circling)
    open_ = visual.run(replace(circling, load=undescribed))
    assert (open_.observations.kind == 2).sum() == 0
    assert (closed.observations.kind == 2).sum() > 20
    error, without = (position_rmse(r.trajectory, circling.truth) for r in (closed, open_))
    assert error < without
    assert len(closed.map) < len(open_.map)


def test_descriptors_are_read_from_the_file(circling, tmp_path):
    tracks = [circling.load(i).tracks for i in range(4)]
    uvlr = np.concatenate(
        [np.column_stack([t.xy, t.xy[:, 0] - t.disparity, t.xy[:, 1]]) for t in tracks]
    )
    descriptors = np.concatenate([t.descriptor for t in tracks])
    frame = np.repeat(np.arange(4), [len(t) for t in tracks])
    order = np.random.default_rng(0).permutation(len(frame))  # the file need not be sorted
    order = order[np.argsort(frame[order], kind="stable")]
    np.savez(
        tmp_path / "stereo_tracks.npz", frame=frame[order], uvlr=uvlr[order],
        track=np.concatenate([t.id for t in tracks])[order], descriptors=descriptors[order],
    )  # fmt: skip
    K = np.array([[400, 0, 320], [0, 400, 240], [0, 0, 1.0]])
    np.savez(tmp_path / "calib.npz", K=K, b=0.3, cam_T_imu=np.eye(4))
    (tmp_path / "times.txt").write_text("0\n1\n2\n3\n")
    drive = read_tracks_drive(tmp_path)
    for i, expected in enumerate(tracks):
        read = drive.load(i).tracks
        _, a, b = np.intersect1d(read.id, expected.id, return_indices=True)
        assert len(a) == len(expected)
        np.testing.assert_array_equal(read.descriptor[a], expected.descriptor[b])
