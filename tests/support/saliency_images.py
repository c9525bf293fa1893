"""Images for the saliency models, and the rank of the item that differs."""

import cv2
import numpy as np


def noise(seed, shape, dtype=np.uint8):
    """Patches of color with noise: structure on more than one scale."""
    rng = np.random.default_rng(seed)
    patches = cv2.resize(rng.random((4, 5, 3)), shape[::-1], interpolation=cv2.INTER_NEAREST)
    return ((0.7 * patches + 0.3 * rng.random((*shape, 3))) * np.iinfo(dtype).max).astype(dtype)


def rank_of_the_odd_item(saliency, image):
    """1 for the most salient of 35 items; an item is as salient as its best pixel."""
    foreground = np.abs(image - image[0, 0]).sum(axis=2) > 0.1
    count, item, _, centers = cv2.connectedComponentsWithStats(foreground.astype(np.uint8))
    assert count == 1 + 35
    odd = int(np.argmin(np.hypot(*(centers[1:] - (502, 144)).T)))
    enlarged = cv2.resize(saliency, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    height = [enlarged[item == i].max() for i in range(1, count)]
    return 1 + sum(other >= height[odd] for i, other in enumerate(height) if i != odd)
