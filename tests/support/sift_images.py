"""Textures for SIFT, its presets, and how its points are compared."""

import numpy as np
from scipy import ndimage

from saccade.settings import load_settings, preset_names

PRESETS = {name: load_settings("sift", name) for name in preset_names("sift")}
UNBIASED = [name for name in PRESETS if name != "opencv"]
FIELDS = ("xy", "size", "angle", "response", "octave", "descriptors")


def texture(rng, shape):
    """Noise at several scales, in [0, 1]."""
    layers = [
        ndimage.gaussian_filter(rng.standard_normal(shape), s, mode="mirror") * s for s in (1, 2, 4)
    ]
    return (0.5 + 0.5 * np.tanh(np.sum(layers, axis=0))).astype(np.float32)


def features(xy, size, angle):
    """Rows whose distance says how far points are apart in place, size and angle."""
    return np.c_[xy, 10 * np.log(size), size / 2 * np.cos(angle), size / 2 * np.sin(angle)]


def assert_same(a, b):
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field), err_msg=field)
