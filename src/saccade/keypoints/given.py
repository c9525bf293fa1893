"""Where points from anywhere lie in a scale space: octave, plane, and place in samples."""

from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale_space import ScaleSpace
from saccade.types import Float32Array, IntArray, Keypoints


def locate(
    keypoints: Keypoints, space: ScaleSpace, config: SiftConfig
) -> tuple[IntArray, IntArray, Float32Array, Float32Array]:
    """Octave, plane, place and scale of points, in samples of their octave.

    A point's own octave is taken where its size belongs there, so that what a detector found
    is looked at where it was found; else the octave that has its size between the first
    plane and the last but two, or the nearest there is.

    Args:
        keypoints: n points, as `check_given` leaves them.
        space: what `config` makes of their image; at least one octave if there are points.
        config: of the detector.

    Returns:
        (n,) number of the octave in `space`; (n,) its plane that is nearest in scale; (n, 2)
        place and (n,) scale in its samples.
    """
    last, intervals = len(space.octaves) - 1, config.intervals
    sigma = keypoints.size.astype(np.float64) / 2
    level = intervals * (np.log2(sigma / config.base_sigma) - config.first_octave)
    own = keypoints.octave.astype(np.int64) - config.first_octave
    extra = config.extra_intervals * (own == 0)
    plane = np.rint(level - config.first_level(own))
    fits = (own >= 0) & (own <= last) & (plane >= 0) & (plane <= intervals + extra + 1)
    nearest = np.floor((level - config.extra_intervals - 0.5) / intervals)
    octave = np.where(fits, own, nearest.clip(0, last).astype(np.int64))
    extra = config.extra_intervals * (octave == 0)
    plane = np.rint(level - config.first_level(octave)).clip(0, intervals + extra + 2)
    plane = plane.astype(np.int64)
    spacing = space.spacing[octave]
    xy = (keypoints.xy - space.origin[octave]) / spacing[:, None]
    return octave, plane, xy.astype(np.float32), (sigma / spacing).astype(np.float32)


def check_given(keypoints: Keypoints, shape: tuple[int, int]) -> Keypoints:
    """Points in their proper dtypes, without descriptors, if an image shows them.

    Args:
        keypoints: n points.
        shape: (H, W) of the image.

    Raises:
        KeypointsError: a place outside the image, a size that is not over 0, an angle that is
            not finite, or fields of different lengths.
    """
    height, width = shape
    n = len(keypoints)
    fields = {
        "xy": (keypoints.xy, (n, 2), np.float32),
        "size": (keypoints.size, (n,), np.float32),
        "angle": (keypoints.angle, (n,), np.float32),
        "response": (keypoints.response, (n,), np.float32),
        "octave": (keypoints.octave, (n,), np.int32),
    }
    found: dict[str, npt.NDArray[Any]] = {}
    for name, (values, expected, dtype) in fields.items():
        if np.shape(values) != expected:
            raise KeypointsError(
                f"keypoints: {name}: expected shape {expected}, found {np.shape(values)}"
            )
        found[name] = np.ascontiguousarray(values, dtype)
    x, y = found["xy"].T
    inside = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
    _require_all(inside, f"a place in the image of {width} x {height} px", found["xy"])
    sized = (found["size"] > 0) & np.isfinite(found["size"])
    _require_all(sized, "a size over 0 px", found["size"])
    _require_all(np.isfinite(found["angle"]), "a finite angle", found["angle"])
    return Keypoints(**found)


def _require_all(holds: npt.NDArray[np.bool_], expected: str, found: npt.NDArray[Any]) -> None:
    if not holds.all():
        first = int(holds.argmin())
        raise KeypointsError(
            f"keypoints: expected {expected}, found {found[first].tolist()} at point {first}"
        )
