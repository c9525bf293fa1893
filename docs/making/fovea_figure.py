"""What the fovea of a robot sees on its way, and why it looks there."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from saccade import visual
from saccade.evaluation.gaze_drives import SETTINGS, WIDE_DRIVE
from saccade.simulation import simulate_drive
from saccade.viewing.fovea import foveated_image
from saccade.viewing.style import ORANGE, figure_for, picture_axes
from saccade.visual.fovea import Fovea
from saccade.visual.gaze_policies import POLICIES

FRAMES, SHOWN = 90, (30, 58, 86)
"""Of the drive; and those that are shown."""


def fovea() -> Figure:
    """Three frames of the wide ring as the fovea of `informative` sees them."""
    config = replace(WIDE_DRIVE, frames=FRAMES, frames_per_lap=100, color=True)
    eye = Fovea(simulate_drive(config, 3))
    visual.run(eye.drive, SETTINGS, gaze=eye.control(POLICIES["informative"](3)))
    height, width = config.image_size[::-1]
    figure = figure_for(width, height, columns=1, rows=len(SHOWN), panel=9)
    for axes, number in zip(figure.subplots(len(SHOWN)), SHOWN, strict=True):
        frame = eye.drive.load(number)
        axes.imshow(foveated_image(frame), cmap="gray", vmin=0, vmax=255)
        assert frame.periphery is not None
        corner = np.array(frame.periphery.corner) - 0.5
        axes.add_patch(Rectangle(corner, *eye.window, fill=False, color=ORANGE, linewidth=1.6))
        picture_axes(axes, f"frame {number}: {frame.gaze.reason}")
    return figure
