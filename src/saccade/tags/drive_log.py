"""The landmark log of the tags that a robot saw on a drive."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from saccade.errors import DriveError, ImageError, LogError, require
from saccade.frames import Camera, Drive, Frame
from saccade.landmark_names import number_names
from saccade.plane import path_of, steps_between
from saccade.tags.config import TagConfig
from saccade.tags.detector import Tags, TagSightings
from saccade.types import FloatArray, IntArray, LandmarkLog, Trajectory

MAX_SAMPLES = 20
"""Maximum number of frames searched for tags of other families."""
OTHER_FAMILIES = (
    "tag36h11",
    "tag25h9",
    "tag36h10",
    "aruco_mip_36h12",
    *(f"{n}x{n}_250" for n in (5, 6, 7)),
)
"""Families searched where there is no tag; smaller ones are found where there are none."""
MIN_SIGHTINGS = 3
"""Minimum number of tags of another family for a hint."""


class TagLog(NamedTuple):
    """Tags observed during a drive."""

    log: LandmarkLog
    """Odometry and the tags as labeled observations."""
    frame: IntArray
    """(t + 1,) number of the frame of the first camera at each pose; -1 for other cameras."""
    xy: FloatArray
    """(k, 2) centers of the observed tags in image pixels."""
    axis: FloatArray
    """(k, 3) position of the camera in the robot's frame in meters, and heading of its optical axis
    in radians, at each observation."""
    remarks: tuple[str, ...] = ()
    """Frames that could not be used, one line each."""


def observe_tags(
    drive: Drive,
    config: TagConfig,
    progress: Callable[[int, int], None] | None = None,
    others: Sequence[Drive] = (),
) -> TagLog:
    """The landmark log of the tags that a robot saw on a drive.

    Args:
        drive: frames of a camera, and odometry.
        config: family and size of the tags.
        progress: called with the number of frames done and of all frames.
        others: drives of further cameras on the robot, each with its mounting; on the clock of
            `drive`, whose odometry applies to all.

    Raises:
        ConfigError: the size is unknown.
        DriveError: the drive has no odometry, or no frame with an image.
        LogError: no tag in any frame.
    """
    require(config.size is not None, "size", "the side of the tags in meters", None)
    if not drive.has_odometry:
        raise DriveError(
            f"{drive.name}: expected odometry between the frames, found none; write odometry.csv, "
            "or use saccade drive --tags, which measures the motion by its images"
        )
    detector, cameras = Tags(config), [drive, *others]
    frames = sorted(
        (float(time), camera, number)
        for camera, each in enumerate(cameras)
        for number, time in enumerate(each.time)
        if drive.time[0] <= time <= drive.time[-1]
    )
    time = np.unique([each[0] for each in frames])
    pose, labels, seen, remarks = list[int](), list[str](), list[TagSightings](), list[str]()
    axes = list[FloatArray]()
    frame_of = np.full(len(time), -1)
    for done, (at, camera, number) in enumerate(frames, start=1):
        row = int(np.searchsorted(time, at))
        if camera == 0:
            frame_of[row] = number
        try:
            found, mounted = _sightings(detector, cameras[camera], number)
        except ImageError as error:
            remarks.append(str(error))
            continue
        pose += [row] * len(found)
        labels += found.labels
        seen.append(found)
        x, y = mounted.rotation[:2, 2]
        axes += [np.array([*mounted.position[:2], np.arctan2(y, x)])] * len(found)
        if progress is not None:
            progress(done, len(frames))
    if not labels:
        raise LogError(_nothing_found(drive, config, len(frames)))
    control, covariance = _increments_at(drive, time)
    landmark, text_names = number_names(np.array(labels, object))
    log = LandmarkLog(
        name=drive.name,
        start=drive.start,
        time=time,
        motion="compose",
        control=control,
        control_covariance=covariance,
        observation_pose=np.array(pose, np.int64),
        observation=np.concatenate([_known(each.z) for each in seen]),
        observation_covariance=np.concatenate([_known(each.R) for each in seen]),
        landmark=landmark,
        odometry_bias=drive.odometry_bias,
        truth=drive.truth,
        text_names=text_names,
    )
    xy = np.concatenate([each.xy for each in seen])
    return TagLog(log, frame_of, xy, np.array(axes), tuple(remarks))


def _sightings(detector: Tags, drive: Drive, number: int) -> tuple[TagSightings, Camera]:
    """The tags in a frame, and the camera as it is turned."""
    frame: Frame = drive.load(number)
    if frame.image is None:
        raise ImageError(f"{drive.name}, frame {number}: expected an image, found none")
    camera = drive.camera.turned(frame.turn)
    return detector(frame.image, camera), camera


def _known(array: FloatArray | None) -> FloatArray:
    assert array is not None
    return array


def _increments_at(drive: Drive, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Controls (m - 1, 3) between times (m,), which include all frames; and their covariances.

    A step between two frames is divided in proportion to the time.
    """
    if len(time) == len(drive.time):
        return drive.control, drive.control_covariance
    path = Trajectory(drive.time, path_of(drive.control))
    control = steps_between(path.interpolate(time))
    step = np.searchsorted(drive.time, time[:-1], side="right") - 1
    fraction = np.diff(time) / np.diff(drive.time)[step]
    return control, fraction[:, None, None] * drive.control_covariance[step]


def _nothing_found(drive: Drive, config: TagConfig, frames: int) -> str:
    """Message for a drive without tags; names another family, if one is in view."""
    message = f"{drive.name}: expected tags of the family {config.family}, found none in {frames} "
    hint = "check the family, focus, light, and that a white border surrounds each tag"
    sample = np.unique(np.linspace(0, len(drive) - 1, MAX_SAMPLES).astype(int)).tolist()
    for family in OTHER_FAMILIES:
        detector, count = Tags(replace(config, family=family, size=None)), 0
        for number in sample:
            with suppress(ImageError):
                count += len(_sightings(detector, drive, number)[0])
        if family != config.family and count >= MIN_SIGHTINGS:
            hint = f"some are of the family {family}"
    return f"{message}frames; {hint}"
