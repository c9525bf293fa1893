"""Fixtures of the tests of evaluation."""

import cv2
import numpy as np
import pytest

from support.shift import SHIFT


@pytest.fixture
def scene(tmp_path, rng):
    """A sequence of two images: noise, and the same moved by 10 px."""
    folder = tmp_path / "scenes" / "noise"
    folder.mkdir(parents=True)
    picture = cv2.GaussianBlur(rng.random((160, 200)), (0, 0), 2)
    picture = np.rint(255 * (picture - picture.min()) / np.ptp(picture)).astype(np.uint8)
    cv2.imwrite(str(folder / "1.png"), picture[:, 10:])
    cv2.imwrite(str(folder / "2.png"), picture[:, :-10])
    np.savetxt(folder / "H_1_2.txt", SHIFT)
    return folder
