"""Memory for the arguments and results of steps."""

import numpy as np

from saccade.slam._step_kernels import StepResults, Steps
from saccade.slam.association._kernels import NEW
from saccade.slam.strides import new_results


class ScanMemory:
    """Memory for one step, which the next one uses again."""

    def __init__(self) -> None:
        self._sizes = (-1, 0, 0)
        self._steps, self._results = new_steps(1, 0, 2, 0), new_results(1, 0)

    def room_for(self, k: int, c: int, biases: int) -> tuple[Steps, StepResults]:
        """Steps and results as of `new_steps` and `new_results`, with room for k observations."""
        capacity = self._sizes[0]
        if k > capacity or self._sizes[1:] != (c, biases):
            self._sizes = max(k, 2 * capacity), c, biases
            self._steps = new_steps(1, self._sizes[0], c, biases)
            self._results = new_results(1, self._sizes[0])
        s, out = self._steps, self._results
        s.position[:] = 0, -1
        s.landmark.fill(NEW)
        s.name.fill(-1)
        s.refused.fill(False)
        out.lost[0] = False
        for array in out.innovations:
            array.fill(np.nan)
        return s, out


def new_steps(t: int, k: int, c: int, biases: int) -> Steps:
    """Room for so many steps and observations, controls (c,) and states of the odometry bias."""
    return Steps(
        first=np.zeros(1, np.int64),
        still=np.zeros(1, np.int64),
        time=np.zeros(t),
        control=np.zeros((t, c)),
        U=np.zeros((t, c, c)),
        bias_jacobian=np.zeros((t, c, biases)),
        edge=np.zeros(t + 1, np.int64),
        z=np.zeros((k, 2)),
        R=np.zeros((k, 2, 2)),
        identity=np.full(k, -1),
        landmark=np.full(k, NEW),
        name=np.full(k, -1),
        refused=np.zeros(k, np.bool_),
        position=np.array([0, -1]),
    )
