"""Images in the order of colors of OpenCV."""

from importlib.resources import files

import cv2
import numpy as np
import pytest

import saccade


@pytest.mark.parametrize("name", ["attention", "contrast", "symmetry", "boolean"])
@pytest.mark.parametrize("alpha", [False, True])
def test_images_of_opencv_are_seen_as_they_are(name, alpha):
    saliency = getattr(saccade, f"{name}_saliency")
    bgr = cv2.imread(str(files("saccade") / "data" / "hallway_1.jpg"))[::3, ::3].copy()
    bgr[40:60, 50:80] = (200, 90, 20)
    if alpha:
        bgr = cv2.cvtColor(bgr, cv2.COLOR_BGR2BGRA)
        bgr[:20, :, 3] = 100
    rgb = cv2.cvtColor(bgr, cv2.COLOR_BGRA2RGBA if alpha else cv2.COLOR_BGR2RGB)
    told = saliency(bgr, bgr=True).saliency
    np.testing.assert_array_equal(told, saliency(rgb).saliency)
    assert (told != saliency(bgr).saliency).any()
    gray = bgr[:, :, 0].copy()
    np.testing.assert_array_equal(saliency(gray, bgr=True).saliency, saliency(gray).saliency)
