"""Warping of the ground plane between two images, compiled."""

from saccade._jit import kernel
from saccade.types import FloatArray
from saccade.visual.camera import Intrinsics
from saccade.visual.optical_flow import ByteArray, ImageGradients, ShortArray


@kernel()
def warp_ground(
    rays: FloatArray,
    intensity: FloatArray,
    intrinsics: Intrinsics,
    R: FloatArray,
    direction: FloatArray,
    distance: float,
    plane: FloatArray,
    image: ImageGradients,
    warped: FloatArray,
    J: FloatArray,
) -> int:
    """Sample the next image at m points of the ground plane.

    Args:
        rays: (m, 3) of the points in the previous camera frame.
        intensity: (m,) of the points in the previous image.
        intrinsics: of the next image.
        R: (3, 3) rotation of the camera.
        direction: (3,) unit vector of its translation.
        distance: length of the translation, in camera heights.
        plane: (3, 3) plane normal over the height, scaled, and the derivatives of `distance`
            times it by the two tilts; the first row is the derivative by the distance.
        image: the next one (h, w) and its gradients.
        warped: (m,) becomes the sampled intensities.
        J: (m, 5) becomes their derivatives by distance and tilts; and by gain and offset, the
            negated previous intensity and -1.

    Returns:
        The number of points inside the image, whose rows of `warped` and `J` are filled.
    """
    fx, fy, cx, cy = intrinsics
    height, width = image.intensity.shape
    n = 0
    for i in range(len(rays)):
        a, b, c = rays[i, 0], rays[i, 1], rays[i, 2]
        shift = distance * (a * plane[0, 0] + b * plane[0, 1] + c * plane[0, 2])
        z = a * R[2, 0] + b * R[2, 1] + c * R[2, 2] + shift * direction[2]
        if z <= 0.0:
            continue
        u = (a * R[0, 0] + b * R[0, 1] + c * R[0, 2] + shift * direction[0]) / z
        v = (a * R[1, 0] + b * R[1, 1] + c * R[1, 2] + shift * direction[1]) / z
        x, y = u * fx + cx, v * fy + cy
        if not (1 < x < width - 2 and 1 < y < height - 2):
            continue
        slope = bilinear(image.dx, x, y) / 8 * (direction[0] - u * direction[2]) / z * fx
        slope += bilinear(image.dy, x, y) / 8 * (direction[1] - v * direction[2]) / z * fy
        for j in range(3):
            J[n, j] = slope * (a * plane[j, 0] + b * plane[j, 1] + c * plane[j, 2])
        J[n, 3], J[n, 4] = -intensity[i], -1.0
        warped[n] = bilinear(image.intensity, x, y)
        n += 1
    return n


@kernel()
def bilinear(image: ByteArray | ShortArray, x: float, y: float) -> float:
    """Bilinear interpolation of an image at a sub-pixel position."""
    i, j = int(y), int(x)
    p, q = y - i, x - j
    upper: float = (1 - q) * image[i, j] + q * image[i, j + 1]
    lower: float = (1 - q) * image[i + 1, j] + q * image[i + 1, j + 1]
    return (1 - p) * upper + p * lower
