"""Patches of keypoints: turned and scaled to their frames, with the pairs that made them."""

from importlib.resources import files

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_rgb

import saccade
from saccade.types import Keypoints, SymmetricPairs
from saccade.viewing import keypoint_frame_figure
from saccade.viewing.attention import axis_of
from saccade.viewing.keypoints import KeypointView
from saccade.viewing.style import GREEN, RED

CHELSEA = saccade.read_image(files("saccade") / "data" / "chelsea.jpg")


def keypoint(x, y, size, angle):
    at = Keypoints.at(np.array([[x, y]]), size)
    at.angle[:] = angle
    return at


def pairs_across(axis, about=(50.0, 40.0), spread=(0.0,)):
    across = axis + np.pi / 2 + np.array(spread)
    offset = 7 * np.stack([np.cos(across), np.sin(across)], axis=1)
    n = len(across)
    middle = np.array(about)
    return SymmetricPairs(
        middle + offset, middle - offset, across, across + np.pi, np.ones(n), np.zeros(n, np.int64)
    )


def patches(figure):
    return [axes.images[0].get_array() for axes in figure.axes if axes.images]


def spine_color(axes):
    return axes.spines["left"].get_edgecolor()[:3]


@pytest.mark.parametrize("axis", np.linspace(-1.5, 1.5, 7))
def test_axis_bisects_its_pairs(axis):
    found = axis_of(pairs_across(axis, spread=(-0.2, 0.0, 0.2)))
    assert np.cos(2 * (found - axis)) == pytest.approx(1)


def test_pairs_in_all_directions_have_no_axis():
    assert axis_of(pairs_across(0.3, spread=np.linspace(0, np.pi, 8, endpoint=False))) is None
    assert axis_of(pairs_across(0.3)[:0]) is None


def test_a_turned_and_scaled_photograph_has_the_same_patch():
    turn, scale, x, y = 0.6, 1.4, 230.0, 150.0
    affine = cv2.getRotationMatrix2D((x, y), -np.degrees(turn), scale)
    second = cv2.warpAffine(CHELSEA, affine, CHELSEA.shape[1::-1], flags=cv2.INTER_CUBIC)
    views = (
        KeypointView(CHELSEA, keypoint(x, y, 12, 0.2)),
        KeypointView(second, keypoint(x, y, 12 * scale, 0.2 + turn)),
    )
    first, other = patches(keypoint_frame_figure([views], ["inlier"]))
    assert np.abs(first - other).mean() < 0.02
    (wrong,) = patches(keypoint_frame_figure([(views[0], views[0])], ["inlier"]))[1:]
    turned = patches(
        keypoint_frame_figure(
            [(views[0], KeypointView(second, keypoint(x, y, 12, 0.2)))], ["outlier"]
        )
    )[1]
    assert np.abs(wrong - turned).mean() > 0.1


def test_outcomes_are_named_and_colored():
    view = KeypointView(CHELSEA, keypoint(100, 100, 10, 0), pairs_across(0.0, (100.0, 100.0)))
    figure = keypoint_frame_figure([(view, view)] * 8, ["inlier", "outlier", *["rejected"] * 6])
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:2] == ["1: inlier", "2: outlier"]
    assert "8: rejected" in titles
    assert spine_color(figure.axes[0]) == pytest.approx(to_rgb(GREEN))
    assert spine_color(figure.axes[1]) == pytest.approx(to_rgb(RED))


def test_pairs_lie_across_the_drawn_axis():
    size, angle = 20.0, 0.7
    view = KeypointView(CHELSEA, keypoint(200, 150, size, angle), pairs_across(1.1, (200.0, 150.0)))
    axes = keypoint_frame_figure([(view, view)], ["matched"]).axes[0]
    (axis,) = [line for line in axes.lines if line.get_linestyle() == "--"]
    dx, dy = np.diff(axis.get_data())[:, 0]
    assert np.cos(2 * (np.arctan2(dy, dx) - (1.1 - angle))) == pytest.approx(1)
    middle = np.mean(axis.get_data(), axis=1)
    np.testing.assert_allclose(middle, (np.array(axes.get_xlim()).mean(),) * 2, atol=1e-6)
