"""Charts of filter consistency over time, for the report."""

from dataclasses import dataclass

import numpy as np

from saccade.types import FloatArray, Trajectory
from saccade.viewing.style import SIGMAS

BAND_NAME = f"{SIGMAS:.0f} sigma"
"""Name of the band of one variable."""


@dataclass(frozen=True)
class Chart:
    """Values over time with a band."""

    title: str
    unit: str
    time: FloatArray
    """(k,) seconds."""
    values: FloatArray
    """(k,) values, NaN where unknown."""
    band: tuple[FloatArray, FloatArray]
    """(k,) lower and upper limit."""
    band_name: str
    name: str
    mean: FloatArray | None = None
    """(k,) running mean of the values, drawn on top."""
    mean_name: str = ""
    dots: bool = False
    """Whether each value is a dot."""
    logarithmic: bool = False


def uncertainty_charts(estimate: Trajectory, truth: Trajectory | None) -> list[Chart]:
    """Uncertainty of the estimate over time, with errors if ground truth is known.

    Args:
        estimate: without covariance there are no charts.
        truth: with headings, in the same frame.
    """
    if estimate.covariance is None:
        return []
    time, scale = estimate.time, np.array([1, 1, 180 / np.pi])
    limit = SIGMAS * scale * np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2).clip(0))
    if truth is None:
        variance = np.linalg.eigvalsh(estimate.covariance[:, :2, :2])[:, -1]  # along the major axis
        position, zero = SIGMAS * np.sqrt(variance.clip(0)), np.zeros(len(time))
        return [
            Chart(
                f"Uncertainty of the {name}", unit, time, each, (zero, each), BAND_NAME, BAND_NAME
            )
            for name, unit, each in (("position", "m", position), ("heading", "°", limit[:, 2]))
        ]
    error = estimate.pose - truth.at(time)
    error[:, 2] = np.degrees(np.angle(np.exp(1j * error[:, 2])))
    return [
        Chart(f"Error in {axis}", unit, time, values, (-band, band), BAND_NAME, "error")
        for axis, unit, values, band in zip(
            ("x", "y", "heading"), ("m", "m", "°"), error.T, limit.T, strict=True
        )
    ]


def innovation_charts(
    time: FloatArray,
    innovation: FloatArray,
    covariance: FloatArray,
    nis: FloatArray,
    band: tuple[float, float],
    window: int,
) -> list[Chart]:
    """Innovations in range and bearing against their covariance.

    Args:
        time: (k,) of each observation, ascending.
        innovation: (k, 2), NaN for an observation without update.
        covariance: (k, 2, 2) covariances of the innovations.
        nis: (k,) normalized innovation squared.
        band: 95 % interval of the running mean of a consistent filter.
        window: observations in the running mean.
    """
    used = np.isfinite(nis)
    if not used.any():
        return []
    time, nis, ones = time[used], nis[used], np.ones(int(used.sum()))
    mean = np.full(len(nis), np.nan)
    mean[window - 1 :] = running_mean(nis, window)
    chart = Chart(
        "Normalized innovation squared",
        "",
        time,
        nis.clip(1e-3),
        (band[0] * ones, band[1] * ones),
        "95 % of the means of a consistent filter",
        "each observation",
        mean,
        f"mean of {window}",
        dots=True,
        logarithmic=True,
    )
    sigma = np.sqrt(np.diagonal(covariance[used], axis1=1, axis2=2))
    ratios, limits = innovation[used] / np.maximum(sigma, 1e-300), (-SIGMAS * ones, SIGMAS * ones)
    return [chart] + [
        Chart(
            f"Innovation of the {component}",
            "sigma",
            time,
            each,
            limits,
            BAND_NAME,
            chart.name,
            dots=True,
        )
        for component, each in zip(("range", "bearing"), ratios.T, strict=True)
    ]


def running_mean(values: FloatArray, window: int) -> FloatArray:
    """(k - window + 1,) means of `window` successive values (k,); empty where there are fewer."""
    if len(values) < window:
        return np.empty(0)
    return np.convolve(values, np.full(window, 1 / window), "valid")
