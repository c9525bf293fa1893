"""The arguments of a step, validated before anything changes."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError
from saccade.landmark_names import number_names
from saccade.slam.filter.validation import as_array, as_number, as_numbers, require_shape
from saccade.types import FloatArray, IntArray


class StepArguments(NamedTuple):
    """Those of `Slam.step` as arrays."""

    time: float
    control: FloatArray | None
    """(c,), or None where the robot has not moved."""
    U: FloatArray
    """(c, c)."""
    z: FloatArray
    """(k, 2)."""
    R: FloatArray
    """(k, 2, 2)."""
    identity: IntArray
    """(k,) numbers of the names, -1 where unknown."""
    text_names: tuple[str, ...]
    """The table of names, with those that are new."""


def step_arguments(
    time: object,
    control: Any,
    U: object,
    z: object,
    R: object,
    names: npt.ArrayLike | None,
    after: float,
    control_size: int | None,
    text_names: tuple[str, ...],
) -> StepArguments:
    """Arrays of what is like an array.

    The first six are those of `Slam.step`; `after` is the time of the last step, `control_size`
    that of the motion model (None for any), and `text_names` the names so far that are text.

    Raises:
        LogError: something else than numbers, another shape, or a time that goes back.
    """
    seconds = as_number("time", time)
    if seconds < after:
        raise LogError(f"time: expected {after:g} or later, found {seconds:g}")
    z = np.empty((0, 2)) if z is None else np.atleast_1d(as_numbers("observations", z))
    k, c = len(z), control_size or (1 if control is None else np.size(control))
    identity = np.full(k, -1)
    if names is not None:
        identity, text_names = number_names(names, text_names)
        require_shape("names", (k,), identity)
    still = control is None
    return StepArguments(
        time=seconds,
        control=None if still else as_array("control", (c,), control),
        U=np.empty((c, c)) if still else as_array("covariance of the control", (c, c), U),
        z=as_array("observations", (k, 2), z),
        R=as_array("covariances of the observations", (k, 2, 2), R),
        identity=identity,
        text_names=text_names,
    )
