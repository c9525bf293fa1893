"""How far a point is from its own place in a photograph that was turned or resized."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from saccade import Sift, SiftConfig, match

SCENES = ("bikes", "boat", "graf", "leuven")
PRESETS = {
    name: replace(getattr(SiftConfig, name)(), max_keypoints=4000)
    for name in ("recommended", "opencv")
}


def turned(image, degrees):
    """The image about its corner, all of it, and the (2, 3) matrix that leads there."""
    matrix = cv2.getRotationMatrix2D((0, 0), degrees, 1.0)
    height, width = image.shape
    corners = matrix @ np.array(
        [[0, width - 1, 0, width - 1], [0, 0, height - 1, height - 1], [1] * 4]
    )
    matrix = matrix.copy()
    matrix[:, 2] -= corners.min(axis=1)
    size = tuple(int(side) for side in np.ceil(np.ptp(corners, axis=1)) + 1)
    flags, border = cv2.INTER_LANCZOS4, cv2.BORDER_REFLECT_101
    return cv2.warpAffine(image, matrix, size, flags=flags, borderMode=border), matrix


def resized(image, scale):
    """The image with round(scale side) pixels to a side, and the (2, 3) matrix that leads there."""
    size = [round(side * scale) for side in image.shape[::-1]]
    x, y = np.divide(size, image.shape[::-1])
    matrix = np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2]])
    return cv2.resize(
        image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    ), matrix


def median_error(sift, image, picture, matrix, scale=1.0):
    """Of matches within 3 px of their place, in px of the coarser image."""
    here, there = sift(image), sift(picture)
    pairs = match(here, there)
    expected = here.xy[pairs[:, 0]] @ matrix[:, :2].T + matrix[:, 2]
    error = np.hypot(*(there.xy[pairs[:, 1]] - expected).T) / max(scale, 1)
    return float(np.median(error[error < 3]))


def photographs(shared):
    return [
        cv2.imread(str(shared / "data/pairs/oxford" / scene / "1.png"), cv2.IMREAD_GRAYSCALE)
        for scene in SCENES
    ]


@pytest.mark.shared
@pytest.mark.parametrize(
    ("preset", "bounds"), [("recommended", (0, 0.06)), ("opencv", (0.15, 0.5))]
)
def test_turned_photographs(shared, preset, bounds):
    sift = Sift(PRESETS[preset])
    error = [
        median_error(sift, image, *turned(image, angle))
        for image in photographs(shared)
        for angle in (10, 137)
    ]
    print(f"\n{preset}, turned: median {np.median(error):.3f} px, at most {max(error):.3f}")
    assert bounds[0] < np.median(error) <= bounds[1]


@pytest.mark.shared
def test_resized_photographs(shared):
    sift = Sift(PRESETS["recommended"])
    error = [
        median_error(sift, image, *resized(image, scale), scale)
        for image in photographs(shared)
        for scale in (0.5, 0.7, 1.25, 1.7)
    ]
    print(f"\nresized: median {np.median(error):.3f} px, at most {max(error):.3f}")
    assert np.median(error) <= 0.105
