"""Synthetic gray-level images with known structure, for the tests of appendix B."""

import numpy as np


def blob(side, x, y, wide, high=None, background=0.0, amplitude=1.0):
    """A Gaussian of two standard deviations, along x and along y."""
    row, column = np.mgrid[:side, :side]
    high = wide if high is None else high
    return background + amplitude * np.exp(
        -((column - x) ** 2) / (2 * wide**2) - (row - y) ** 2 / (2 * high**2)
    )


def scene(side=65, seed=0):
    """Blobs of several sizes, none of them round, on gray."""
    rng = np.random.default_rng(seed)
    image = np.full((side, side), 0.5)
    for _ in range(14):
        x, y = rng.uniform(8, side - 8, 2)
        wide, high = rng.uniform(1.5, 4), rng.uniform(1.5, 4)
        image += blob(side, x, y, wide, high, amplitude=rng.choice([-0.5, 0.5]))
    image += 0.02 * rng.normal(size=image.shape)
    return np.clip(image, 0, 1)
