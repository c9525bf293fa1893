"""Predict, update and augment a state with motion and sensor models (C.5-C.18).

The models of this package are compiled; custom ones are NumPy, with the same methods.
"""

from typing import NamedTuple

import numpy as np

from saccade.slam.filter import _kernels
from saccade.slam.filter._range_bearing_kernels import (
    Innovations,
    augment_range_bearing,
    expected_observations,
    linearize_range_bearing,
    predict_by_control,
    update_scan,
)
from saccade.slam.filter._state_kernels import FilterState
from saccade.slam.filter.state import landmark_blocks, robot_rows, state_rows
from saccade.slam.models import MotionModel, RangeBearing, Sensor, compose, turn_then_translate
from saccade.types import FloatArray, IntArray

BIASES = 3
"""States after the pose: relative error of the distance; turn in radians per metre driven; and
metres lost per radian turned."""


def bias_jacobian(control: FloatArray) -> FloatArray:
    """Jacobian D of controls by the biases: the true control is u + D bias.

    Args:
        control: (t, 2) distance and turn, or (t, 3) forward, left and turn.

    Returns:
        (t, c, 3).
    """
    forward, turn = control[:, 0], control[:, -1]
    D = np.zeros((*control.shape, BIASES))
    D[:, :-1, 0] = control[:, :-1]
    D[:, -1, 1] = forward
    D[:, 0, 2] = -np.sign(forward) * np.abs(turn)
    return D


def unbiased(control: FloatArray, bias: FloatArray) -> FloatArray:
    """Controls (t, c) corrected for the biases (3,)."""
    return np.asarray(control + bias_jacobian(control) @ bias)


class PredictedObservations(NamedTuple):
    """Predicted observations of landmarks."""

    z: FloatArray
    """(n, 2)."""
    covariance: FloatArray
    """(n, 2, 2) H P H^T of each, without the noise of an observation."""


class Models:
    """The motion models of this package, and range and bearing."""

    compiled = True
    """Whether both models are those of this package."""

    def __init__(self, motion: MotionModel, sensor: Sensor) -> None:
        self.motion, self.sensor = motion, sensor
        self.observes_ranges = type(sensor) is RangeBearing

    def predict(self, f: FilterState, u: FloatArray, U: FloatArray) -> None:
        """Move the robot by a control (c,) with covariance (c, c) (C.5-C.9)."""
        predict_by_control(f, u, U, control_bias(u, f.robot_size))

    def update(
        self, f: FilterState, z: FloatArray, R: FloatArray, landmark: IntArray
    ) -> Innovations:
        """Update by observations (k, 2) of landmarks (k,), in their order (C.10-C.14).

        The next free number augments, a negative one leaves the observation out.
        """
        out = new_innovations(len(z))
        update_scan(f, z, R, landmark, out)
        return out

    def augment(self, f: FilterState, z: FloatArray, R: FloatArray) -> None:
        """Add the landmark of an observation (2,) (C.15-C.18)."""
        augment_range_bearing(f, z, R)

    def linearize(
        self, f: FilterState, z: FloatArray, R: FloatArray, landmark: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Innovation (2,), its Jacobian (2, r + 2) by eta and its noise (2, 2) (C.14)."""
        v, H, noise = np.empty(2), np.empty((2, f.robot_size + 2)), np.empty((2, 2))
        linearize_range_bearing(f, f.robot_size + 2 * landmark, z, R, v, H, noise)
        return v, H, noise

    def expected(self, f: FilterState, landmarks: IntArray) -> PredictedObservations:
        """Predicted observations of landmarks (k,)."""
        k = len(landmarks)
        predicted = PredictedObservations(np.empty((k, 2)), np.empty((k, 2, 2)))
        expected_observations(f, landmarks, *predicted)
        return predicted


class CustomMotion(Models):
    """A custom motion model; range and bearing."""

    compiled = False

    def predict(self, f: FilterState, u: FloatArray, U: FloatArray) -> None:
        """See `Models.predict`."""
        moved, Fx, Fu = self.motion(f.state[: f.robot_size].copy(), u)  # C.5, C.8, C.9
        _kernels.predict(f, moved, Fx, Fu @ U @ Fu.T)  # C.7


class CustomSensor(CustomMotion):
    """A custom sensor model, and any motion model."""

    def update(
        self, f: FilterState, z: FloatArray, R: FloatArray, landmark: IntArray
    ) -> Innovations:
        """See `Models.update`."""
        out = new_innovations(len(z))
        for k, number in enumerate(landmark.tolist()):
            if number == f.now.landmarks:
                self.augment(f, z[k], R[k])
            elif number >= 0:
                v, H, noise = self.linearize(f, z[k], R[k], number)
                m = f.robot_size + 2 * number
                out.value[k] = v
                out.nis[k] = _kernels.update(f, m, v, H, noise, out.covariance[k])  # C.10-C.13
        return out

    def augment(self, f: FilterState, z: FloatArray, R: FloatArray) -> None:
        """See `Models.augment`."""
        robot = f.state[: f.robot_size].copy()
        xy, Gx, Gz = self.sensor.inverse_observe(robot, z)  # C.15, C.18
        _kernels.augment(f, xy, Gx, Gz @ R @ Gz.T)  # C.16-C.17

    def linearize(
        self, f: FilterState, z: FloatArray, R: FloatArray, landmark: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `Models.linearize`."""
        rows = state_rows(np.array([landmark]), f.robot_size)
        s = f.state[rows]
        predicted, H = self.sensor.observe(s[:-2], s[-2:])
        H = np.column_stack([H[:, :2], H[:, 2] + H @ f.heading_lever[rows], H[:, 3:]])  # by eta
        return self.sensor.difference(z, predicted), H, R  # C.14

    def expected(self, f: FilterState, landmarks: IntArray) -> PredictedObservations:
        """See `Models.expected`."""
        r, k = f.robot_size, len(landmarks)
        rows = state_rows(landmarks, r)
        z, H = self.sensor.observe(f.state[:r].copy(), f.state[rows[r:]].reshape(k, 2))
        Hx, Hm = H[..., :r], H[..., r:]  # (k, 2, r), (k, 2, 2)
        P = robot_rows(f)[:, rows]
        Pxm = P[:, r:].reshape(r, k, 2).transpose(1, 0, 2)  # (k, r, 2)
        cross = Hx @ Pxm @ Hm.transpose(0, 2, 1)  # (k, 2, 2)
        own = Hm @ landmark_blocks(f)[landmarks] @ Hm.transpose(0, 2, 1)
        robot = Hx @ P[:, :r] @ Hx.transpose(0, 2, 1)
        return PredictedObservations(z, robot + cross + cross.transpose(0, 2, 1) + own)


def models_of(motion: MotionModel, sensor: Sensor, robot_size: int) -> Models:
    """The models as the filter applies them, for a robot of so many numbers."""
    if type(sensor) is not RangeBearing:
        return CustomSensor(motion, sensor)
    compiled = motion in (turn_then_translate, compose) and robot_size in (3, 3 + BIASES)
    return (Models if compiled else CustomMotion)(motion, sensor)


def control_bias(u: FloatArray, robot_size: int) -> FloatArray:
    """(c, r - 3) Jacobian of a control by the robot's states beyond the pose."""
    jacobian: FloatArray = _NO_BIAS[len(u)] if robot_size == 3 else bias_jacobian(u[None])[0]
    return jacobian


def new_innovations(k: int) -> Innovations:
    """Room for the innovations of so many observations."""
    room = np.full(7 * k, np.nan)
    value, covariance = room[: 2 * k].reshape(k, 2), room[2 * k : 6 * k].reshape(k, 2, 2)
    return Innovations(value, covariance, room[6 * k :])


_NO_BIAS = {c: np.zeros((c, 0)) for c in (2, 3)}
