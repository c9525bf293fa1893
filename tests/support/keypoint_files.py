"""Interest points made at random, and whether two sets of them are the same to the bit."""

from importlib.resources import files

import numpy as np

from saccade.types import Keypoints

FIELDS = ("xy", "size", "angle", "response", "octave", "descriptors")
HALLWAY = [str(files("saccade") / "data" / f"hallway_{number}.jpg") for number in (1, 2)]


def random_points(rng, n=40, described=True):
    return Keypoints(
        xy=(rng.random((n, 2)) * 4000).astype(np.float32),
        size=rng.uniform(1, 300, n).astype(np.float32),
        angle=rng.uniform(-np.pi, np.pi, n).astype(np.float32),
        response=rng.random(n).astype(np.float32),
        octave=rng.integers(-1, 8, n).astype(np.int32),
        descriptors=rng.integers(0, 256, (n, 128)).astype(np.uint8) if described else None,
    )


def assert_same(found, expected, fields=FIELDS):
    for field in fields:
        a, b = getattr(found, field), getattr(expected, field)
        if b is None:
            assert a is None
            continue
        assert a.dtype == b.dtype, field
        np.testing.assert_array_equal(a, b, err_msg=field)
