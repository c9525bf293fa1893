"""The strongest keypoints of two images in their own frames, for `saccade match`."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from saccade.cli.symmetry_overlay import contributing_pairs
from saccade.keypoints import Must, SymRoid, match
from saccade.types import BoolArray, Float32Array, IntArray, Keypoints
from saccade.viewing import keypoint_frame_figure
from saccade.viewing.keypoint_frames import KeypointView, Outcome

MAX_SHOWN = 12
"""Number of the strongest keypoints of the first image that are drawn."""
CAPTION = (
    "The strongest keypoints of the first image, each above its nearest neighbor in the second, "
    "turned and scaled to the frame of the keypoint."
)


def frames_figure(
    detector: Any,
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: BoolArray | None,
) -> tuple[Figure, str, str] | None:
    """Draw the strongest keypoints in both images; None where there are none.

    Args:
        detector: that found the keypoints.
        images: two (H, W, 3) in [0, 1].
        keypoints: of each.
        pairs: (m, 2) matches.
        inliers: (m,) which matches agree with one geometry; None without verification.
    """
    views, outcomes = in_frames(detector, images, keypoints, pairs, inliers)
    if not views:
        return None
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in dict.fromkeys(outcomes))
    figure = keypoint_frame_figure(views, outcomes)
    return figure, f"Patches of keypoints in two images: {counts}", CAPTION


def in_frames(
    detector: Any,
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: BoolArray | None,
) -> tuple[list[tuple[KeypointView, KeypointView]], list[Outcome]]:
    """The strongest keypoints with their nearest neighbors, and what became of them."""
    shown = strongest_positions(keypoints[0])
    nearest = match(keypoints[0][shown], keypoints[1], ratio=None, mutual=False)
    rows = shown[nearest[:, 0]], nearest[:, 1]
    first, second = (
        views_of(detector, image, points[index])
        for image, points, index in zip(images, keypoints, rows, strict=True)
    )
    outcomes = [outcome(row, pairs, inliers) for row in rows[0].tolist()]
    return list(zip(first, second, strict=True)), outcomes


def strongest_positions(keypoints: Keypoints) -> IntArray:
    """Indices of the strongest keypoints, one for each position."""
    order = np.argsort(-keypoints.response, kind="stable")
    _, first = np.unique(keypoints.xy[order], axis=0, return_index=True)
    return order[np.sort(first)[:MAX_SHOWN]]


def views_of(detector: Any, image: Float32Array, keypoints: Keypoints) -> list[KeypointView]:
    """Each keypoint with the pairs of its symmetry, where it was detected by symmetry."""
    rows = [keypoints[i : i + 1] for i in range(len(keypoints))]
    if not isinstance(detector, Must | SymRoid):
        return [KeypointView(image, row) for row in rows]
    pairs = contributing_pairs(detector, image, keypoints)
    return [KeypointView(image, row, each) for row, each in zip(rows, pairs, strict=True)]


def outcome(row: int, pairs: IntArray, inliers: BoolArray | None) -> Outcome:
    """What became of a keypoint of the first image."""
    matched = pairs[:, 0] == row
    if not matched.any():
        return "rejected"
    if inliers is None:
        return "matched"
    return "inlier" if inliers[matched].any() else "outlier"
