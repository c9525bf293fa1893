"""Faces count where a detector finds them, and nothing changes without one."""

import cv2
import numpy as np
import pytest

from saccade.attention import AttentionConfig, attention_saliency
from saccade.attention.combined import FACE_SPREAD, face_map
from saccade.errors import ConfigError, ImageError
from saccade.face_detection import find_face_detector

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


@pytest.mark.parametrize("name", ["absent.onnx", "broken.onnx", "absent.xml", "broken.xml"])
def test_a_file_that_is_no_detector_is_named(tmp_path, name):
    if name.startswith("broken"):
        (tmp_path / name).write_text("this is no model")
    with pytest.raises(ConfigError, match=name):
        find_face_detector(tmp_path / name)


def test_yunet_is_given_the_image_and_its_boxes_are_scaled_back(tmp_path, monkeypatch, rng):
    """A stand-in for OpenCV's class: its model is not part of the package."""
    given = {}

    class YuNet:
        @staticmethod
        def create(model, *_):
            given["model"] = model
            return YuNet()

        def setInputSize(self, size):  # noqa: N802
            given["size"] = size

        def detect(self, bgr):
            given["bgr"] = bgr
            return 1, np.array([[10, 20, 30, 40, *range(10), 0.9]], np.float32)

    monkeypatch.setattr(cv2, "FaceDetectorYN", YuNet)
    (tmp_path / "yunet.onnx").touch()
    detect = find_face_detector(tmp_path / "yunet.onnx")
    image = np.zeros((800, 1600, 3), np.float32)
    image[..., 0] = 1
    np.testing.assert_allclose(detect(image), [[20, 40, 60, 80]])
    assert given["size"] == (800, 400)
    assert given["bgr"].dtype == np.uint8
    assert given["bgr"][0, 0].tolist() == [0, 0, 255]
    np.testing.assert_allclose(detect(np.zeros((40, 50), np.uint8)), [[10, 20, 30, 40]])
