"""Faces count where a detector finds them, and nothing changes without one."""

import numpy as np
import pytest

from saccade.attention import AttentionConfig, attention_saliency
from saccade.attention.combined import FACE_SPREAD, face_map
from saccade.errors import ImageError

BOX = np.array([[40.0, 16.0, 32.0, 40.0]])
"""Left, top, width and height."""


@pytest.fixture
def photo(rng):
    return rng.random((120, 160, 3)).astype(np.float32)


def test_a_face_is_a_gaussian_of_its_box():
    faces = face_map(np.vstack([BOX, BOX]), (120, 160), (120, 160))  # twice is once
    assert np.unravel_index(faces.argmax(), faces.shape) in {(35, 55), (36, 56)}
    y, x = np.indices(faces.shape) + 0.5
    dy, dx = (y - 36) / (FACE_SPREAD * 40), (x - 56) / (FACE_SPREAD * 32)
    np.testing.assert_allclose(faces, np.exp(-(dx**2 + dy**2) / 2), atol=1e-6)
    coarse = face_map(BOX, (120, 160), (15, 20))
    assert np.unravel_index(coarse.argmax(), coarse.shape) == (4, 6)


def test_no_face_is_an_empty_map():
    for none in (np.zeros((0, 4)), [], ()):
        assert not face_map(none, (12, 16), (3, 4)).any()


@pytest.mark.parametrize("box", [(0, 0, 0, 5), (0, np.nan, 3, 3), (1, 1, 2, -1)])
def test_boxes_that_are_none_are_refused(box):
    with pytest.raises(ImageError, match="faces: expected finite boxes"):
        face_map(np.array([box]), (12, 16), (3, 4))


def test_a_face_is_salient_as_far_as_it_weighs(photo):
    seen = []

    def detector(image):
        seen.append(image.shape)
        return BOX

    without = attention_saliency(photo)
    maps = attention_saliency(photo, faces=detector)
    assert seen == [photo.shape]
    assert without.faces is None
    assert "faces" not in without.layers
    shape = maps.saliency.shape
    inside = face_map(BOX, photo.shape[:2], shape) > 0.5
    np.testing.assert_array_equal(maps.layers["faces"], face_map(BOX, photo.shape[:2], shape))
    share = [m.saliency[inside].sum() / m.saliency.sum() for m in (without, maps)]
    assert share[1] > 1.5 * share[0]
    unweighted = attention_saliency(photo, AttentionConfig(face_weight=0), faces=detector)
    np.testing.assert_allclose(unweighted.saliency, without.saliency, atol=1e-6)
