"""Self-calibration: errors of the camera's calibration that the points themselves reveal.

Over a window of frames a point is seen at many places of the image and at many depths; an error of
the calibration leaves residuals there that no motion explains. The focal length is no part of it:
over a small window it can hardly be told from the distortion.
"""

import numpy as np

from saccade.frames import Camera
from saccade.types import FloatArray

SIGMA = (0.02, 0.3)
"""Standard deviations before the first frame: of the distortion at the radius of a focal length,
as a fraction of that; and of the disparity there, in pixels: by how much the focal lengths of the
two cameras differ."""


class SelfCalibration:
    """Constant errors of a calibration, estimated from all windows so far.

    Args:
        camera: the calibration.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._information = np.diag(1 / np.square(SIGMA))
        self._vector = np.zeros(len(SIGMA))

    @property
    def error(self) -> FloatArray:
        """(2,) estimated errors."""
        return np.asarray(np.linalg.solve(self._information, self._vector))

    def correct(self, observed: FloatArray) -> FloatArray:
        """Observations (..., 3) of pixels and inverse depths, without the estimated errors."""
        return np.asarray(observed + self.jacobian(observed) @ self.error)

    def jacobian(self, observed: FloatArray) -> FloatArray:
        """(..., 3, 2) derivatives of corrected observations (..., 3) by the parameters."""
        camera = self._camera
        center = np.array([camera.cx, camera.cy])
        offset = observed[..., :2] - center
        ray = offset / (camera.fx, camera.fy)
        squared = np.square(ray)
        J = np.zeros((*observed.shape, len(SIGMA)))
        J[..., :2, 0] = offset * squared.sum(-1, keepdims=True)
        if camera.baseline > 0:
            J[..., 2, 0] = observed[..., 2] * (3 * squared[..., 0] + squared[..., 1])
            J[..., 2, 1] = ray[..., 0] / (camera.fx * camera.baseline)
        return J

    def update(self, information: FloatArray, gradient: FloatArray) -> None:
        """Add the normal equations (2, 2), (2,) of corrections, about the current estimate."""
        self._vector = self._vector + information @ self.error + gradient
        self._information = self._information + information
