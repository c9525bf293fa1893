"""Odometry by a second, fixed camera, for a robot whose other camera looks around."""

from dataclasses import replace

import numpy as np

from saccade.frames import Drive
from saccade.visual.config import VisualConfig
from saccade.visual.motion_prior import TOTAL_RELATIVE_SIGMA
from saccade.visual.pipeline import Pipeline


def measure_odometry(drive: Drive, second: Drive, config: VisualConfig | None = None) -> Drive:
    """A drive whose odometry is measured by a second camera, with the odometry of that camera's.

    Args:
        drive: of the camera that turns.
        second: the same drive by the second camera, with frames at the same times.
        config: settings of the egomotion of the second camera; it maps no landmarks.

    Returns:
        The drive, to be mapped with `VisualConfig(egomotion="second-camera")`.
    """
    settings = replace(
        config or VisualConfig(),
        egomotion="camera",
        new_per_frame=0,
        relative_motion_sigma=TOTAL_RELATIVE_SIGMA,
    )
    steps = []
    with Pipeline(second, settings) as pipeline:
        for number in range(len(second)):
            pipeline.step(number)
            steps.append(pipeline.control)
    control, covariance = (np.array(each) for each in zip(*steps[1:], strict=True))
    unbiased = (0.0, 0.0, 0.0)  # the covariances include calibration errors
    return replace(drive, control=control, control_covariance=covariance, odometry_bias=unbiased)
