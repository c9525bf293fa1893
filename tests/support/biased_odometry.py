"""Controls without systematic errors of the odometry, as `LandmarkLog.odometry_bias` has them."""

import numpy as np


def unbiased(control, bias):
    """(t, c) true controls: a fraction of the distance, radians a meter, and meters a radian."""
    true = np.array(control, float)
    true[:, :-1] += bias[0] * control[:, :-1]
    true[:, -1] += bias[1] * control[:, 0]
    true[:, 0] -= bias[2] * np.sign(control[:, 0]) * np.abs(control[:, -1])
    return true
