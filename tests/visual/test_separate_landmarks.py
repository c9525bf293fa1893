"""Landmarks of one detector beside the egomotion from the points of another."""

from dataclasses import replace

import numpy as np
import pytest

from out_and_back import out_and_back
from saccade.frames import Frame, Tracks
from saccade.simulation import DriveConfig, simulate_drive
from saccade.visual import FeatureCache, VisualConfig
from saccade.visual.depth import measure_depth
from saccade.visual.egomotion import (
    Egomotion,
    agree_with_motion,
    camera_motion,
    correspondences_of,
)
from saccade.visual.optical_flow import prepare_frame
from saccade.visual.pipeline import Pipeline
from saccade.visual.result import ObservationKind

CONFIG = VisualConfig(max_tracks=60, shared_points=False)


def steps(drive, config, cache=None):
    """The points of the egomotion after each frame, the landmarks' ids, and the pipeline."""
    motion, landmarks = [], []
    with Pipeline(drive, config, cache) as pipeline:
        for number in range(len(drive)):
            pipeline.step(number)
            points = pipeline.tracked.for_motion
            motion.append((points.id.tobytes(), points.xy.tobytes(), points.depth.tobytes()))
            landmarks.append(pipeline.tracked.landmarks)
    return motion, landmarks, pipeline


@pytest.fixture(scope="module")
def ring():
    config = DriveConfig(frames=20, frames_per_lap=150, image_size=(200, 150))
    return simulate_drive(config)


@pytest.mark.parametrize("stereo", [True, False])
def test_the_egomotion_is_the_same_whatever_the_landmarks(ring, stereo):
    """To the bit: its points, its motions, and what the sliding window makes of them."""
    single = replace(
        ring,
        camera=replace(ring.camera, baseline=0.0),
        load=lambda i: replace(ring.load(i), right=None),
    )
    drive = out_and_back(ring) if stereo else single
    cache, seen = FeatureCache(), set()
    usual = steps(drive, CONFIG, cache)
    for settings in (
        {"detector": "must", "selection": "rematch-rate"},
        {"detector": "symroid", "selection": "strength"},
        {"detector": "sift", "selection": "random", "new_per_frame": 1, "max_tracked": 4},
    ):
        motion, landmarks, pipeline = steps(drive, replace(CONFIG, **settings), cache)
        seen.add(b"".join(each.xy.tobytes() for each in landmarks))
        assert all(each.landmark_only.all() for each in landmarks)
        assert not stereo or any(each.reidentified.any() for each in landmarks)
        assert motion == usual[0]
        arrays, expected = pipeline.to_arrays(), usual[2].to_arrays()
        window = [name for name in expected if name.startswith("window.")]
        assert (len(window) > 0) == stereo
        for name in window:
            assert np.array_equal(arrays[name], expected[name], equal_nan=True), name
        result, reference = pipeline.result(), usual[2].result()
        assert np.array_equal(result.visual_odometry.pose, reference.visual_odometry.pose)
        assert np.array_equal(result.off_plane, reference.off_plane, equal_nan=True)
    assert len(seen) == 3


def test_landmarks_are_points_of_their_detector(ring):
    for detector in ("must", "symroid"):
        with Pipeline(ring, replace(CONFIG, detector=detector)) as pipeline:
            pipeline.step(0)
            features = pipeline._extract(0)
        assert not np.isin(features.candidates.xy, features.detected.xy).all(1).any()
        landmarks = pipeline.tracked.landmarks
        assert len(landmarks) > 0
        assert (landmarks.xy[:, None] == features.candidates.xy).all(2).any(1).all()
        seen = pipeline.result().observations
        assert (seen.kind == ObservationKind.INITIALIZED).all()
        assert len(seen) == len(landmarks)


def test_a_point_beside_the_egomotion_agrees_with_the_true_motion_alone():
    """Projections of points before and after a motion agree with it, displaced ones do not."""
    camera = DriveConfig().camera
    control = np.array([0.2, 0.0, 0.05])
    R, t = camera_motion(camera, control)
    rng = np.random.default_rng(0)
    before = rng.uniform((-1, -0.5, 2), (1, 0.5, 6), (20, 3))
    after = before @ R.T + t

    def pixels(xyz):
        xy = xyz[:, :2] / xyz[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        return xy.astype(np.float32)

    motion = Egomotion(control, np.zeros(3), np.eye(3), np.ones(0, np.bool_), R, t, False)
    moved = pixels(after)
    along = moved - pixels(before @ R.T)  # where a point may be whose depth is unknown
    across = along[:, ::-1] * (-1, 1) / np.hypot(*along.T)[:, None]
    moved[::2] += 8 * across[::2].astype(np.float32)
    for depth in (before[:, 2], np.full(20, np.nan)):
        known = np.isfinite(depth)
        now = np.where(known, after[:, 2], np.nan)
        points = correspondences_of(pixels(before), moved, depth, 0.05 * depth, now, 0.05 * now)
        agrees = agree_with_motion(camera, points, 0.5, motion)
        assert agrees.tolist() == [False, True] * 10


def test_tracks_of_another_program_are_points_of_both():
    """They come without a detector: its choice has no effect."""
    rng = np.random.default_rng(1)
    drive = simulate_drive(DriveConfig(frames=5, image_size=(160, 120)))
    camera = drive.camera
    xyz = rng.uniform((-2, -0.6, 3), (2, 0.6, 6), (40, 3))
    xy = xyz[:, :2] / xyz[:, 2:] * camera.fx + (camera.cx, camera.cy)
    disparity = camera.fx * camera.baseline / xyz[:, 2]
    descriptor = rng.integers(0, 255, (40, 128)).astype(np.uint8)
    tracks = Tracks(np.arange(40), xy, disparity, descriptor)
    still = replace(
        drive,
        load=lambda i: Frame(float(drive.time[i]), tracks=tracks),
        control=np.zeros_like(drive.control),
    )
    usual, other = (
        steps(still, replace(VisualConfig(), **settings))[2].to_arrays()
        for settings in ({}, {"detector": "must"})
    )
    assert len(usual["map.landmarks.id"]) > 0
    assert np.array_equal(usual["tracked.xy"], other["tracked.xy"])
    assert np.array_equal(usual["map.landmarks.id"], other["map.landmarks.id"])


def test_candidates_have_the_depth_of_their_neighborhood():
    """Where block matching finds none: most of these points have their true depth."""
    config = DriveConfig(size=(7.0, 5.5), frames=2, depth=True)
    frame = simulate_drive(config).load(0)
    prepared = prepare_frame(replace(frame, depth=None), config.camera)
    xy = np.random.default_rng(0).uniform((10, 40), (310, 230), (300, 2)).astype(np.float32)
    true = frame.depth[tuple(np.rint(xy[:, ::-1]).astype(int).T)]
    usual = measure_depth(config.camera, prepared, xy, VisualConfig())[0]
    filled = measure_depth(config.camera, prepared, xy, VisualConfig(), from_neighbors=True)[0]
    known = np.isfinite(usual)
    assert np.array_equal(filled[known], usual[known])
    new = np.isfinite(filled) & ~known
    assert new.sum() > 0.7 * (~known).sum() > 30
    assert (np.abs(filled[new] / true[new] - 1) < 0.1).mean() > 0.8
    assert np.median(np.abs(filled[new] / true[new] - 1)) < 0.02
