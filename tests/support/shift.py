"""The homography between the two images of the made scene."""

import numpy as np

SHIFT = np.array([[1, 0, 10.0], [0, 1, 0], [0, 0, 1]])
