"""Where the controls of a drive or log alone lead."""

import numpy as np

from saccade.slam.filter.robot_models import compose


def followed(start, controls):
    """The poses (t, 3): `start`, and the one after each control."""
    poses = [start]
    for control in controls:
        poses.append(compose(poses[-1], control)[0])
    return np.array(poses)
