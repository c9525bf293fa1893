"""SymRoID: shapes whose regions are known, and regions of changed images."""

import dataclasses

import cv2
import numpy as np
import pytest

from saccade import SymRoid, SymRoidConfig
from support.symmetric_images import discs, texture


@pytest.mark.parametrize("radius", [10, 16])
def test_a_disc_is_a_region_about_its_center(radius):
    image = discs((120, 80, radius, 0.95), shape=(240, 320), ground=0.2)
    regions = SymRoid()(image)
    assert np.hypot(*(regions.xy[0] - (120, 80))) < 2
    left, top, right, bottom = regions.boxes[0]
    assert left < 120 < right
    assert top < 80 < bottom
    side = SymRoidConfig().must().radius * regions.keypoints.size[0]
    np.testing.assert_allclose((right - left, bottom - top), side, rtol=1e-4)
    assert repr(regions) == f"Regions({len(regions)} regions)"
    assert regions.descriptors.shape == (len(regions), 128)


def test_fewer_regions_are_the_strongest():
    image = texture(3, (240, 320))
    every = SymRoid(SymRoidConfig(max_keypoints=None))(image)
    few = SymRoid(SymRoidConfig(max_keypoints=3))(image)
    assert len(every) > len(few) == 3
    np.testing.assert_array_equal(few.boxes, every.boxes[:3])
    np.testing.assert_array_equal(few.descriptors, every.descriptors[:3])


def test_a_frame_turns_and_grows_with_the_image():
    """Regions of an image turned by 90 degrees and doubled are the same, turned and doubled."""
    image = texture(5, (200, 260))
    changed = cv2.resize(np.ascontiguousarray(image.T[:, ::-1]), None, fx=2, fy=2)
    here = SymRoid(SymRoidConfig(max_keypoints=10))(image).keypoints
    there = SymRoid(SymRoidConfig(max_keypoints=None, seed_threshold=1e-3))(changed).keypoints
    expected = 2 * np.stack([199 - here.xy[:, 1], here.xy[:, 0]], axis=1) + 0.5
    gap = np.hypot(*(expected[:, None] - there.xy[None]).transpose(2, 0, 1))
    turn = here.angle[:, None] + np.pi / 2 - there.angle[None]
    growth = np.log2(there.size[None] / here.size[:, None])
    same = (gap < 1) & (np.abs(growth - 1) < 0.2) & (np.cos(turn) > 0.98)
    assert same.any(axis=1).mean() > 0.8


def test_no_region_is_within_a_stronger_one():
    points = SymRoid(SymRoidConfig(max_keypoints=None))(texture(6, (240, 320))).keypoints
    assert len(points) > 50
    gap = np.hypot(*(points.xy[:, None] - points.xy[None]).transpose(2, 0, 1))
    reach = np.maximum(points.size[:, None], points.size[None])
    assert ((gap == 0) | (gap > 0.999 * reach)).all()


@pytest.mark.parametrize(("upright", "least"), [(True, 0.9), (False, 0.7)])
def test_regions_are_found_and_told_apart_under_other_light(upright, least):
    """A direction is one more thing that may be taken for another."""
    image = texture(4, (240, 320))
    config = SymRoidConfig(upright=upright)
    here = SymRoid(config)(image)
    dark = SymRoid(dataclasses.replace(config, max_keypoints=None))(0.6 * image)
    places = np.hypot(*(here.xy[:, None] - dark.xy[None]).transpose(2, 0, 1))
    assert (places.min(axis=1) < 3).all()
    distance = np.linalg.norm(
        here.descriptors[:, None].astype(float) - dark.descriptors[None].astype(float), axis=2
    )
    right = places[np.arange(len(here)), distance.argmin(axis=1)] < 3
    assert right.mean() > least
