"""What the frames show, one by one."""

import numpy as np

from saccade.diagnostics.findings import Finding, counted, numbers_of
from saccade.diagnostics.motion import LEAST
from saccade.diagnostics.survey import Survey
from saccade.frames import Camera, Drive

DARK = 8.0
"""Grey levels of 255 below which an image is black on average."""
FLAT = 4.0
"""Standard deviation of the grey levels below which an image shows nothing."""
BLURRED = 0.4
"""Times the usual sharpness, below which a frame is blurred."""
TOLD = 0.5
"""Share of the steps whose motion the images should tell."""
FEW = 20
"""Steps below which nothing is said of their share."""
MANY = 0.02
"""Share of the frames that may be blurred."""


def check_images(drive: Drive, survey: Survey) -> list[Finding]:
    """Frames that cannot be read, are black, blurred or copies of others."""
    black = (survey.brightness < DARK) | (survey.contrast < FLAT)
    sharp = survey.sharpness[np.isfinite(survey.sharpness) & ~black]
    usual = float(np.median(sharp)) if len(sharp) else 0.0
    blurred = (survey.sharpness < BLURRED * usual) & ~black
    empty = (survey.points < LEAST) & ~black & np.isfinite(survey.brightness)
    findings = []
    if survey.unreadable:
        frames = tuple(survey.unreadable)
        findings.append(
            Finding(
                "error",
                "unreadable frames",
                f"{counted(len(frames), 'frame', 'frames')} cannot be read; "
                f"{survey.unreadable[frames[0]]}",
                "Replace the files or the calibration, or leave the frames out",
                float(len(frames)),
                "frames",
                frames,
            )
        )
    if black.any():
        findings.append(
            Finding(
                "warning",
                "black frames",
                f"{counted(int(black.sum()), 'frame is', 'frames are')} black or all of one grey",
                "Look for a covered lens or a camera that fell out; odometry alone bridges them",
                float(black.sum()),
                "frames",
                numbers_of(survey.frame[black]),
            )
        )
    if blurred.sum() > MANY * len(survey):
        findings.append(
            Finding(
                "warning",
                "blurred frames",
                f"{counted(int(blurred.sum()), 'frame has', 'frames have')} less than "
                f"{BLURRED:g} of the usual sharpness",
                "Expose for a shorter time, or drive more slowly",
                float(blurred.sum()),
                "frames",
                numbers_of(survey.frame[blurred]),
            )
        )
    if empty.sum() > MANY * len(survey):
        findings.append(
            Finding(
                "warning",
                "empty frames",
                f"{counted(int(empty.sum()), 'frame has', 'frames have')} fewer than {LEAST} "
                "points to follow",
                "Nothing is observed there; odometry alone bridges them",
                float(empty.sum()),
                "frames",
                numbers_of(survey.frame[empty]),
            )
        )
    return [*findings, *_check_copies(drive, survey)]


def _check_copies(drive: Drive, survey: Survey) -> list[Finding]:
    """Frames that are exact copies of the one before, though the robot moves."""
    step = np.abs(drive.control[np.maximum(survey.frame - 1, 0)]).max(1)
    copied = survey.copied & ((step > 0) | (not drive.control.any()))
    if not copied.any():
        return []
    what = "points" if np.isnan(survey.brightness).all() else "image"
    return [
        Finding(
            "error",
            "repeated frames",
            f"{counted(int(copied.sum()), 'frame repeats', 'frames repeat')} the {what} of the "
            "frame before to the last bit",
            "A step is lost in each, and tracks may go on at other points: leave what is repeated "
            "out, begin its tracks anew, and let odometry bridge the step",
            float(copied.sum()),
            "frames",
            numbers_of(survey.frame[copied]),
        )
    ]


def check_motion(survey: Survey) -> list[Finding]:
    """Whether the images tell how the camera moved."""
    follows = np.diff(survey.frame) == 1
    if follows.sum() < FEW:
        return []
    known = float(np.isfinite(survey.rotation[1:, 0])[follows].mean())
    if known > TOLD:
        return []
    return [
        Finding(
            "warning",
            "motion",
            f"the images tell how the camera moved in only {100 * known:.0f} % of the steps: "
            "points are too few, or do not move as those of one world",
            "Look whether the frames are of one drive and in order, at their rate, at light and "
            "blur, and at the focal length",
            100 * known,
            "%",
        )
    ]


def check_camera(camera: Camera) -> list[Finding]:
    """Numbers of the calibration that hardly any camera has."""
    off = max(
        abs(camera.cx - (camera.width - 1) / 2) / camera.width,
        abs(camera.cy - (camera.height - 1) / 2) / camera.height,
    )
    view = 2 * np.rad2deg(np.arctan(camera.width / 2 / camera.fx))
    findings = []
    if off > 0.15:
        findings.append(
            Finding(
                "warning",
                "principal point",
                f"the centre of the calibration lies {100 * off:.0f} % of the image beside its "
                "middle",
                "Look whether the calibration is of images of another size or cut",
                100 * off,
                "%",
            )
        )
    if not 20 < view < 140:
        findings.append(
            Finding(
                "warning",
                "field of view",
                f"the focal length makes a field of view of {view:.0f} deg",
                "Look whether the calibration is of images of another size",
                float(view),
                "deg",
            )
        )
    if abs(camera.fx / camera.fy - 1) > 0.1:
        findings.append(
            Finding(
                "warning",
                "focal lengths",
                f"the focal lengths across and down differ: {camera.fx:.0f} and {camera.fy:.0f} px",
                "Look whether the images were resized in one direction",
                camera.fx / camera.fy,
                "ratio",
            )
        )
    return findings
