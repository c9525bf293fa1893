"""Views of a plane, against positions that are known."""

import numpy as np
import pytest

from saccade.datasets.homography_pairs import homography_pairs
from saccade.io.image import as_gray, read_image
from saccade.keypoints.two_view_fit import project
from synthetic_pairs import (
    SyntheticPairsConfig,
    packaged_photographs,
    view_homography,
    write_synthetic_pairs,
)


def test_a_tilt_is_a_turn_of_the_camera_about_what_it_looks_at():
    """The area shrinks by the cosine of the tilt, along the azimuth by its square over that."""
    target, step = np.array([300.0, 200.0]), 1e-3
    matrix = view_homography((480, 640), target, 1.0, tilt=np.radians(60))
    x, y = (project(matrix, target + np.eye(2) * step) - project(matrix, target[None])) / step
    assert abs(np.linalg.det([x, y])) == pytest.approx(0.5, rel=1e-4)
    turned = view_homography((480, 640), target, 1.0, tilt=np.radians(60), azimuth=1.0)
    x, y = (project(turned, target + np.eye(2) * step) - project(turned, target[None])) / step
    assert abs(np.linalg.det([x, y])) == pytest.approx(0.5, rel=1e-4)


def test_pairs_are_written_and_related_by_their_homographies(tmp_path):
    folder = tmp_path / "photographs"
    folder.mkdir()
    path = packaged_photographs()[0]
    (folder / path.name).write_bytes(path.read_bytes())
    clean = SyntheticPairsConfig(min_pairs=3, views=2, noise=0, blur=0, gamma=1, quality=95)
    write_synthetic_pairs(tmp_path / "pairs", folder, clean)
    pairs = homography_pairs(tmp_path / "pairs")
    assert [pair.sequence for pair in pairs] == ["astronaut-1"] * 2 + ["astronaut-2"] * 2
    for pair in pairs:
        first, second = (as_gray(read_image(each)) for each in (pair.first, pair.second))
        height, width = second.shape
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        back = np.linalg.inv(pair.homography)
        xy = np.rint(project(back, np.c_[x.ravel(), y.ravel()])).astype(int)
        seen = ((xy >= 0) & (xy < first.shape[::-1])).all(axis=1)
        same = np.corrcoef(first[xy[seen, 1], xy[seen, 0]], second.ravel()[seen])[0, 1]
        assert same > 0.9, pair.second
