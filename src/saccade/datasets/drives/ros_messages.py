"""Contents of ROS messages: images, calibrations, poses, static transforms."""

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np

from saccade.datasets.drives.calibration import Calibration, pinhole
from saccade.datasets.drives.sidecar_files import rotation_matrices
from saccade.datasets.tables import LARGEST
from saccade.errors import ConfigError, DriveError, ImageError
from saccade.types import FloatArray, Image

_LAYOUTS = {
    "mono8": (np.uint8, 1),
    "8UC1": (np.uint8, 1),
    "rgb8": (np.uint8, 3),
    "bgr8": (np.uint8, 3),
    "8UC3": (np.uint8, 3),
    "rgba8": (np.uint8, 4),
    "bgra8": (np.uint8, 4),
    "mono16": (np.uint16, 1),
    "16UC1": (np.uint16, 1),
    "32FC1": (np.float32, 1),
}
"""Number type and channels by encoding; 8UC3 is in OpenCV's order."""
_BGR = ("bgr8", "bgra8", "8UC3")
_BAYER = {
    "bayer_rggb8": cv2.COLOR_BayerBG2RGB,
    "bayer_bggr8": cv2.COLOR_BayerRG2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGR2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGB2RGB,
}
DISTORTION_MODELS = ("plumb_bob", "rational_polynomial", "")


def seconds_of(message: Any) -> float:
    """The time in the header of a message."""
    stamp = message.header.stamp
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def pixels_of(message: Any, name: str) -> Image:
    """The image of an Image or a CompressedImage: gray or RGB, or depth as it is."""
    if hasattr(message, "format"):
        pixels = cv2.imdecode(np.asarray(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise ImageError(f"{name}: expected an image, found {message.format[:40]!r}")
        return pixels if pixels.ndim == 2 else cv2.cvtColor(pixels[..., :3], cv2.COLOR_BGR2RGB)
    encoding = message.encoding
    if encoding not in _LAYOUTS and encoding not in _BAYER:
        known = ", ".join((*_LAYOUTS, *_BAYER))
        raise ImageError(f"{name}: expected one of {known}, found {encoding!r}")
    number, channels = _LAYOUTS.get(encoding, (np.uint8, 1))
    kind = np.dtype(number).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = message.height, message.width, message.step
    row = width * channels * kind.itemsize
    if step < row or len(message.data) < height * step:
        raise ImageError(f"{name}: expected {height} rows of {row} bytes, found fewer")
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(kind).astype(number)
    if encoding in _BAYER:
        return cv2.cvtColor(pixels, _BAYER[encoding])
    if channels == 1:
        return pixels
    pixels = pixels.reshape(height, width, channels)[..., :3]
    return np.ascontiguousarray(pixels[..., ::-1] if encoding in _BGR else pixels)


def calibration_of(left: Any, right: Any | None, name: str) -> Calibration:
    """Calibration from the CameraInfo of one camera, or of a rectified stereo pair.

    The projection of the right camera has the baseline; `name` is for the error message.
    """
    K, D, P = (finite(_field(left, each), name) for each in "kdp")
    P = P.reshape(3, 4)
    if left.distortion_model not in DISTORTION_MODELS or len(D) not in (0, 4, 5):
        raise DriveError(
            f"{name}: expected plumb_bob with up to five coefficients, "
            f"found {left.distortion_model!r} with {len(D)}"
        )
    baseline = 0.0
    if right is not None:
        P2 = finite(_field(right, "p"), name).reshape(3, 4)
        baseline = -float(P2[0, 3] / P2[0, 0]) if P2[0, 0] else 0.0
        if np.any(D):
            raise DriveError(
                f"{name}: expected rectified images of a stereo pair, found distortion {D.tolist()}"
            )
        K = P[:, :3]
    try:
        camera = pinhole(K.reshape(3, 3), (left.width, left.height), baseline=baseline)
    except ConfigError as error:
        raise DriveError(f"{name}: {error}") from error
    return Calibration(camera, tuple(D.tolist()) if np.any(D) else ())


def finite(values: Any, name: str) -> FloatArray:
    """Numbers of a message as float64."""
    numbers = np.asarray(values, np.float64)
    if not (np.abs(numbers) < LARGEST).all():
        raise DriveError(f"{name}: expected finite numbers under {LARGEST:g}, found others")
    return numbers


def pose_of(message: Any) -> tuple[float, ...]:
    """Position and quaternion x, y, z, w of an Odometry, a PoseStamped or a TransformStamped."""
    if hasattr(message, "transform"):
        position, rotation = message.transform.translation, message.transform.rotation
    else:
        pose = message.pose
        pose = pose.pose if hasattr(pose, "pose") else pose
        position, rotation = pose.position, pose.orientation
    return (
        *(position.x, position.y, position.z),
        *(rotation.x, rotation.y, rotation.z, rotation.w),
    )


def _field(message: Any, name: str) -> Any:
    """A field whose name is a capital in ROS 1."""
    return getattr(message, name) if hasattr(message, name) else getattr(message, name.upper())


def extrinsics(messages: Iterable[Any], base: str, part: str, name: str) -> FloatArray | None:
    """Pose (4, 4) of the frame `part` in the frame `base`, such as base_link, by static TFMessages.

    None where no chain of transforms connects them. `name` is for the error message.
    """
    edges: dict[str, list[tuple[str, FloatArray]]] = {}
    for message in messages:
        for transform in message.transforms:
            frames = (transform.header.frame_id, transform.child_frame_id)
            parent, child = (frame.lstrip("/") for frame in frames)  # tf had a leading slash
            pose = _matrix(transform, name)
            inverse = np.asarray(np.linalg.inv(pose), np.float64)
            edges.setdefault(parent, []).append((child, pose))
            edges.setdefault(child, []).append((parent, inverse))
    poses = {base.lstrip("/"): np.eye(4)}
    stack = list(poses)
    while stack:
        parent = stack.pop()
        for child, pose in edges.get(parent, []):
            if child not in poses:
                poses[child] = poses[parent] @ pose
                stack.append(child)
    return poses.get(part.lstrip("/"))


def _matrix(transform: Any, name: str) -> FloatArray:
    values = finite([pose_of(transform)], name)
    pose = np.eye(4)
    pose[:3, :3] = rotation_matrices(values[:, 3:], name)[0]
    pose[:3, 3] = values[0, :3]
    return pose
