"""Images of a drive: exposure, blur, copies, calibration, and whether they show the motion."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.camera_motion import MIN_POINTS
from saccade.diagnostics.findings import Finding, counted
from saccade.diagnostics.survey import Survey
from saccade.frames import Drive

MIN_BRIGHTNESS = 8.0
"""Mean gray level of 255 below which an image is black."""
MIN_CONTRAST = 4.0
"""Standard deviation of the gray levels below which an image is blank."""
MIN_SHARPNESS = 0.4
"""Times the median sharpness, below which a frame is blurred."""
MAX_BAD_FRACTION = 0.02
"""Fraction of the frames that may be blurred or empty."""
MIN_KNOWN_FRACTION = 0.5
"""Fraction of the steps whose motion the images should show."""
MIN_KNOWN_STEPS = 20
"""Steps from which something is said of that fraction."""


def check_images(drive: Drive, survey: Survey) -> Iterator[Finding]:
    """Frames that are unreadable, black, blurred, without texture, or copies of others."""
    black = (survey.brightness < MIN_BRIGHTNESS) | (survey.contrast < MIN_CONTRAST)
    sharpness = survey.sharpness[np.isfinite(survey.sharpness) & ~black]
    median = float(np.median(sharpness)) if len(sharpness) else 0.0
    blurred = (survey.sharpness < MIN_SHARPNESS * median) & ~black
    empty = (survey.points < MIN_POINTS) & ~black & np.isfinite(survey.brightness)
    if unreadable := survey.unreadable:
        yield Finding.in_frames(
            "error",
            "unreadable frames",
            f"{counted(len(unreadable), 'frame', 'frames')} cannot be read; "
            f"{next(iter(unreadable.values()))}",
            "Replace the files or the calibration, or leave the frames out",
            list(unreadable),
        )
    if black.any():
        yield Finding.in_frames(
            "warning",
            "black frames",
            f"{counted(int(black.sum()), 'frame is', 'frames are')} black or all of one grey",
            "Look for a covered lens or a camera that dropped out; odometry alone bridges them",
            survey.frame[black],
        )
    if blurred.sum() > MAX_BAD_FRACTION * len(survey):
        yield Finding.in_frames(
            "warning",
            "blurred frames",
            f"{counted(int(blurred.sum()), 'frame has', 'frames have')} less than "
            f"{MIN_SHARPNESS:g} of the median sharpness",
            "Expose for a shorter time, or drive more slowly",
            survey.frame[blurred],
        )
    if empty.sum() > MAX_BAD_FRACTION * len(survey):
        yield Finding.in_frames(
            "warning",
            "empty frames",
            f"{counted(int(empty.sum()), 'frame has', 'frames have')} fewer than {MIN_POINTS} "
            "points to track",
            "Nothing is observed there; odometry alone bridges them",
            survey.frame[empty],
        )
    step = np.abs(drive.control[np.maximum(survey.frame - 1, 0)]).max(1)
    copied = survey.copied & ((step > 0) | (not drive.control.any()))
    if copied.any():
        what = "points" if np.isnan(survey.brightness).all() else "image"
        yield Finding.in_frames(
            "error",
            "repeated frames",
            f"{counted(int(copied.sum()), 'frame repeats', 'frames repeat')} the {what} of the "
            "frame before to the last bit",
            "A step is lost in each, and tracks may go on at other points: leave the copies out, "
            "begin their tracks anew, and let odometry bridge the step",
            survey.frame[copied],
        )


def check_egomotion(survey: Survey) -> Iterator[Finding]:
    """Whether the images show how the camera moved."""
    successive = np.diff(survey.frame) == 1
    if successive.sum() < MIN_KNOWN_STEPS:
        return
    known = float(np.isfinite(survey.rotation[1:, 0])[successive].mean())
    if known <= MIN_KNOWN_FRACTION:
        yield Finding(
            "warning",
            "motion",
            f"the images show the camera's motion in only {100 * known:.0f} % of the steps: "
            "there are too few points, or they do not move as a rigid scene does",
            "Check that the frames are of one drive and in order, their rate, exposure and blur, "
            "and the focal length",
            100 * known,
            "%",
        )
