"""A photograph with layers to switch, and two of them with their matches, as parts of a report."""

import base64
from collections.abc import Mapping
from functools import cache
from io import BytesIO
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

from saccade.types import Float32Array, IntArray, Keypoints, Scanpath
from saccade.viewing.page import Section
from saccade.viewing.report import Part, jpeg, with_notes
from saccade.viewing.style import HEAT

MAX_SIDE = 1200
"""Pixels, of the longer side of a photograph in a report."""
MAX_MAP_SIDE = 400
"""The same where there are many."""
MAX_POINTS = 400
"""Interest points that are shown with their descriptors."""
MAX_MATCHES = 5000


def image_part(
    section: Section,
    image: Float32Array,
    maps: Mapping[str, Float32Array],
    path: Scanpath,
    keypoints: Keypoints | None = None,
    longest: int = MAX_SIDE,
) -> Part:
    """A photograph, where it draws the eye, and its interest points.

    Args:
        section: heading, text, facts and links.
        image: (H, W, 3) in [0, 1].
        maps: by title; each (h, w), not negative.
        path: fixations.
        keypoints: the first `MAX_POINTS` of them are shown.
        longest: pixels of the longer side in the report.
    """
    points = None if keypoints is None else keypoints[:MAX_POINTS]
    data: dict[str, Any] = {
        "image": photograph(image, longest),
        "maps": [{"name": name, "address": heat(values)} for name, values in maps.items()],
        "scanpath": scanpath_data(path),
    }
    if points is not None:
        data["points"] = points_data(points)
    return Part(section, "image", data)


def match_part(
    section: Section,
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: npt.NDArray[np.bool_] | None = None,
) -> Part:
    """Two photographs and what they share.

    Args:
        section: heading, text, facts and links.
        images: two (H, W, 3) in [0, 1].
        keypoints: of each.
        pairs: (m, 2) indices into the two.
        inliers: (m,) which of them agree with one geometry; None where that was not asked.
    """
    stride = -(-len(pairs) // MAX_MATCHES) or 1
    every = slice(None, None, stride)
    shown = pairs[every]
    section = with_notes(section, {"matches": (len(pairs), stride)})
    data: dict[str, Any] = {
        "images": [photograph(image) for image in images],
        "xy": np.hstack([keypoints[i].xy[shown[:, i]] for i in (0, 1)]).ravel(),
        "size": np.stack([keypoints[i].size[shown[:, i]] for i in (0, 1)], 1).ravel(),
    }
    first, second = (each.descriptors for each in keypoints)
    if first is not None and second is not None:
        apart = first[shown[:, 0]].astype(np.float64) - second[shown[:, 1]]
        data["distance"] = np.sqrt(np.square(apart).sum(1))
    if inliers is not None:
        data["inlier"] = inliers[every].astype(np.uint8)
    return Part(section, "match", data)


def scanpath_data(path: Scanpath) -> dict[str, Any]:
    """Fixations as the script of an image takes them."""
    return {"xy": path.xy.ravel(), "time": path.time, "saliency": path.saliency}


def points_data(points: Keypoints) -> dict[str, Any]:
    """Interest points, likewise."""
    data: dict[str, Any] = {
        "xy": points.xy.ravel(),
        "size": points.size,
        "angle": points.angle,
        "response": points.response,
        "octave": points.octave,
    }
    if points.descriptors is not None:
        data["descriptor"] = points.descriptors.ravel()
    return data


def photograph(image: Float32Array, longest: int = MAX_SIDE) -> dict[str, Any]:
    """A photograph (H, W, 3) in [0, 1] as a JPEG, and its size; `longest` is of its longer side."""
    height, width = image.shape[:2]
    scale = min(1.0, longest / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    levels = np.asarray((small * 255).round().clip(0, 255), np.uint8)
    return {"address": jpeg(levels, 82), "width": width, "height": height}


def heat(values: Float32Array) -> str:
    """A map as the address of a PNG, from 0 to its maximum."""
    scale = min(1.0, MAX_MAP_SIDE / max(values.shape))
    size = (max(1, round(values.shape[1] * scale)), max(1, round(values.shape[0] * scale)))
    small = cv2.resize(np.asarray(values, np.float32), size, interpolation=cv2.INTER_AREA)
    levels = np.asarray((small * (255 / max(float(small.max()), 1e-12))).round(), np.uint8)
    picture = Pillow.fromarray(levels, "L")
    picture.putpalette(_palette())
    with BytesIO() as file:
        picture.save(file, format="PNG")
        return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


@cache
def _palette() -> bytes:
    """The 256 colors of a map."""
    colors = mpl.colormaps[HEAT](np.arange(256))[:, :3]
    return np.asarray((colors * 255).round(), np.uint8).tobytes()
