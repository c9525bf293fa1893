"""Drives from ROS 1 bags (.bag) and ROS 2 bags (a folder with metadata.yaml).

Topics are selected by their types, and among several by their names:

    sensor_msgs Image or CompressedImage    left: preferably with "left" in the name, without
                                            "depth" or "right"; right: with "right"; depth: with
                                            "depth" (16UC1 in mm, 32FC1 in m)
    sensor_msgs CameraInfo                  the one with the longest common namespace with the
                                            image's
    nav_msgs Odometry                       the one without "truth" or "gt" in its name
    Odometry, PoseStamped, TransformStamped with "truth", "gt", "vicon" or "mocap" in the name:
                                            ground truth of the robot
    tf2_msgs TFMessage                      pose of the camera on the robot, if they connect the
                                            frames of image and odometry; of one that pans and
                                            tilts, its turn at each image

A camera.toml in the folder of the bag takes precedence over CameraInfo and transforms. Times are
those of the messages' headers, from the first image on. Without odometry the motion is unknown (see
`unknown_increments`). Needs the extra `ros`.
"""

from dataclasses import replace
from pathlib import Path
from posixpath import commonpath

import numpy as np

from saccade.datasets.drives.calibration import CAMERA_FILE, Calibration, read_calibration
from saccade.datasets.drives.frames import (
    FrameTimes,
    ImageSource,
    SourceImage,
    associate,
    frame_loader,
)
from saccade.datasets.drives.mounting import Mounting, mounting_of
from saccade.datasets.drives.odometry import (
    OdometryIncrements,
    increments_from_poses,
    unknown_increments,
)
from saccade.datasets.drives.ros_images import calibration_of, pixels_of
from saccade.datasets.drives.sidecar_files import Truth, assemble_drive, robot_truth
from saccade.datasets.poses import project_to_plane
from saccade.datasets.ros_bags import (
    Bag,
    odometry_topic,
    read_poses,
    reading,
    truth_topic,
)
from saccade.datasets.ros_transforms import Transforms, bare
from saccade.errors import DriveError, ImageError
from saccade.frames import Drive
from saccade.types import FloatArray, IntArray

MAX_TIME_DIFFERENCE = 0.01
"""Seconds between the images of one frame."""
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")


def read_rosbag_drive(path: Path) -> Drive:
    """A drive from a bag."""
    with reading(str(path), DriveError):
        bag = Bag(path)
        left, right, depth = _image_topics(bag)
        stamps, seconds = bag.stamps(left)
        zero = float(seconds.min())
        frames = FrameTimes.sort(seconds - zero, f"{path}, {left}")
        calibration = _calibration(bag, left, right)
        time = seconds[frames.index]
        mounting = _mounting(bag, left, time)
        if mounting is not None:
            calibration = replace(calibration, camera=mounting.mount(calibration.camera))
        load = frame_loader(
            calibration,
            frames.time,
            left=_topic_images(bag, left, stamps[frames.index]),
            right=_associated_images(bag, right, time),
            depth=_associated_images(bag, depth, time, calibration.depth_unit),
        )
        if mounting is not None:
            load = mounting.turned(load)
        increments = _increments(bag, frames.time, zero)
        truth = _truth(bag, zero)
        drive = assemble_drive(path.stem, path.parent, calibration, frames, load, increments, truth)
        return replace(drive, assumptions=() if mounting is None else mounting.assumptions)


def _image_topics(bag: Bag) -> tuple[str, str | None, str | None]:
    """Topics of the left and right images and of the depth; None where there is none."""
    topics = bag.topics(IMAGES)
    depth = next((topic for topic in topics if "depth" in topic), None)
    right = next((topic for topic in topics if "right" in topic and "depth" not in topic), None)
    left = [topic for topic in topics if topic != right and "depth" not in topic]
    if not left:
        raise DriveError(f"{bag.path}: expected a topic of images, found {bag.all_topics()}")
    return min(left, key=lambda topic: "left" not in topic), right, depth


def _topic_images(bag: Bag, topic: str, stamps: IntArray, unit: float = 1.0) -> ImageSource:
    """Images of a topic recorded at `stamps` (n,) in nanoseconds, -1 where there is none.

    `unit` is that of integer depth images, in metres per step; others are in metres.
    """

    def read(i: int) -> SourceImage | None:
        if stamps[i] < 0:
            return None
        name = f"{bag.path}, {topic}, frame {i}"
        with reading(name, ImageError):
            pixels = pixels_of(bag.at(topic, int(stamps[i])), name)
        return SourceImage(pixels, name, 1.0 if pixels.dtype.kind == "f" else unit)

    return read


def _associated_images(
    bag: Bag, topic: str | None, time: FloatArray, unit: float = 1.0
) -> ImageSource | None:
    """The images of a topic nearest to times (n,) in seconds."""
    if topic is None:
        return None
    stamps, seconds = bag.stamps(topic)
    nearest = associate(time, seconds, MAX_TIME_DIFFERENCE)
    return _topic_images(bag, topic, np.where(nearest >= 0, stamps[nearest], -1), unit)


def _calibration(bag: Bag, left: str, right: str | None) -> Calibration:
    file = bag.path.parent / CAMERA_FILE
    if file.exists():
        return read_calibration(file)
    infos = bag.topics(("sensor_msgs/msg/CameraInfo",))
    if not infos:
        raise DriveError(f"{bag.path}: expected CameraInfo, or {file}, found {bag.all_topics()}")
    info, right_message = _closest(infos, left), None
    if right is not None and (right_info := _closest(infos, right)) != info:
        _, right_message = next(bag.messages(right_info))
    _, message = next(bag.messages(info))
    return calibration_of(message, right_message, f"{bag.path}, {info}")


def _mounting(bag: Bag, image: str, time: FloatArray) -> Mounting | None:
    """How the camera of a topic is mounted, by the transforms of the bag, if it has them."""
    odometry = odometry_topic(bag)
    if odometry is None or (bag.path.parent / CAMERA_FILE).exists():
        return None
    first = next(bag.messages(odometry))[1]
    part = next(bag.messages(image))[1].header.frame_id
    on_robot = Transforms.read(bag).without(bare(first.header.frame_id))
    poses = on_robot.poses(bare(first.child_frame_id), bare(part), time)
    return None if poses is None else mounting_of(poses, f"{bag.path}, {image}")


def _increments(bag: Bag, frame_time: FloatArray, zero: float) -> OdometryIncrements:
    topic = odometry_topic(bag)
    if topic is None:
        return unknown_increments(frame_time)
    poses = project_to_plane(read_poses(bag, topic, zero))
    return increments_from_poses(poses, frame_time, f"{bag.path}, {topic}")


def _truth(bag: Bag, zero: float) -> Truth:
    topic = truth_topic(bag)
    return Truth() if topic is None else robot_truth(read_poses(bag, topic, zero))


def _closest(topics: list[str], image: str) -> str:
    """The topic with the longest common namespace with an image topic."""
    return max(topics, key=lambda topic: len(commonpath([topic, image])))
