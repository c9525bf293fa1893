"""Drives from ROS 1 bags (.bag) and ROS 2 bags (.mcap, .db3, or their folder).

Topics are selected by type and, among several, by name:

    sensor_msgs Image or CompressedImage    left: preferably with "left" in the name, without
                                            "depth" or "right"; right: with "right"; depth: with
                                            "depth" (16UC1 in mm, 32FC1 in m)
    sensor_msgs CameraInfo                  longest common namespace with the image topic;
                                            projection P for rectified topics (image_rect),
                                            else K and D
    nav_msgs Odometry                       the topic that is not ground truth
    Odometry, PoseStamped, TransformStamped with "truth", "vicon", "mocap" or the word "gt" in it:
                                            ground truth of the robot
    tf2_msgs TFMessage                      pose of the camera on the robot, if the frames of
                                            image and odometry are connected; the turn at each
                                            image, if the camera pans and tilts

A camera.toml in the folder of the bag takes precedence over CameraInfo and transforms. Times are
those of the message headers. Without odometry the motion is unknown (see
`unknown_increments`). Needs the extra `ros`.
"""

from dataclasses import replace
from pathlib import Path
from posixpath import commonpath
from typing import Any

import numpy as np

from saccade.datasets.drives.calibration import (
    CAMERA_FILE,
    Calibration,
    read_calibration,
)
from saccade.datasets.drives.camera_files import CameraFile, camera_file
from saccade.datasets.drives.frames import (
    FrameTimes,
    ImageSource,
    SourceImage,
    associate,
    frame_reader,
)
from saccade.datasets.drives.odometry import (
    increments_from_poses,
    unknown_increments,
)
from saccade.datasets.drives.sidecar_files import (
    assemble_drive,
)
from saccade.datasets.ros.bags import (
    FIELDS,
    Bag,
    Transforms,
    bare,
    finite,
    has_word,
)
from saccade.errors import ConfigError, DriveError, ImageError
from saccade.frames import Camera, CameraTurn, Drive, Poses
from saccade.io.files import reading
from saccade.io.image import decode_stored
from saccade.types import FloatArray, Image, IntArray

MAX_FRAME_TIME_DIFFERENCE = 0.01
"""Maximum time difference between the images of a frame, in seconds."""
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_ENCODINGS: dict[str, tuple[type[np.generic], int, str | None]] = {
    "mono8": (np.uint8, 1, None),
    "8UC1": (np.uint8, 1, None),
    "rgb8": (np.uint8, 3, None),
    "bgr8": (np.uint8, 3, "BGR2RGB"),
    "8UC3": (np.uint8, 3, "BGR2RGB"),
    "rgba8": (np.uint8, 4, "RGBA2RGB"),
    "bgra8": (np.uint8, 4, "BGRA2RGB"),
    "mono16": (np.uint16, 1, None),
    "16UC1": (np.uint16, 1, None),
    "32FC1": (np.float32, 1, None),
    "bayer_rggb8": (np.uint8, 1, "BayerBG2RGB"),
    "bayer_bggr8": (np.uint8, 1, "BayerRG2RGB"),
    "bayer_gbrg8": (np.uint8, 1, "BayerGR2RGB"),
    "bayer_grbg8": (np.uint8, 1, "BayerGB2RGB"),
}
"""Number type, channels, and the name of OpenCV's conversion to RGB."""
RECTIFIED = "rect(ified)?|undist(ort(ed)?)?"
"""Pattern of words in the names of topics with rectified images."""
MAX_FIXED_ROTATION = 1e-4
"""Maximum rotation of a fixed camera, in radians."""
MAX_ROLL = 0.02
"""Maximum roll about the optical axis of a pan-tilt camera, in radians."""
MAX_SHIFT = 0.01
"""Maximum motion of the optical center on the robot without a remark, in meters."""


def read_rosbag_drive(path: Path) -> Drive:
    """A drive from a bag."""
    with reading(str(path), DriveError, *FIELDS):
        bag = Bag(path)
        left, right, depth = _image_topics(bag)
        stamps, seconds = bag.stamps(left)
        frames = FrameTimes.sort(seconds, f"{path}, {left}")
        calibration, turns, assumptions = _mounted_calibration(bag, left, right, seconds)
        read = frame_reader(
            calibration,
            frames.recorded,
            left=_topic_images(bag, left, stamps),
            right=_associated_images(bag, right, seconds),
            depth=_associated_images(bag, depth, seconds),
        )

        truth, odometry = bag.truth_topic(), bag.odometry_topic()
        increments = unknown_increments(frames.time)
        if odometry is not None:
            poses = bag.poses(odometry).on_plane
            increments = increments_from_poses(poses, frames.time, f"{path}, {odometry}")
        return assemble_drive(
            path.stem,
            path.parent,
            calibration,
            frames,
            read,
            increments,
            None if truth is None else bag.poses(truth).on_plane,
            turns,
            assumptions,
        )


def _image_topics(bag: Bag) -> tuple[str, str | None, str | None]:
    """Topics of the left, right and depth images; None if absent."""
    topics = bag.topics(IMAGES)
    depth = next((topic for topic in topics if has_word(topic, "depth.*")), None)
    images = [topic for topic in topics if not has_word(topic, "depth.*")]
    if any(has_word(topic, "right.*") for topic in images):  # prefer rectified images for stereo
        images.sort(key=lambda topic: not has_word(topic, RECTIFIED))
    right = next((topic for topic in images if has_word(topic, "right.*")), None)
    left = [topic for topic in images if not has_word(topic, "right.*")]
    if not left:
        raise DriveError(f"{bag.path}: expected a topic of images, found {bag.all_topics()}")
    return min(left, key=lambda topic: not has_word(topic, "left.*")), right, depth


def _topic_images(bag: Bag, topic: str, stamps: IntArray) -> ImageSource:
    """Images of a topic recorded at `stamps` (n,) in nanoseconds; -1 for no image."""

    def read(i: int) -> SourceImage | None:
        if stamps[i] < 0:
            return None
        name = f"{bag.path}, {topic}, frame {i}"
        with reading(name, ImageError, *FIELDS):
            return SourceImage(pixels_of(bag.at(topic, int(stamps[i])), name), name)

    return read


def _associated_images(bag: Bag, topic: str | None, time: FloatArray) -> ImageSource | None:
    """The images of a topic nearest to times (n,) in seconds."""
    if topic is None:
        return None
    stamps, seconds = bag.stamps(topic)
    nearest = associate(time, seconds, MAX_FRAME_TIME_DIFFERENCE)
    return _topic_images(bag, topic, np.where(nearest >= 0, stamps[nearest], -1))


def _mounted_calibration(
    bag: Bag, left: str, right: str | None, time: FloatArray
) -> tuple[Calibration, list[CameraTurn], tuple[str, ...]]:
    """Calibration with the pose on the robot, if it is known; turns and assumptions."""
    file = bag.path.parent / CAMERA_FILE
    if file.exists():
        return read_calibration(file), [], ()
    infos = bag.topics(("sensor_msgs/msg/CameraInfo",))
    if not infos:
        raise DriveError(f"{bag.path}: expected CameraInfo, or {file}, found {bag.all_topics()}")
    info, right_info = (_closest(infos, topic) for topic in (left, right or left))
    other = None if right_info == info else bag.first(right_info)
    is_rectified = all(has_word(topic, RECTIFIED) for topic in (left, right or left))
    calibration = calibration_of(bag.first(info), other, f"{bag.path}, {info}", is_rectified)
    odometry = bag.odometry_topic()
    if odometry is None:
        return calibration, [], ()
    first, part = bag.first(odometry), bag.first(left).header.frame_id
    on_robot = Transforms.read(bag).without(bare(first.header.frame_id))
    robot = bare(first.child_frame_id)
    poses = on_robot.poses(robot, bare(part), time)
    if poses is None:
        assumption = (
            f"{bag.path}: no transform from {robot or 'the robot'} to {bare(part) or left}: the "
            f"camera is assumed at the robot's origin, looking ahead; {CAMERA_FILE} beside the bag "
            "gives position and rotation"
        )
        return calibration, [], (assumption,)
    camera, turns, assumptions = mounted(calibration.camera, poses, f"{bag.path}, {left}")
    return replace(calibration, camera=camera), turns, assumptions


def _closest(topics: list[str], image: str) -> str:
    """The topic with the longest common namespace with an image topic."""
    return max(topics, key=lambda topic: len(commonpath([topic, image])))


def mounted(
    camera: Camera, poses: Poses, name: str
) -> tuple[Camera, list[CameraTurn], tuple[str, ...]]:
    """Mounting of a camera on the robot, its turns, and assumptions.

    Pan and tilt are the azimuth and elevation of the optical axis; at zero the camera faces ahead.

    Args:
        camera: camera with any extrinsics.
        poses: poses of the camera in the robot frame, at each frame of the drive.
        name: name of the recording, for messages.

    Returns:
        The camera; a turn for each frame, or none for a fixed camera; and a remark if the optical
        center moves.
    """
    R = poses.rotation
    if _angle(R, R[0]) < MAX_FIXED_ROTATION:
        return replace(camera, position=poses.position[0].copy(), rotation=R[0].copy()), [], ()
    x, y, z = R[:, :, 2].T  # optical axis
    directions = zip(np.arctan2(y, x).tolist(), np.arcsin(z.clip(-1, 1)).tolist(), strict=True)
    turns = [CameraTurn(pan, tilt) for pan, tilt in directions]
    rotation = np.stack([turn.rotation for turn in turns]).transpose(0, 2, 1) @ R
    roll = _angle(rotation, rotation[0])
    if roll > MAX_ROLL:
        raise DriveError(
            f"{name}: expected a camera that pans and tilts, found one that also rolls about its "
            f"optical axis, by {roll:.2g} rad"
        )
    center = poses.position.mean(0)
    shift = float(np.linalg.norm(poses.position - center, axis=1).max())
    assumption = (
        f"{name}: the optical center moves by up to {shift:.2f} m on the robot while the camera "
        "turns; its mean position is used"
    )
    camera = replace(camera, position=center, rotation=rotation[0])
    return camera, turns, (assumption,) if shift > MAX_SHIFT else ()


def _angle(rotations: FloatArray, other: FloatArray) -> float:
    """Maximum angle in radians between rotations (n, 3, 3) and a rotation (3, 3)."""
    chord = np.linalg.norm(rotations - other, axis=(1, 2)).max() / np.sqrt(8)
    return float(2 * np.arcsin(min(chord, 1.0)))


def pixels_of(message: Any, name: str) -> Image:
    """The image of an Image or CompressedImage: gray, RGB, or unscaled depth."""
    if hasattr(message, "format"):
        return decode_stored(bytes(message.data), name)
    if message.encoding not in _ENCODINGS:
        known = ", ".join(_ENCODINGS)
        raise ImageError(f"{name}: expected one of {known}, found {message.encoding!r}")
    number, channels, conversion = _ENCODINGS[message.encoding]
    kind = np.dtype(number).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = message.height, message.width, message.step
    row = width * channels * kind.itemsize
    if step < row or len(message.data) < height * step:
        raise ImageError(f"{name}: expected {height} rows of {row} bytes, found fewer")
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(kind).astype(number)
    if channels > 1:
        pixels = pixels.reshape(height, width, channels)
    if conversion is None:
        return pixels
    import cv2  # slow to import

    return cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{conversion}"))


def calibration_of(
    left: Any, right: Any | None, name: str, is_rectified: bool = False
) -> Calibration:
    """Calibration from the CameraInfo of one camera, or of a rectified stereo pair.

    Args:
        left: CameraInfo with K and D for raw images, and P for rectified images.
        right: CameraInfo of the right camera, whose P has the baseline.
        name: name of the recording, for error messages.
        is_rectified: whether the images are rectified.
    """
    own = _camera_file(left, name, is_rectified)
    camera = own.rectified if is_rectified and own.rectified else own.camera
    if right is not None:
        if camera.is_distorted:
            raise DriveError(
                f"{name}: expected rectified images of a stereo pair, found distortion "
                f"{list(camera.distortion)}"
            )
        camera = own.rectified or camera
        try:
            camera = replace(camera, baseline=_camera_file(right, name, True).offset)
        except ConfigError as error:
            raise DriveError(f"{name}: {error}") from error
    return Calibration(camera)


def _camera_file(info: Any, name: str, is_rectified: bool) -> CameraFile:
    """The camera of a CameraInfo; the lens does not matter for rectified images."""
    K, D, P = (finite(_field(info, each), name) for each in "kdp")
    is_ideal = is_rectified and P.any()
    lens = ("", ()) if is_ideal else (str(info.distortion_model), D.tolist())
    return camera_file(name, K.reshape(3, 3), (info.width, info.height), lens, P.reshape(3, 4))


def _field(message: Any, name: str) -> Any:
    """A field whose name is capitalized in ROS 1."""
    return getattr(message, name) if hasattr(message, name) else getattr(message, name.upper())
