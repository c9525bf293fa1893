"""The detector of tags: labels, corners, and ranges and bearings of their centers.

The center follows from the corners by the perspective of a square of known size. At weak
perspective two tilts of a square look alike; both have the same center, so the ambiguity affects
neither range nor bearing.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.frames import Camera
from saccade.io.image import as_gray
from saccade.plane import to_range_bearing
from saccade.tags.config import TagConfig
from saccade.tags.corners import cross, refined_corners
from saccade.tags.markers import dictionary_of
from saccade.types import BoolArray, FloatArray, Image, IntArray

MAX_ENLARGED = 160_000
"""Largest image in pixels that is enlarged for detection."""
ByteArray: TypeAlias = npt.NDArray[np.uint8]
TILT_SIGMA = 1.0
"""Standard deviation of the orientation of a tag before it is observed, in radians."""
TAG_POSE_STEPS = 3
"""Number of Gauss-Newton steps from the closed-form pose of a tag."""
MIN_TAG_DISTANCE = 1e-3
"""Minimum distance of a tag from the robot's origin in meters."""
SIDE = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])
"""(4, 3) corners of a tag of unit size, in the order of OpenCV."""


@dataclass(frozen=True, eq=False, repr=False)
class TagSightings:
    """The k tags in an image."""

    id: IntArray
    """(k,) ids in the family."""
    family: str
    """Name of the family."""
    corners: FloatArray
    """(k, 4, 2) corners of the black square in image pixels, in the order of OpenCV: clockwise."""
    corner_sigma: FloatArray
    """(k,) standard deviations of the corners in pixels."""
    z: FloatArray | None = None
    """(k, 2) range over the ground in meters and bearing in radians, to the left of ahead, from
    the robot's origin to the center; None without a camera or a size."""
    R: FloatArray | None = None
    """(k, 2, 2) covariances of `z`."""
    height: FloatArray | None = None
    """(k,) heights of the centers above the robot's origin, in meters."""

    @property
    def labels(self) -> list[str]:
        """(k,) labels `FAMILY:ID`."""
        return [f"{self.family}:{each}" for each in self.id.tolist()]

    @property
    def xy(self) -> FloatArray:
        """(k, 2) centers in image pixels: the intersections of the diagonals."""
        a, b, c, d = (self.corners[:, i] for i in range(4))
        along = cross(b - a, d - b) / cross(c - a, d - b)
        return np.asarray(a + along[:, None] * (c - a))

    def __len__(self) -> int:
        return len(self.id)

    def __repr__(self) -> str:
        return f"TagSightings({', '.join(self.labels) or 'no tags'})"


class Tags:
    """Detects the tags of a family: `Tags(config)(image, camera)`.

    Args:
        config: family, size and errors.

    Source: Garrido-Jurado et al. (2014) for detection; Collins & Bartoli (2014) for the pose of a
    square.
    """

    def __init__(self, config: TagConfig | None = None) -> None:
        import cv2  # slow to import

        self.config = config = config or TagConfig()
        dictionary = dictionary_of(config.family)
        self._detector = cv2.aruco.ArucoDetector(dictionary)
        self._cells = dictionary.markerSize + 2

    def __repr__(self) -> str:
        return f"Tags({self.config})"

    def __call__(self, image: Image, camera: Camera | None = None) -> TagSightings:
        """The tags in an image.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].
            camera: calibration and mounting of the camera that took the image; None for corners
                alone.

        Returns:
            The tags in ascending order of their ids. With a camera and a size, tags of unknown
            size are left out.

        Raises:
            ImageError: not an image, or of another size than the camera's.
        """
        gray = gray_bytes(image)
        if camera is not None and gray.shape != (camera.height, camera.width):
            raise ImageError(
                f"image: expected {camera.width} x {camera.height} px as in the calibration, "
                f"found {gray.shape[1]} x {gray.shape[0]}"
            )
        found, ids, scale = *self._detector.detectMarkers(_enlarged(gray))[:2], 1 + _is_small(gray)
        if ids is None or len(found) == 0:
            none = np.zeros((0, 4, 2))
            seen = TagSightings(np.zeros(0, np.int64), self.config.family, none, np.zeros(0))
        else:
            corners = (np.array(found, np.float64).reshape(-1, 4, 2) + 0.5) / scale - 0.5
            order = np.argsort(np.asarray(ids).ravel(), kind="stable")
            corners, sigma = refined_corners(gray, corners[order], self._cells, camera)
            id_ = np.asarray(ids, np.int64).ravel()[order]
            seen = TagSightings(id_, self.config.family, corners, sigma)
        return seen if camera is None or self.config.size is None else self._located(seen, camera)

    def _located(self, seen: TagSightings, camera: Camera) -> TagSightings:
        """The tags of known size, with ranges and bearings."""
        sizes = [self.config.size_of(each) for each in seen.id.tolist()]
        rows, points, covariances = [], [], []
        corners = camera.undistort(seen.corners.reshape(-1, 2)).reshape(-1, 4, 2)
        for row, size in enumerate(sizes):
            if size is None or not np.isfinite(corners[row]).all():
                continue
            located = locate_center(corners[row], float(seen.corner_sigma[row]), size, camera)
            if located is not None:
                rows.append(row)
                points.append(located[0])
                covariances.append(located[1])
        index = np.array(rows, np.int64)
        center, C = np.reshape(points, (-1, 3)), np.reshape(covariances, (-1, 3, 3))
        z, R, height, ahead = self._in_plane(center, C, camera)
        kept = index[ahead]
        return TagSightings(
            seen.id[kept],
            seen.family,
            seen.corners[kept],
            seen.corner_sigma[kept],
            z[ahead],
            R[ahead],
            height[ahead],
        )

    def _in_plane(
        self, center: FloatArray, C: FloatArray, camera: Camera
    ) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Ranges and bearings (k, 2), covariances (k, 2, 2) and heights (k,) of centers (k, 3).

        Centers and their covariances by the corners are in the camera's frame. Also (k,) whether a
        center is away from the robot's origin.
        """
        config = self.config
        along_axis = center * (0.0, 0.0, 1.0)
        C = C + config.size_sigma**2 * center[:, :, None] * center[:, None]
        C = C + config.focal_sigma**2 * along_axis[:, :, None] * along_axis[:, None]
        Rc = camera.rotation[:2]
        xy = camera.position[:2] + center @ Rc.T
        above = center @ camera.rotation[2]
        tilt = np.square(np.radians(config.tilt_sigma_deg) * above)
        covariance = Rc @ C @ Rc.T + tilt[:, None, None] * np.eye(2)
        away = np.hypot(xy[:, 0], xy[:, 1]) > MIN_TAG_DISTANCE
        xy = np.where(away[:, None], xy, (1.0, 0.0))
        z, R = to_range_bearing(xy, covariance, str)
        return z, R, above + camera.position[2], away


def _is_small(gray: ByteArray) -> bool:
    return gray.size <= MAX_ENLARGED


def _enlarged(gray: ByteArray) -> ByteArray:
    """The image, or twice the image if it is small: more of its tags are then found."""
    if not _is_small(gray):
        return gray
    import cv2  # slow to import

    size = 2 * gray.shape[1], 2 * gray.shape[0]
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def gray_bytes(image: Image) -> ByteArray:
    """(H, W) gray levels of an image as bytes."""
    if image.ndim == 2 and image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    return np.asarray(np.rint(as_gray(image) * 255), np.uint8)


def locate_center(
    corners: FloatArray, sigma: float, size: float, camera: Camera
) -> tuple[FloatArray, FloatArray] | None:
    """Center (3,) of a tag in meters in the camera's frame, and its covariance (3, 3).

    None for corners that are no view of a square.

    Args:
        corners: (4, 2) in pixels without distortion.
        sigma: standard deviation of each coordinate in pixels.
        size: side in meters.
        camera: calibration.
    """
    import cv2  # slow to import

    square, K = SIDE * size, camera.matrix
    done, r, t, *_ = cv2.solvePnPGeneric(
        square, corners[:, None], K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not done or not float(t[0][2, 0]) > 0:
        return None
    pose = np.concatenate([r[0].ravel(), t[0].ravel()])
    prior = np.diag([TILT_SIGMA**-2] * 3 + [0.0] * 3) * sigma**2
    for _ in range(TAG_POSE_STEPS):
        projected, jacobian = cv2.projectPoints(square, pose[:3], pose[3:], K, None)
        J = np.asarray(jacobian)[:, :6]
        A = J.T @ J + prior
        pose = pose + np.linalg.solve(A, J.T @ (corners - projected[:, 0]).ravel())
    if not np.isfinite(pose).all() or pose[5] <= 0:
        return None
    covariance = sigma**2 * np.linalg.inv(A)[3:, 3:]
    return pose[3:], np.asarray(covariance, np.float64)
