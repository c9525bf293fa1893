"""Parts of a report: a photograph with its layers, and two photographs with their matches."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from saccade.types import BoolArray, Float32Array, IntArray, Keypoints, Scanpath
from saccade.viewing.embedding import heat, photograph
from saccade.viewing.page import Section
from saccade.viewing.report import Part, stride, with_notes

MAX_POINTS = 400
"""Interest points shown with their descriptors."""
MAX_MATCHES = 5000


def image_part(
    section: Section,
    image: Float32Array,
    maps: Mapping[str, Float32Array],
    path: Scanpath,
    keypoints: Keypoints,
) -> Part:
    """A photograph with saliency maps, scanpath and interest points as layers.

    Args:
        section: heading, text, facts and links.
        image: (H, W, 3) in [0, 1].
        maps: by title; each (h, w), not negative.
        path: fixations.
        keypoints: the first `MAX_POINTS` of them are shown.
    """
    data = {
        "image": photograph(image),
        "maps": maps_data(maps),
        "scanpath": scanpath_data(path),
        "points": points_data(keypoints[:MAX_POINTS]),
    }
    return Part(section, "image", data)


def match_part(
    section: Section,
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: BoolArray | None = None,
) -> Part:
    """Two photographs with their matches.

    Args:
        section: heading, text, facts and links.
        images: two (H, W, 3) in [0, 1].
        keypoints: of each.
        pairs: (m, 2) indices into the two.
        inliers: (m,) which matches agree with one geometry; None without verification.
    """
    step = stride(len(pairs), MAX_MATCHES)
    first, second = (keypoints[i][pairs[::step, i]] for i in (0, 1))
    data: dict[str, Any] = {
        "images": [photograph(image) for image in images],
        "xy": np.hstack([first.xy, second.xy]).ravel(),
        "size": np.stack([first.size, second.size], 1).ravel(),
    }
    if first.descriptors is not None and second.descriptors is not None:
        difference = first.descriptors.astype(np.float64) - second.descriptors
        data["distance"] = np.sqrt(np.square(difference).sum(1))
    if inliers is not None:
        data["inlier"] = inliers[::step].astype(np.uint8)
    return Part(with_notes(section, {"matches": (len(pairs), step)}), "match", data)


def maps_data(maps: Mapping[str, Float32Array]) -> list[dict[str, str]]:
    """Saliency maps as the script of an image part reads them."""
    return [{"name": name, "address": heat(values)} for name, values in maps.items()]


def scanpath_data(path: Scanpath) -> dict[str, Any]:
    """Fixations as that script reads them."""
    return {"xy": path.xy.ravel(), "time": path.time, "saliency": path.saliency}


def points_data(points: Keypoints) -> dict[str, Any]:
    """Interest points as that script reads them."""
    names = ("size", "angle", "response", "octave")
    data = {"xy": points.xy.ravel(), **{name: getattr(points, name) for name in names}}
    if points.descriptors is not None:
        data["descriptor"] = points.descriptors.ravel()
    return data
