"""Discs and blobs: what symmetry detectors find."""

import cv2
import numpy as np


def discs(*places, shape=(160, 200), ground=0.5):
    """Grey with discs of (x, y, radius, brightness)."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    image = np.full(shape, ground)
    for x, y, radius, brightness in places:
        inside = np.clip(radius + 0.5 - np.hypot(columns - x, rows - y), 0, 1)
        image += inside * (brightness - ground)
    return image.astype(np.float32)


def texture(seed, shape=(120, 150)):
    """Blobs of every size."""
    rng = np.random.default_rng(seed)
    planes = [cv2.resize(rng.random([s >> k for s in shape]), shape[::-1]) for k in range(2, 6)]
    return np.mean(planes, axis=0).astype(np.float32)
