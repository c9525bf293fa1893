"""What odometry is off by in the same way all the time, as part of the robot's state.

Wheels that are smaller than they are said to be, one that is larger than the other, and the way
that is lost while turning: no noise that is new with every step accounts for them, and
the observations of landmarks tell them after some tens of metres.
"""

import numpy as np

from saccade.types import FloatArray

BIASES = 3
"""Behind the pose: the share of the way that is driven beyond the odometry's; the turn in radians
for each metre of it; and the metres lost of it for each radian turned."""


def control_slopes(control: FloatArray) -> FloatArray:
    """How much of each bias is in each control: a control u is really u + slope bias.

    Args:
        control: (t, 2) distance and turn, or (t, 3) forward, left and turn.

    Returns:
        (t, c, 3).
    """
    ahead, turn = control[:, 0], control[:, -1]
    slope = np.zeros((*control.shape, BIASES))
    slope[:, :-1, 0] = control[:, :-1]
    slope[:, -1, 1] = ahead
    slope[:, 0, 2] = -np.sign(ahead) * np.abs(turn)
    return slope


def unbiased(control: FloatArray, bias: FloatArray) -> FloatArray:
    """Controls (t, c) as they really were, given the biases (3,)."""
    return np.asarray(control + control_slopes(control) @ bias)
