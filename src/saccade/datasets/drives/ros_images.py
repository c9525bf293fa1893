"""Images and calibration in messages of ROS."""

from typing import Any

import cv2
import numpy as np

from saccade.datasets.drives.calibration import Calibration, pinhole
from saccade.datasets.ros_bags import finite
from saccade.errors import ConfigError, DriveError, ImageError
from saccade.types import Image

_ENCODINGS: dict[str, tuple[type[np.generic], int, int | None]] = {
    "mono8": (np.uint8, 1, None),
    "8UC1": (np.uint8, 1, None),
    "rgb8": (np.uint8, 3, None),
    "bgr8": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "8UC3": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "rgba8": (np.uint8, 4, cv2.COLOR_RGBA2RGB),
    "bgra8": (np.uint8, 4, cv2.COLOR_BGRA2RGB),
    "mono16": (np.uint16, 1, None),
    "16UC1": (np.uint16, 1, None),
    "32FC1": (np.float32, 1, None),
    "bayer_rggb8": (np.uint8, 1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr8": (np.uint8, 1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": (np.uint8, 1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg8": (np.uint8, 1, cv2.COLOR_BayerGB2RGB),
}
"""Number type, channels, and OpenCV's conversion to RGB."""
DISTORTION_MODELS = ("plumb_bob", "rational_polynomial", "")


def pixels_of(message: Any, name: str) -> Image:
    """The image of an Image or a CompressedImage: gray or RGB, or depth as it is."""
    if hasattr(message, "format"):
        pixels = cv2.imdecode(np.asarray(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise ImageError(f"{name}: expected an image, found {message.format[:40]!r}")
        return pixels if pixels.ndim == 2 else cv2.cvtColor(pixels[..., :3], cv2.COLOR_BGR2RGB)
    encoding = message.encoding
    if encoding not in _ENCODINGS:
        raise ImageError(f"{name}: expected one of {', '.join(_ENCODINGS)}, found {encoding!r}")
    number, channels, conversion = _ENCODINGS[encoding]
    kind = np.dtype(number).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = message.height, message.width, message.step
    row = width * channels * kind.itemsize
    if step < row or len(message.data) < height * step:
        raise ImageError(f"{name}: expected {height} rows of {row} bytes, found fewer")
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(kind).astype(number)
    if channels > 1:
        pixels = pixels.reshape(height, width, channels)
    return pixels if conversion is None else cv2.cvtColor(pixels, conversion)


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


def _field(message: Any, name: str) -> Any:
    """A field whose name is a capital in ROS 1."""
    return getattr(message, name) if hasattr(message, name) else getattr(message, name.upper())
