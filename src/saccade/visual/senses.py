"""What a frame shows by itself, whatever is made of it: its points, and what stands out in it."""

from dataclasses import dataclass, field

from saccade.frames import Camera
from saccade.pyramid import FloatMap
from saccade.visual.config import VisualConfig
from saccade.visual.frontend import Detector, Followed, View
from saccade.visual.selection import attend


@dataclass
class Memory:
    """What runs over the same frames, with other choices and budgets, need not work out anew."""

    points: dict[tuple[str, int, int], Followed] = field(default_factory=dict)
    """By detector, number of points and frame."""
    saliency: dict[tuple[str, int], FloatMap | None] = field(default_factory=dict)
    """By kind and frame."""


class Senses:
    """Detects points, and attends to what is salient.

    Args:
        config: how to look.
        memory: of earlier runs over the same frames with the same camera; it grows.
    """

    def __init__(self, config: VisualConfig, memory: Memory | None = None) -> None:
        self._config, self._memory = config, memory
        self._detect = Detector(config)

    def detect(self, view: View, camera: Camera, number: int) -> Followed:
        """The points of a frame that shows something."""
        if self._memory is None:
            return self._detect(view, camera, number)
        key = self._config.detector, self._config.points, number
        if key not in self._memory.points:
            self._memory.points[key] = self._detect(view, camera, number)
        return self._memory.points[key]

    def attend(self, view: View, number: int) -> FloatMap | None:
        """(h, w) saliency of a frame; None where the choice does not ask for it."""
        if view.frame.image is None:
            return None
        if self._memory is None:
            return attend(view.frame.image, self._config)
        key = self._config.selection, number
        if key not in self._memory.saliency:
            self._memory.saliency[key] = attend(view.frame.image, self._config)
        return self._memory.saliency[key]
