"""Settings of the selection of keypoints, shared by SIFT and MUST."""

from dataclasses import dataclass
from math import inf
from typing import Literal

from saccade.errors import Settings, setting

MIN_RESPONSE = 1e-4
"""Response that passes all but rounding errors."""


@dataclass(frozen=True)
class SelectionConfig(Settings):
    """Which extrema of a scale space become keypoints; the default is `Sift`'s."""

    border: int = setting(5, 2)
    """Samples at the edge of every octave that are not searched."""
    contrast_threshold: float | None = setting(None, 0, below=1)
    """Smallest |D| at an extremum, tau_c (B.6). None means 0.016, or no threshold if
    `max_keypoints` is set."""
    neighbors: Literal[10, 26] = 10
    """Samples that an extremum is compared with: all 26 around it, as Lowe has it, or the 8 in its
    plane and the 2 above and below. In sparse sampling one of the other 16 often belongs to another
    extremum, which makes detection less repeatable. With 10, the fit rejects saddles."""
    edge_ratio: float = setting(15.0, 1, inf)
    """Largest ratio of the principal curvatures, tau_r (B.10)."""
    max_orientations: int | None = setting(None, 1)
    """Strongest orientations to keep at a position; None for all over 80 % of the highest."""
    upright: bool = False
    """Give every keypoint the angle 0."""
    max_keypoints: int | None = setting(None, 1)
    """Number of keypoints to keep, the strongest; None for all."""
    spread: bool = False
    """Prefer keypoints far from any clearly stronger one, so that they cover the image (adaptive
    non-maximal suppression)."""

    default_threshold = 0.016
    """The threshold where neither it nor the number of keypoints is given."""

    @property
    def min_response(self) -> float:
        """Smallest response of a keypoint."""
        if self.contrast_threshold is not None:
            return self.contrast_threshold
        return self.default_threshold if self.max_keypoints is None else MIN_RESPONSE
