"""Exactly as many points as asked for, the strongest or spread over the image."""

from dataclasses import replace
from importlib.resources import files

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from saccade import Sift, SiftConfig
from saccade.keypoints.detection import spread_out
from support.sift_images import PRESETS, UNBIASED

ROCKET = str(files("saccade") / "data" / "rocket.jpg")


def suppression_radii(xy, response):
    """Brown et al. (2005), by their formula."""
    radii = np.full(len(xy), np.inf)
    for i, (place, strength) in enumerate(zip(xy, response, strict=True)):
        stronger = xy[strength < 0.9 * response]
        if len(stronger):
            radii[i] = np.hypot(*(stronger - place).T).min()
    return radii


@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.integers(1, 70), st.integers(1, 9))
@settings(max_examples=60)
def test_the_kept_have_the_greatest_radii(seed, n, count, levels):
    rng = np.random.default_rng(seed)
    xy = rng.integers(0, 12, (n, 2)).astype(float)  # many of equal radius, some of one place
    response = np.sort(rng.integers(1, 1 + levels, n))[::-1].astype(np.float32)
    order = spread_out(xy, response)
    assert sorted(order) == list(range(n))
    kept = np.isin(np.arange(n), order[:count])
    radii = suppression_radii(xy, response.astype(float))
    if kept.any() and not kept.all():
        assert radii[kept].min() >= radii[~kept].max()
        border = np.flatnonzero(radii == radii[kept].min())
        assert (np.diff(kept[border].astype(int)) <= 0).all()  # of equal ones the first


@pytest.fixture(scope="module")
def photo():
    return cv2.imread(ROCKET)


def strength(points, config):
    """Scales count up to a fiftieth of the number that is asked for."""
    if config.ranking == "response":
        return points.response
    return points.response / np.hypot(2 / points.size, 50 / config.max_keypoints)


@pytest.mark.parametrize("preset", UNBIASED)
@pytest.mark.parametrize("spread", [False, True])
def test_the_number_is_exact(photo, preset, spread):
    config = replace(PRESETS[preset], contrast_threshold=0.02)
    every = len(Sift(config)(photo))
    for count in (1, 2, 37, every - 1, every, every + 1):
        limited = replace(config, max_keypoints=count, spread=spread)
        chosen = Sift(limited)(photo)
        assert len(chosen) == min(count, every)
        assert (np.diff(strength(chosen, limited)) <= 1e-6 * strength(chosen, limited)[1:]).all()


def test_without_a_threshold_there_are_as_many_as_asked_for(photo):
    """However weak: at a fraction of the contrast few exceed the threshold."""
    pale = 0.5 + (photo / 255 - 0.5) / 2
    above = len(Sift()(pale))
    assert 0 < above < 300
    assert len(Sift(SiftConfig(max_keypoints=300))(pale)) == 300
    capped = Sift(SiftConfig(max_keypoints=300, contrast_threshold=0.016))(pale)
    assert len(capped) == above


@pytest.mark.parametrize("count", [50, 150])
def test_spread_points_cover_the_image(photo, count):
    """No place is as far from a point as without spread, and more cells of a grid have one."""
    rows, columns = np.indices(photo.shape[:2])
    places = np.c_[columns.ravel(), rows.ravel()][::50]
    found, gaps, cells = [], [], []
    for spread in (False, True):
        points = Sift(SiftConfig(max_keypoints=count, spread=spread))(photo)
        gaps.append(cKDTree(points.xy).query(places)[0].mean())
        cells.append(len(np.unique(points.xy // 40, axis=0)))
        found.append(points)
    print(f"\n{count}: mean gap {gaps[0]:.1f} -> {gaps[1]:.1f} px, cells {cells[0]} -> {cells[1]}")
    assert gaps[1] < 0.9 * gaps[0]
    assert cells[1] > 1.15 * cells[0]
    assert found[1].response[0] == found[0].response[0]


def test_of_noise_no_octave_is_stronger_than_another(rng):
    """Its |D| falls as 1 / sigma, so that the signal-to-noise ratio is that of each scale."""
    noise = rng.normal(0.5, 0.1, (512, 512)).clip(0, 1)
    points = Sift(SiftConfig(contrast_threshold=0.0))(noise, describe=False)
    octaves = [points.octave == number for number in (-1, 0, 1)]
    assert min(octave.sum() for octave in octaves) > 30
    response = [np.median(points.response[octave]) for octave in octaves]
    ratio = [np.median((points.response * points.size)[octave]) for octave in octaves]
    print(f"\n|D| {np.round(response, 4)}, |D| sigma {np.round(ratio, 3)}")
    assert max(response) > 5 * min(response)
    assert max(ratio) < 1.2 * min(ratio)
