"""Gaze policies against closed forms, and the loop from a decision to the next frame."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from saccade import visual
from saccade.errors import ConfigError
from saccade.frames import Camera, CameraTurn
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.slam import Checkpoint
from saccade.visual.camera import to_pixels
from saccade.visual.egomotion import camera_motion, correspondences_of, estimate_motion
from saccade.visual.gaze import Belief, Candidates, Gaze, GazeLimits, SalientPlaces
from saccade.visual.gaze_control import GazeControl, pan_candidates
from saccade.visual.gaze_policies import (
    BEARING_SIGMA,
    POLICIES,
    RANGE_SIGMA,
    SHARED_SIGMA,
    information,
    informative,
    motion,
    redetections,
    salient,
)

LIMITS = GazeLimits()
CANDIDATES = Candidates(np.radians(20.0 * np.arange(-6, 7)), np.zeros(13), (0.87, 0.65))
NOWHERE = SalientPlaces.none()


def belief(landmarks=(), **changes):
    """A robot at the origin that stands, with landmarks seen from there and not tracked."""
    m = len(landmarks)
    usual = Belief(
        time=0.0,
        pose=np.zeros(3),
        covariance=np.diag([0.01, 0.01, 0.001]),
        velocity=np.zeros(3),
        gaze=Gaze(0.0),
        points=0,
        landmarks=np.array(landmarks, float).reshape(m, 2),
        landmark_covariance=np.tile(0.001 * np.eye(2), (m, 1, 1)),
        height=np.zeros(m),
        redetection=np.ones(m),
        tracked=np.zeros(m, bool),
        joint_innovation=0.02 * np.eye(2 * m),
        innovation_given_pose=0.001 * np.eye(2 * m),
        viewpoint=np.zeros((m, 2)),
    )
    return replace(usual, **changes)


def test_the_information_is_the_entropy_that_an_update_takes_from_pose_and_map():
    rng = np.random.default_rng(0)
    landmarks = np.array([[2.0, 0.5], [3.0, -0.4], [1.5, 0.2]])
    root = rng.standard_normal((9, 9))
    P = root @ root.T / 50  # of pose and map
    H = rng.standard_normal((6, 9))
    known = P[3:, 3:] - P[3:, :3] @ np.linalg.solve(P[:3, :3], P[:3, 3:])
    G = H[:, 3:] @ known @ H[:, 3:].T
    r = np.hypot(*landmarks.T)
    R = np.diag(np.stack([(RANGE_SIGMA * r) ** 2, np.full(3, BEARING_SIGMA**2)], 1).ravel())
    shared = np.zeros((2, 6))
    shared[0, ::2], shared[1, 1::2] = SHARED_SIGMA[0] * r, SHARED_SIGMA[1]
    R += shared.T @ shared
    S = H @ P @ H.T
    after = P - P @ H.T @ np.linalg.solve(S + R, H @ P)
    entropy = [np.linalg.slogdet(C)[1] / 2 for C in (P, after)]
    of_pose = [np.linalg.slogdet(C[:3, :3])[1] / 2 for C in (P, after)]
    known_belief = belief(landmarks, joint_innovation=S, innovation_given_pose=G)
    pose, map_given_pose = information(known_belief, np.ones((1, 3)))
    assert_allclose(pose[0], of_pose[0] - of_pose[1], rtol=1e-6)
    assert_allclose(pose[0] + map_given_pose[0], entropy[0] - entropy[1], rtol=1e-6)


def test_the_robot_looks_where_known_landmarks_are_if_its_pose_is_uncertain():
    behind = [[-1.5, 2.6], [-1.3, 2.4], [-1.6, 2.8]]
    lost = belief(behind, joint_innovation=4.0 * np.eye(6), covariance=np.eye(3))
    chosen = informative(lost, NOWHERE, CANDIDATES, LIMITS)
    assert np.degrees(chosen.pan) == pytest.approx(120)
    assert chosen.reason == "re-detect"
    assert chosen.terms["re-detect"] > 1
    sure = belief(behind, joint_innovation=1e-9 * np.eye(6), innovation_given_pose=1e-9 * np.eye(6))
    assert informative(sure, NOWHERE, CANDIDATES, LIMITS).pan == 0.0
    by_wheels = informative(replace(lost, egomotion="wheels"), NOWHERE, CANDIDATES, LIMITS)
    assert list(by_wheels.terms) == ["re-detect"]


def test_landmarks_seen_from_elsewhere_or_tracked_since_they_were_new_are_not_redetected():
    seen = belief([[2.0, 0.0]])
    ahead = 6
    assert redetections(seen, CANDIDATES, LIMITS)[ahead, 0] == 1.0
    assert redetections(seen, CANDIDATES, LIMITS)[0, 0] == 0.0  # out of view
    other_side = replace(seen, viewpoint=np.array([[4.0, 0.0]]))
    assert redetections(other_side, CANDIDATES, LIMITS)[ahead, 0] == 0.0
    new = replace(seen, tracked=np.ones(1, bool), redetection=np.zeros(1))
    assert redetections(new, CANDIDATES, LIMITS)[ahead, 0] == 0.0
    late = GazeLimits(latency=10.0)
    looking_away = replace(seen, gaze=Gaze(1.0))
    assert redetections(looking_away, CANDIDATES, late)[ahead, 0] == 0.0


def test_salient_places_inhibit_their_return():
    left, right = [0.0, 3.0], [0.0, -3.0]
    never = np.array([np.inf, np.inf])
    places = SalientPlaces(np.array([left, right]), np.array([0.9, 0.6]), never, np.zeros((2, 2)))
    assert salient(belief(), places, CANDIDATES, LIMITS).pan > 1
    just_seen = replace(places, unattended=np.array([0.0, 10.0]))
    assert salient(belief(), just_seen, CANDIDATES, LIMITS).pan < -1


@pytest.mark.parametrize("name", POLICIES)
def test_policies_are_functions_that_choose_within_the_candidates(name):
    landmarks = np.random.default_rng(0).uniform(-4, 4, (8, 2))
    given = belief(landmarks), NOWHERE, CANDIDATES, LIMITS
    first, again = (POLICIES[name](5)(*given) for _ in range(2))
    assert first == again
    assert CANDIDATES.pan[0] <= first.pan <= CANDIDATES.pan[-1]
    empty = POLICIES[name](5)(belief(), NOWHERE, CANDIDATES, LIMITS)
    assert np.isfinite(empty.pan)


def test_a_view_to_the_side_tells_an_advance_from_a_turn_worse_than_one_ahead():
    camera = Camera(320, 240, 340, 340, 160, 120, 0.15)
    angle, rng = np.arctan2(camera.cx, camera.fx), np.random.default_rng(0)
    prior = np.array([0.08, 0.0, 0.01]), np.diag(np.square([0.004, 0.001, 0.004]))
    error = []
    for pan in (0.0, np.pi / 2):
        turned = camera.turned(CameraTurn(pan))
        bearing = pan + rng.uniform(-0.9 * angle, 0.9 * angle, 150)
        r = 1 / np.maximum(np.abs(np.sin(bearing)) / 1.1, np.cos(bearing) / 5)  # a corridor
        z = rng.uniform(-0.2, 0.2, 150)
        points = np.stack([r * np.cos(bearing), r * np.sin(bearing), z], 1)
        xy, depth = to_pixels(turned, points)
        R, t = camera_motion(turned, prior[0])
        in_camera = (points - turned.position) @ turned.rotation
        now = np.asarray(in_camera @ R.T + t)
        moved = np.stack([340 * now[:, 0] / now[:, 2] + 160, 340 * now[:, 1] / now[:, 2] + 120], 1)
        sigma = 0.4 * depth**2 / (340 * 0.15)
        pairs = correspondences_of(xy, moved, depth, sigma, now[:, 2], sigma)
        covariance = estimate_motion(turned, pairs, 0.5, prior).covariance
        error.append(np.diag(covariance) @ [1, 1, 4])  # of the position two metres on
    moving = belief(velocity=np.array([0.8, 0.0, 0.0]), points=200)
    sides = replace(CANDIDATES, pan=np.array([0.0, np.pi / 2]), tilt=np.zeros(2))
    ahead, side = motion(replace(moving, gaze=Gaze(np.pi / 4)), NOWHERE, sides, LIMITS)
    assert error[1] > 3 * error[0]
    assert ahead - side > np.log(3)
    resting = belief(gaze=Gaze(np.pi / 4), points=200)
    assert np.ptp(motion(resting, NOWHERE, sides, LIMITS)) < 1e-9


def test_a_pan_camera_has_latency_rate_and_range_and_no_foresight():
    pan = PanCamera(GazeLimits(pan=(-1.0, 1.0), rate=0.5, latency=0.2))
    pan.turn_to(1.0, Gaze(2.0))
    assert_allclose([pan.angle(t) for t in (1.2, 1.4, 3.2, 9.0)], [0, 0.1, 1.0, 1.0])
    pan.turn_to(1.4, Gaze(0.0))
    assert_allclose([pan.angle(t) for t in (1.4, 1.6, 1.8, 3.0)], [0.1, 0.2, 0.1, 0.0], atol=1e-12)
    errors = [pan.measured(t).pan - pan.angle(t) for t in np.arange(2, 40, 0.1)]
    assert np.std(errors) == pytest.approx(pan.measured(5.0).sigma, rel=0.15)


def test_the_next_frame_is_seen_where_the_policy_looked(tmp_path):
    config = DriveConfig(world="rooms", frames=16, frames_per_lap=200, image_size=(96, 72))
    pan = PanCamera()
    drive = simulate_drive(config, 0, pan)
    limits = pan.limits

    def left(belief, places, candidates, limits):
        return Gaze(0.4, reason="left")

    control = GazeControl(left, pan_candidates(drive.camera, limits), limits, pan.turn_to)
    seen = []
    load = drive.load
    drive = replace(drive, load=lambda i: seen.append(load(i)) or seen[-1])
    with pytest.raises(ConfigError, match="gaze"):
        visual.run(drive, checkpoint=Checkpoint(tmp_path / "c.npz"), gaze=control)
    visual.run(drive, gaze=control)
    turns = [frame.turn.pan for frame in seen]
    assert_allclose(turns[:2], 0, atol=0.01)
    assert_allclose(turns[-3:], 0.4, atol=0.01)
    assert control.decisions[0].chosen.reason == "left"
