"""What looks at the photographs of `saccade serve`."""

import secrets
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

from saccade.attention.models import KINDS, Attention, layers_of
from saccade.errors import ConfigError, ImageError, require
from saccade.serving.controls import DETECTORS, MODELS

if TYPE_CHECKING:
    from saccade.types import Float32Array

HELD = 4
"""Photographs that are kept in memory, those that were used last."""
MOST_PIXELS = 40_000_000
"""Of a photograph."""
MOST_FIXATIONS = 100
MOST_POINTS = 2000
"""Interest points that are drawn."""
NAME = 200
"""Letters of a name that are kept."""


@dataclass(frozen=True)
class Photo:
    """A photograph and what it is called."""

    name: str
    pixels: "Float32Array"
    """(H, W, 3) in [0, 1]."""


class Workbench:
    """Holds the last few photographs, and looks at them; see `saccade.serving.app.Bench`."""

    def __init__(self) -> None:
        self._photos: OrderedDict[str, Photo] = OrderedDict()
        self._seen: tuple[Photo, Attention, Any] | None = None

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
        from saccade.viewing.report_image import photograph

        name = name[-NAME:]
        width, height = size_in_header(data, name)
        if width * height > MOST_PIXELS:
            raise ImageError(
                f"{name}: expected at most {MOST_PIXELS / 1e6:g} million pixels, "
                f"found {width} x {height}"
            )
        pixels = decode_image(data, name)
        token = secrets.token_urlsafe(12)
        self._photos[token] = Photo(name, pixels)
        while len(self._photos) > HELD:
            self._photos.popitem(last=False)
        return {
            "photo": token,
            "name": name,
            "size": [pixels.shape[1], pixels.shape[0]],
            "image": photograph(pixels),
            "python": read_python(name),
        }

    def look(self, wishes: Mapping[str, Any]) -> dict[str, Any]:
        """Where a photograph draws the eye.

        Args:
            wishes: "photo", "model", "fixations", and by kind the settings that count.

        Raises:
            KeyError: the photograph is not held.
            SaccadeError: a wish that cannot be granted.
        """
        from saccade.attention.scanpath import scanpath
        from saccade.serving.snippets import look_command, look_python
        from saccade.settings import settings_from
        from saccade.viewing.report_image import scanpath_data

        began = perf_counter()
        photo = self._photo(wishes)
        model = wishes.get("model", "both")
        require(model in list(MODELS), "model", f"one of {', '.join(MODELS)}", model)
        fixations = wishes.get("fixations", 10)
        fits = type(fixations) is int and 1 <= fixations <= MOST_FIXATIONS
        require(fits, "fixations", f"1 to {MOST_FIXATIONS}", fixations)
        outer, *inner = MODELS[model]
        table = _table(wishes, outer) | {kind: _table(wishes, kind) for kind in inner}
        attention = Attention(model, settings_from(KINDS[model], table, outer))
        config = settings_from("scanpath", _table(wishes, "scanpath"), "scanpath")
        saliency, maps = self._maps_of(photo, attention)
        path = scanpath(saliency, photo.pixels.shape, fixations, config)
        of = (attention.model, attention.settings, config, fixations)
        return {
            "maps": maps,
            "scanpath": scanpath_data(path),
            "ms": 1000 * (perf_counter() - began),
            "python": look_python(*of),
            "command": look_command(photo.name, *of),
        }

    def find(self, wishes: Mapping[str, Any]) -> dict[str, Any]:
        """Interest points of a photograph.

        Args:
            wishes: "photo", "detector", and the settings of that.

        Raises:
            KeyError: the photograph is not held.
            SaccadeError: a wish that cannot be granted.
        """
        from saccade.keypoints import Must, Sift, SymRoid
        from saccade.serving.snippets import find_command, find_python
        from saccade.settings import settings_from
        from saccade.viewing.report_image import points_data

        began = perf_counter()
        photo = self._photo(wishes)
        name = wishes.get("detector", "sift")
        require(name in DETECTORS, "detector", f"one of {', '.join(DETECTORS)}", name)
        settings = settings_from(name, _table(wishes, name), name)
        detector: Any = {"sift": Sift, "must": Must, "symroid": SymRoid}[name]
        found = detector(settings)(photo.pixels)
        points = found.keypoints if name == "symroid" else found
        return {
            "points": points_data(points[:MOST_POINTS]),
            "found": len(points),
            "ms": 1000 * (perf_counter() - began),
            "python": find_python(name, settings),
            "command": find_command(photo.name, name, settings),
        }

    def warm(self) -> None:
        """Compile what all of it needs."""
        import numpy as np

        held = Photo("", np.random.default_rng(1).random((160, 160, 3), np.float32))
        other = Workbench()
        other._photos[""] = held
        other.look({"photo": ""})
        for detector in DETECTORS:
            other.find({"photo": "", "detector": detector})

    def _photo(self, wishes: Mapping[str, Any]) -> Photo:
        token = wishes.get("photo")
        if not isinstance(token, str) or token not in self._photos:
            raise KeyError("the photograph is not held any more; drop it again")
        self._photos.move_to_end(token)
        return self._photos[token]

    def _maps_of(self, photo: Photo, attention: Attention) -> "tuple[Float32Array, list[Any]]":
        """The saliency and all maps as pictures; those of last time where nothing changed."""
        from saccade.viewing.report_image import heat

        if self._seen is None or self._seen[0] is not photo or self._seen[1] != attention:
            try:
                layers = layers_of(attention.maps(photo.pixels), attention.model)
            except ImageError as error:
                raise ImageError(f"{photo.name}: {error}") from error
            pictures = [{"name": name, "address": heat(each)} for name, each in layers.items()]
            self._seen = (photo, attention, (layers["saliency"], pictures))
        found: tuple[Float32Array, list[Any]] = self._seen[2]
        return found


def _table(wishes: Mapping[str, Any], kind: str) -> dict[str, Any]:
    table = wishes.get(kind, {})
    if not isinstance(table, dict):
        raise ConfigError(f"{kind}: expected settings by name, found {table!r}")
    return table
