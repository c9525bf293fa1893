"""A simulated camera that pans: its motor, with latency, and its encoder, with noise."""

from bisect import bisect_right

import numpy as np

from saccade.frames import CameraTurn, Gaze, GazeLimits

ENCODER_SIGMA = float(np.radians(0.1))
"""Standard deviation of the measured pan, in radians, by default."""


class PanCamera:
    """The pan of a camera over time, from the gazes it was told.

    Args:
        limits: range, rate and latency.
        sigma: standard deviation of the encoder in radians.
        seed: of its noise.
    """

    def __init__(
        self, limits: GazeLimits | None = None, sigma: float = ENCODER_SIGMA, seed: int = 0
    ) -> None:
        self.limits = limits or GazeLimits()
        self._sigma, self._seed = sigma, seed
        self._start, self._target = [-np.inf], [0.0]  # times at which it turns to each
        self._reason = [""]

    def turn_to(self, time: float, gaze: Gaze) -> None:
        """Begin to turn, after the latency; commands come in the order of their times."""
        self._start.append(time + self.limits.latency)
        self._target.append(float(np.clip(gaze.pan, *self.limits.pan)))
        self._reason.append(gaze.reason)

    def angle(self, time: float) -> float:
        """True pan at a time, by the commands up to now."""
        pan = self._target[0]
        for k in range(1, len(self._start)):
            end = self._start[k + 1] if k + 1 < len(self._start) else np.inf
            turned = self.limits.rate * max(0.0, min(end, time) - self._start[k])
            pan += float(np.clip(self._target[k] - pan, -turned, turned))
        return pan

    def measured(self, time: float) -> CameraTurn:
        """The pan as the encoder measures it, and the reason of the command that it follows."""
        rng = np.random.default_rng([self._seed, round(1e6 * max(time, 0.0))])
        pan = self.angle(time) + self._sigma * rng.standard_normal()
        reason = self._reason[bisect_right(self._start, time) - 1]
        return CameraTurn(pan, 0.0, self._sigma, reason)
