"""Innovations and predicted observations."""

from typing import NamedTuple

from saccade.types import FloatArray


class Innovation(NamedTuple):
    """The innovation of one observation."""

    value: FloatArray
    """(2,) observed minus predicted range and bearing."""
    covariance: FloatArray
    """(2, 2) S of C.12, before the update."""
    nis: float
    """Normalized innovation squared; chi-square with two degrees if the filter is right."""


class PredictedObservations(NamedTuple):
    """Predicted observations of every landmark."""

    z: FloatArray
    """(n, 2)."""
    covariance: FloatArray
    """(n, 2, 2) H P H^T of each, without the noise of an observation."""
