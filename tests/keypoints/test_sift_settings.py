"""Whatever numbers the settings are: points, or one line that names the setting."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from saccade import Keypoints, Sift, SiftConfig
from saccade.errors import ConfigError
from support.sift_images import texture


def settings_of(kind):
    return [field.name for field in dataclasses.fields(SiftConfig) if field.type == kind]


OPTIONAL_WHOLE, OPTIONAL_REAL = settings_of(int | None), settings_of(float | None)
WHOLE, REAL = settings_of(int) + OPTIONAL_WHOLE, settings_of(float) + OPTIONAL_REAL
SWITCHES = settings_of(bool)
CHOICES = {
    "grid": ("centered", "shifted", "printed"),
    "neighbors": (10, 26),
    "ranking": ("signal-to-noise", "response"),
    "fit": ("lagrange", "quadratic", "once"),
    "voting": ("linear", "nearest"),
    "orientation_bins": ("peaks", "all"),
    "descriptor": ("sift", "root", "kootstra2010"),
    "descriptor_dtype": ("uint8", "float32"),
}
IMAGES = {
    "texture": texture(np.random.default_rng(3), (37, 45)),
    "noise": np.random.default_rng(4).random((24, 70), np.float32),
    "square": np.pad(np.ones((9, 9), np.float32), 14),
    "black": np.zeros((20, 20), np.float32),
    "tiny": np.ones((3, 50), np.float32),
}

whole = st.integers(-2, 6) | st.integers(-(2**70), 2**70)
real = st.floats(0, 2) | st.floats(0, 20) | st.floats()
valid = {
    "first_octave": st.sampled_from([-1, 0]),
    "octaves": st.none() | st.integers(1, 4),
    "intervals": st.integers(1, 6) | st.integers(1, 16),
    "extra_intervals": st.integers(0, 4) | st.integers(0, 16),
    "base_sigma": st.floats(0.5, 8),
    "density": st.sampled_from([0.5, 1.0]),
    "camera_sigma": st.floats(0, 4),
    "kernel_radius": st.floats(1, 8),
    "border": st.integers(2, 12) | st.integers(2, 2**70),
    "contrast_threshold": st.floats(0, 0.05) | st.floats(0, 1, exclude_max=True),
    "candidate_fraction": st.floats(0, 1),
    "edge_ratio": st.floats(1, 20) | st.floats(min_value=1),
    "smoothing": st.integers(0, 8) | st.integers(0, 100),
    "max_orientations": st.none() | st.integers(1, 3) | st.integers(1, 2**62),
    "orientation_spacing": st.none() | st.floats(0, 3, exclude_min=True),
    "descriptor_spacing": st.none() | st.floats(0, 3, exclude_min=True),
    "window_sigma": st.floats(0.1, 10),
    "max_keypoints": st.integers(1, 50) | st.integers(1, 2**62),
    **{name: st.booleans() for name in SWITCHES},
    **{name: st.sampled_from(values) for name, values in CHOICES.items()},
}


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


def test_every_setting_is_tried():
    assert {*WHOLE, *REAL, *SWITCHES, *CHOICES} == valid.keys()
    assert {field.name for field in dataclasses.fields(SiftConfig)} == valid.keys()


@given(st.fixed_dictionaries({}, optional=valid), st.sampled_from(sorted(IMAGES)))
@settings(max_examples=60)
@example({"border": 2, "contrast_threshold": 0.0, "edge_ratio": 1e300, "intervals": 16}, "noise")
@example({"border": 2, "contrast_threshold": 0.0, "candidate_fraction": 0.0}, "square")
@example({"kernel_radius": 1.0}, "texture")
def test_valid_settings_give_points(values, image):
    if values.get("spread") and "max_keypoints" not in values:
        values["max_keypoints"] = 7
    if values.get("grid") in ("shifted", "printed"):
        values["density"] = 1.0
    detect_and_check(SiftConfig(**values), IMAGES[image])


@given(
    st.dictionaries(st.sampled_from([*WHOLE, *REAL]), whole | real, min_size=1, max_size=4),
    st.sampled_from(sorted(IMAGES)),
)
@settings(max_examples=100)
def test_any_numbers_give_points_or_one_line(values, image):
    try:
        config = SiftConfig(**values)
    except ConfigError as error:
        message = str(error)
    else:
        message = ""
        detect_and_check(config, IMAGES[image])
    names = [name for name in values if message.startswith(f"{name}: expected ")]
    assert not message or (len(names) == 1 and "\n" not in message)


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("value", [1.5, float("nan"), float("inf"), "3", None])
def test_whole_numbers_are_whole(name, value):
    if value is None and name in OPTIONAL_WHOLE:
        return
    with pytest.raises(ConfigError, match=f"^{name}: expected .*found {value!r}"):
        SiftConfig(**{name: value})


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("value", [float("nan"), -float("inf"), "3", None, 1j])
def test_real_numbers_are_real(name, value):
    if value is None and name in OPTIONAL_REAL:
        return
    with pytest.raises(ConfigError, match=f"^{name}: expected .*found"):
        SiftConfig(**{name: value})
