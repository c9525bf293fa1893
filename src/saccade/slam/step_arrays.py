"""Room for the results of steps."""

import numpy as np

from saccade.slam._step_kernels import StepResults
from saccade.slam.results import new_innovations


def new_results(t: int, k: int) -> StepResults:
    """Room for the results of so many steps and observations."""
    lost = np.zeros(t, np.bool_)
    return StepResults(np.empty((t, 3)), np.empty((t, 3, 3)), new_innovations(k), lost)
