"""Compiles the kernels for images and for two views into the cache, as a process of its own."""

import numpy as np

import saccade
from saccade.keypoints import verify

rng = np.random.default_rng(0)
image = rng.random((64, 64))
saccade.Sift(saccade.SiftConfig(max_keypoints=20, spread=True))(image)
points = rng.uniform((-1, -1, 3), (1, 1, 5), (60, 3))
views = points, np.add(points, (0.3, 0.0, 0.1))
first, second = (saccade.Keypoints.at(300 + 300 * xyz[:, :2] / xyz[:, 2:], 1.0) for xyz in views)
verify(first, second, np.arange(len(points))[:, None].repeat(2, 1))
saccade.most_probable_scanpath(saccade.attention_saliency(image), fixations=3)
