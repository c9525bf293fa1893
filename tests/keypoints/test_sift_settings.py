"""Whatever numbers the settings are: points, or one line that names the setting."""

import dataclasses
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from saccade import Keypoints, Sift, SiftConfig
from saccade.errors import RANGE
from support.sift_images import texture

IMAGES = {
    "texture": texture(np.random.default_rng(3), (37, 45)),
    "noise": np.random.default_rng(4).random((24, 70), np.float32),
    "square": np.pad(np.ones((9, 9), np.float32), 14),
    "black": np.zeros((20, 20), np.float32),
    "tiny": np.ones((3, 50), np.float32),
}

TYPES = get_type_hints(SiftConfig)


def valid(field):
    """What a setting takes, by its type and range; mostly near to the lower end."""
    kind, optional = TYPES[field.name], type(None) in get_args(TYPES[field.name])
    if kind is bool:
        return st.booleans()
    if get_origin(kind) is Literal:
        return st.sampled_from(get_args(kind))
    if field.name == "density":
        return st.sampled_from([0.5, 1.0])
    allowed = field.metadata[RANGE]
    low, high = allowed.low, allowed.high
    if int in (kind, *get_args(kind)):
        some = st.integers(low, int(min(high, low + 6))) | st.integers(low, int(min(high, 2**62)))
    else:
        open_ends = {"exclude_min": not allowed.closed[0], "exclude_max": not allowed.closed[1]}
        some = st.floats(low, high, **open_ends) | st.floats(low, min(high, low + 0.1), **open_ends)
    return st.none() | some if optional else some


VALID = {field.name: valid(field) for field in dataclasses.fields(SiftConfig)}


def detect_and_check(config, image):
    sift = Sift(config)
    found = sift(image)
    height, width = image.shape
    assert found.descriptors.shape == (len(found), 128)
    for field in ("xy", "size", "angle", "response"):
        assert np.isfinite(getattr(found, field)).all(), field
    assert (found.xy >= -0.5).all()
    assert (found.xy <= [width - 0.5, height - 0.5]).all()
    assert (found.size > 0).all()
    if config.max_keypoints is not None:
        assert len(found) <= config.max_keypoints
    again = sift.describe(image, found)
    np.testing.assert_array_equal(again.descriptors, found.descriptors)
    middle = Keypoints.at([[width / 2, height / 2]], 5)
    if min(image.shape) * config.density > 8 * 2**config.first_octave:
        assert np.isfinite(sift.describe(image, middle, orient=True).angle).all()


@given(st.fixed_dictionaries({}, optional=VALID), st.sampled_from(sorted(IMAGES)))
@settings(max_examples=60)
@example({"border": 2, "contrast_threshold": 0.0, "edge_ratio": 1e300, "intervals": 16}, "noise")
@example({"border": 2, "contrast_threshold": 0.0, "candidate_fraction": 0.0}, "square")
@example({"kernel_radius": 1.0}, "texture")
def test_valid_settings_give_points(values, image):
    if values.get("spread") and "max_keypoints" not in values:
        values["max_keypoints"] = 7
    if values.get("grid") in ("shifted", "published"):
        values["density"] = 1.0
    detect_and_check(SiftConfig(**values), IMAGES[image])
