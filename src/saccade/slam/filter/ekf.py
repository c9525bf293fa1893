"""EKF-SLAM: predict, update, augment (C.1-C.18)."""

from math import inf

import numpy as np

from saccade.errors import LogError
from saccade.slam.association import gating
from saccade.slam.filter import _kernels, _range_bearing_kernels
from saccade.slam.filter.error_state import STANDARD, Retraction, linearize
from saccade.slam.filter.odometry_bias import BIASES, control_slopes
from saccade.slam.filter.state import (
    FIRST_CAPACITY,
    LANDMARKS,
    dense,
    flush,
    grown,
    landmark_blocks,
    marginal,
    new_state,
    robot_rows,
    size_of,
    without,
)
from saccade.slam.filter.validation import check_covariance, check_landmark, check_vector
from saccade.slam.models import RANGE_BEARING, Motion, RangeBearing, Sensor, compose, drive, wrapped
from saccade.slam.results import Innovation, PredictedObservations, Replay
from saccade.slam.stretch import Stretch, replay
from saccade.types import FloatArray, IntArray


class EkfSlam:
    """The pose of a robot and the landmarks around it, as one Gaussian.

    The state is s = (x, y, theta, m1x, m1y, ..., mNx, mNy) (C.3). Its covariance P (C.4)
    is one buffer that doubles when it is full; see `_kernels` for how it is kept.

    Args:
        pose: (3,) x, y in metres, heading in radians; more numbers become part of the robot's
            state: the `odometry_bias.BIASES` of its odometry for the models of this package,
            or what a motion and a sensor model of one's own make of them.
        covariance: (3, 3) of the pose; zero where the pose defines the frame.
        motion: the motion model; `drive` (C.5-C.9) unless told otherwise.
        sensor: the sensor model; range and bearing (C.14-C.18) unless told otherwise.
        retraction: how errors are measured; `STANDARD`, the source's, unless told otherwise.
        huber: root of the normalized innovation squared beyond which an observation counts
            less, after Huber (1964): its covariance is as many times larger.

    Raises:
        LogError: here and in every method, an argument of the wrong shape, one that
            holds NaN or infinity, or a covariance that is not one. The state
            stays as it was.
    """

    def __init__(
        self,
        pose: FloatArray,
        covariance: FloatArray,
        motion: Motion = drive,
        sensor: Sensor = RANGE_BEARING,
        retraction: Retraction = STANDARD,
        huber: float = inf,
    ) -> None:
        self._motion = motion
        self._sensor = sensor
        self._retraction = int(Retraction(retraction))
        own = motion in (drive, compose) and type(sensor) is RangeBearing
        self.is_compiled = own and np.size(pose) in (3, 3 + BIASES)
        """Whether motion and sensor are those of this package, of which there are kernels."""
        self._huber = huber
        robot = check_vector("pose", pose, max(3, np.size(pose)))
        spread = check_covariance("covariance of the pose", covariance, len(robot))
        self._filter_state = new_state(robot, spread, FIRST_CAPACITY)
        self._names = np.zeros(0, np.int64)  # of the landmarks at the last removal
        self._removed = 0
        self._filter_state.state[2] = wrapped(robot[2])

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Move the robot (C.5-C.9).

        Args:
            u: (c,) control of the motion model; (distance, turn) for `drive`.
            U: (c, c) its covariance.
        """
        u = check_vector("control", u)
        U = check_covariance("covariance of the control", U, len(u))
        self._make_room()
        if self.is_compiled:
            _range_bearing_kernels.predict_by_control(
                self._filter_state, self._retraction, u, U, self._slopes(u[None])[0]
            )
            return
        moved, Fx, Fu = self._motion(self._robot, u)  # C.5, C.8, C.9
        _kernels.predict(self._filter_state, self._retraction, moved, Fx, Fu @ U @ Fu.T)  # C.7

    def update(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """Correct the state by an observation of a landmark of the map (C.10-C.14).

        Only the columns of the robot and of this landmark take part in the
        gain. Where the innovation covariance is singular, the directions that
        have no variance are left as they are.

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.
            landmark: number of the landmark in the map.

        Returns:
            The innovation, its covariance, and its normalized square.
        """
        check_landmark(landmark, len(self))
        z = check_vector("observation", z, 2)
        R = check_covariance("covariance of the observation", R, 2)
        self._make_room()
        b, how, S = self._filter_state, self._huber_kind, np.empty((2, 2))
        if self.is_compiled:
            m, v = len(self._robot) + 2 * landmark, np.empty(2)
            nis = _range_bearing_kernels.update_range_bearing(b, how[0], m, z, R, how[1], v, S)
        else:
            m, v, H, noise = self._linearized(z, R, landmark)  # C.14
            nis = _kernels.update(b, how[0], m, v, H, noise, how[1], S)  # C.10-C.13
        return Innovation(v, S, nis)

    def innovation(self, z: FloatArray, R: FloatArray, landmark: int) -> Innovation:
        """What `update` would find, at a cost that does not grow with the map.

        A robust caller looks here first, and then updates with a covariance R as much
        larger as the innovation deserves.

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.
            landmark: number of the landmark in the map.
        """
        check_landmark(landmark, len(self))
        z = check_vector("observation", z, 2)
        R = check_covariance("covariance of the observation", R, 2)
        at, v, H, noise = self._linearized(z, R, landmark)  # C.14
        S, root = np.empty((2, 2)), np.empty((2, 2))
        _kernels.prepare_update(
            self._filter_state, at, H, noise, 1.0, S, np.empty(H.shape), root
        )  # C.12
        white = root @ v
        return Innovation(v, S, float(white @ white))

    def update_scan(self, z: FloatArray, R: FloatArray, landmark: IntArray) -> Replay:
        """Take what is seen from one pose at once, as a `replay` that does not move.

        Args:
            z: (k, 2).
            R: (k, 2, 2) their covariances.
            landmark: (k,) number in the map; the next free number augments, a negative
                one leaves the observation out.
        """
        still = np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros(len(z), np.int64)
        s = Stretch.of(*still, z, R, landmark)
        s.at[1] = 0
        return self._replay_compiled(s)

    def augment(self, z: FloatArray, R: FloatArray) -> int:
        """Take a new landmark into the map (C.15-C.18).

        Args:
            z: (2,) range in metres and bearing in radians.
            R: (2, 2) its covariance.

        Returns:
            The landmark's number in the map.
        """
        z = check_vector("observation", z, 2)
        R = check_covariance("covariance of the observation", R, 2)
        self._make_room()
        xy, Gx, Gz = self._sensor.inverse_observe(self._robot, z)  # C.15, C.18
        _kernels.augment(self._filter_state, xy, Gx, Gz @ R @ Gz.T)  # C.16-C.17
        return len(self) - 1

    def replay(
        self,
        control: FloatArray,
        U: FloatArray,
        scan: IntArray,
        z: FloatArray,
        R: FloatArray,
        landmark: IntArray,
    ) -> Replay:
        """Take t steps with k observations at once, each step a `predict` and what is seen then.

        Where the models are those of this package it is done without leaving compiled code.

        Args:
            control: (t, c).
            U: (t, c, c) their covariances.
            scan: (k,) after which of the controls each observation was made, ascending.
            z: (k, 2).
            R: (k, 2, 2) their covariances.
            landmark: (k,) number in the map; the next free number augments, a negative
                one leaves the observation out.
        """
        return self._replay_compiled(Stretch.of(control, U, scan, z, R, landmark))

    def _replay_compiled(self, s: Stretch) -> Replay:
        out = Replay.empty(len(s.control), len(s.z))
        self.replay_into(s, out)
        return out

    def replay_into(self, s: Stretch, out: Replay) -> None:
        """`replay` a stretch; fills `out`."""
        free = np.maximum.accumulate(np.append(len(self) - 1, s.landmark))[:-1] + 1  # (k,)
        if (s.landmark > free).any():
            raise LogError(
                f"landmark: expected numbers up to {int(free[s.landmark > free][0])}, "
                f"found {int(s.landmark[s.landmark > free][0])}"
            )
        if not self.is_compiled:
            self._replay_slowly(s, out)
            return
        s = s._replace(slopes=self._slopes(s.control))
        while s.at[0] < len(s.control):
            self._make_room()
            replay(self._filter_state, *self._huber_kind, s, out)

    def remove(self, landmarks: IntArray) -> None:
        """Take landmarks out of the map; those behind them move up in number.

        Args:
            landmarks: (k,) their numbers.
        """
        for number in np.asarray(landmarks).tolist():
            check_landmark(number, len(self))
        gone = np.unique(np.asarray(landmarks, np.int64))
        self._names = np.delete(self.ids, gone)
        self._removed += len(gone)
        without(self._filter_state, np.asarray(landmarks, np.int64))

    def rescale(self, factor: float, about: FloatArray) -> None:
        """Make the map larger about a place (2,), as when its metre was a wrong one."""
        b, r, n = self._filter_state, len(self._robot), size_of(self._filter_state)
        flush(b)
        grow = np.full(n, factor)
        grow[2:r] = 1.0
        for i in (0, 1):
            at = np.append(i, np.arange(r + i, n, 2))
            b.state[at] = about[i] + factor * (b.state[at] - about[i])
        b.heading_lever[:n] *= grow
        b.P[:n, :n] *= grow[:, None] * grow
        b.blocks[: len(self)] *= factor**2

    def predict_observations(self) -> PredictedObservations:
        """What should be seen of every landmark from here, for the association."""
        b, r, N = self._filter_state, len(self._robot), len(self)
        if self.is_compiled:
            found = PredictedObservations(np.empty((N, 2)), np.empty((N, 2, 2)))
            gating.predict_observations(b, self._retraction, np.arange(N), *found)
            return found
        z, H = self._sensor.observe(self._robot, self.landmarks)
        Hx, Hm = H[..., :r], H[..., r:]  # (N, 2, r), (N, 2, 2)
        rows = robot_rows(b, self._retraction)
        Pxm = rows[:, r:].reshape(r, N, 2).transpose(1, 0, 2)  # (N, r, 2)
        cross = Hx @ Pxm @ Hm.transpose(0, 2, 1)  # (N, 2, 2)
        own = Hm @ self.landmark_covariances @ Hm.transpose(0, 2, 1)
        robot = Hx @ rows[:, :r] @ Hx.transpose(0, 2, 1)
        return PredictedObservations(z, robot + cross + cross.transpose(0, 2, 1) + own)

    def marginal(self, landmarks: IntArray) -> FloatArray:
        """The joint covariance of the robot and of some landmarks, without looking at the rest.

        Args:
            landmarks: (k,) their numbers.

        Returns:
            (3 + 2k, 3 + 2k), in the order given.
        """
        return marginal(self._filter_state, self._retraction, np.asarray(landmarks, np.int64))

    @property
    def pose(self) -> FloatArray:
        """(3,) x, y in metres, heading in radians."""
        return self._filter_state.state[:3].copy()

    @property
    def pose_covariance(self) -> FloatArray:
        """(3, 3)."""
        covariance = np.empty((3, 3))
        _range_bearing_kernels.write_pose(
            self._filter_state, self._retraction, np.empty(3), covariance
        )
        return covariance

    @property
    def odometry_bias(self) -> FloatArray | None:
        """(3,) as `odometry_bias.BIASES` has them, None where they are no part of the state."""
        return self._robot[3:].copy() if self.is_compiled and len(self._robot) > 3 else None

    @property
    def ids(self) -> IntArray:
        """(n,) how many landmarks had been taken in before each; it stays as others go."""
        since = np.arange(len(self._names) + self._removed, len(self) + self._removed)
        return np.concatenate([self._names, since])

    @property
    def landmarks(self) -> FloatArray:
        """(N, 2) metres, in the order in which they were augmented."""
        return (
            self._filter_state.state[len(self._robot) : size_of(self._filter_state)]
            .reshape(-1, 2)
            .copy()
        )

    @property
    def landmark_covariances(self) -> FloatArray:
        """(N, 2, 2) square metres."""
        return landmark_blocks(self._filter_state, self._retraction)

    @property
    def state(self) -> FloatArray:
        """(3 + 2N,) the pose, then the landmarks (C.3)."""
        return self._filter_state.state[: size_of(self._filter_state)].copy()

    @property
    def covariance(self) -> FloatArray:
        """(3 + 2N, 3 + 2N) of the whole state (C.4)."""
        return dense(self._filter_state, self._retraction)

    @property
    def motion(self) -> Motion:
        """The motion model."""
        return self._motion

    @property
    def sensor(self) -> Sensor:
        """The sensor model."""
        return self._sensor

    def __len__(self) -> int:
        return int(self._filter_state.counts[LANDMARKS])

    def __repr__(self) -> str:
        x, y, theta = self.pose
        return f"EkfSlam({len(self)} landmarks, pose {x:.2f} {y:.2f} m {theta:.3f} rad)"

    @property
    def _huber_kind(self) -> tuple[int, float]:
        return self._retraction, self._huber

    @property
    def _robot(self) -> FloatArray:
        return self._filter_state.state[: len(self._filter_state.workspace)]

    def _replay_slowly(self, s: Stretch, out: Replay) -> None:
        for i in range(len(s.control)):
            if s.at[1] < 0:
                self.predict(s.control[i], s.U[i])
            for k in range(s.edge[i], s.edge[i + 1]):
                if s.landmark[k] == len(self):
                    self.augment(s.z[k], s.R[k])
                elif s.landmark[k] >= 0:
                    found = self.update(s.z[k], s.R[k], int(s.landmark[k]))
                    out.innovation[k], out.innovation_covariance[k], out.nis[k] = found
            out.pose[i], out.covariance[i] = self.pose, self.pose_covariance

    def _slopes(self, control: FloatArray) -> FloatArray:
        """(t, c, r - 3) of controls (t, c) by what the robot's state has behind the pose."""
        return control_slopes(control)[:, :, : len(self._robot) - 3]

    def _linearized(
        self, z: FloatArray, R: FloatArray, landmark: int
    ) -> tuple[int, FloatArray, FloatArray, FloatArray]:
        """The landmark's row, and the `Linearization` of an observation of it."""
        b, r = self._filter_state, len(self._robot)
        m = r + 2 * landmark
        here = np.append(np.arange(r), [m, m + 1])
        s, a = b.state[here], b.heading_lever[here]
        first = s.copy()
        first[[0, r]] -= a[[1, r + 1]]
        first[[1, r + 1]] += a[[0, r]]
        return m, *linearize(self._retraction, self._sensor, s, first, z, R)

    def _make_room(self, landmarks: int = 1) -> None:
        """For another step and so many more landmarks."""
        if len(self) + landmarks > len(self._filter_state.blocks):
            while len(self) + landmarks > len(self._filter_state.blocks):
                self._filter_state = grown(self._filter_state)
        elif _kernels.is_full(self._filter_state):
            flush(self._filter_state)
