"""What looks at the photographs of `saccade serve`."""

import secrets
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

from saccade.attention.models import KINDS, AttentionModel, layers_of
from saccade.errors import ConfigError, ImageError, require
from saccade.serving.controls import DETECTORS, MODELS

if TYPE_CHECKING:
    from saccade.types import Float32Array

MAX_PHOTOS = 4
"""Photographs that are kept in memory, those that were used last."""
MAX_PIXELS = 40_000_000
"""Of a photograph."""
MAX_FIXATIONS = 100
MAX_POINTS = 2000
"""Interest points that are drawn."""
MAX_NAME = 200
"""Letters of a name that are kept."""


@dataclass(frozen=True)
class Photo:
    """A photograph and what it is called."""

    name: str
    pixels: "Float32Array"
    """(H, W, 3) in [0, 1]."""


class PhotoAnalyzer:
    """Holds the last few photographs, and looks at them; see `saccade.serving.app.Analyzer`."""

    def __init__(self) -> None:
        self._photos: OrderedDict[str, Photo] = OrderedDict()
        self._last_maps: tuple[Photo, AttentionModel, Any] | None = None

    def open(self, data: bytes, name: str) -> dict[str, Any]:
        """Hold a photograph.

        Args:
            data: of its file.
            name: of its file.

        Raises:
            ImageError: it is none, is too large, or too small to look at.
        """
        from saccade.image import decode_image, size_in_header
        from saccade.serving.snippets import read_python
        from saccade.viewing.embedding import photograph

        name = name[-MAX_NAME:]
        width, height = size_in_header(data, name)
        if width * height > MAX_PIXELS:
            raise ImageError(
                f"{name}: expected at most {MAX_PIXELS / 1e6:g} million pixels, "
                f"found {width} x {height}"
            )
        pixels = decode_image(data, name)
        token = secrets.token_urlsafe(12)
        self._photos[token] = Photo(name, pixels)
        while len(self._photos) > MAX_PHOTOS:
            self._photos.popitem(last=False)
        return {
            "photo": token,
            "name": name,
            "size": [pixels.shape[1], pixels.shape[0]],
            "image": photograph(pixels),
            "python": read_python(name),
        }

    def analyze(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Where a photograph draws the eye.

        Args:
            request: "photo", "model", "fixations", and by kind the settings that count.

        Raises:
            KeyError: the photograph is not held.
            SaccadeError: a wish that cannot be granted.
        """
        from saccade.attention.scanpath import scanpath
        from saccade.serving.snippets import attention_command, attention_python
        from saccade.settings import settings_from
        from saccade.viewing.report_image import scanpath_data

        began = perf_counter()
        photo = self._photo(request)
        model = request.get("model", "both")
        require(model in list(MODELS), "model", f"one of {', '.join(MODELS)}", model)
        fixations = request.get("fixations", 10)
        fits = type(fixations) is int and 1 <= fixations <= MAX_FIXATIONS
        require(fits, "fixations", f"1 to {MAX_FIXATIONS}", fixations)
        outer, *inner = MODELS[model]
        table = _table(request, outer) | {kind: _table(request, kind) for kind in inner}
        attention = AttentionModel(model, settings_from(KINDS[model], table, outer))
        config = settings_from("scanpath", _table(request, "scanpath"), "scanpath")
        saliency, maps = self._maps_of(photo, attention)
        path = scanpath(saliency, photo.pixels.shape, fixations, config)
        of = (attention.model, attention.settings, config, fixations)
        return {
            "maps": maps,
            "scanpath": scanpath_data(path),
            "ms": 1000 * (perf_counter() - began),
            "python": attention_python(*of),
            "command": attention_command(photo.name, *of),
        }

    def detect(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Interest points of a photograph.

        Args:
            request: "photo", "detector", and the settings of that.

        Raises:
            KeyError: the photograph is not held.
            SaccadeError: a wish that cannot be granted.
        """
        from saccade.keypoints import Must, Sift, SymRoid
        from saccade.serving.snippets import detection_command, detection_python
        from saccade.settings import settings_from
        from saccade.viewing.report_image import points_data

        began = perf_counter()
        photo = self._photo(request)
        name = request.get("detector", "sift")
        require(name in DETECTORS, "detector", f"one of {', '.join(DETECTORS)}", name)
        settings = settings_from(name, _table(request, name), name)
        detector: Any = {"sift": Sift, "must": Must, "symroid": SymRoid}[name]
        found = detector(settings)(photo.pixels)
        points = found.keypoints if name == "symroid" else found
        return {
            "points": points_data(points[:MAX_POINTS]),
            "found": len(points),
            "ms": 1000 * (perf_counter() - began),
            "python": detection_python(name, settings),
            "command": detection_command(photo.name, name, settings),
        }

    def warm_up(self) -> None:
        """Compile what all of it needs."""
        import numpy as np

        held = Photo("", np.random.default_rng(1).random((160, 160, 3), np.float32))
        other = PhotoAnalyzer()
        other._photos[""] = held
        other.analyze({"photo": ""})
        for detector in DETECTORS:
            other.detect({"photo": "", "detector": detector})

    def _photo(self, request: Mapping[str, Any]) -> Photo:
        token = request.get("photo")
        if not isinstance(token, str) or token not in self._photos:
            raise KeyError("the photograph is not held any more; drop it again")
        self._photos.move_to_end(token)
        return self._photos[token]

    def _maps_of(self, photo: Photo, attention: AttentionModel) -> "tuple[Float32Array, list[Any]]":
        """The saliency and all maps as pictures; those of last time where nothing changed."""
        from saccade.viewing.embedding import heat

        if (
            self._last_maps is None
            or self._last_maps[0] is not photo
            or self._last_maps[1] != attention
        ):
            try:
                layers = layers_of(attention.maps(photo.pixels), attention.model)
            except ImageError as error:
                raise ImageError(f"{photo.name}: {error}") from error
            pictures = [{"name": name, "address": heat(each)} for name, each in layers.items()]
            self._last_maps = (photo, attention, (layers["saliency"], pictures))
        found: tuple[Float32Array, list[Any]] = self._last_maps[2]
        return found


def _table(request: Mapping[str, Any], kind: str) -> dict[str, Any]:
    table = request.get(kind, {})
    if not isinstance(table, dict):
        raise ConfigError(f"{kind}: expected settings by name, found {table!r}")
    return table
