"""Analyzes the photographs of `saccade serve`: saliency, scanpath and interest points."""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from saccade.attention.models import AttentionModel
from saccade.attention.scanpath import scanpath
from saccade.attention.scanpath_model import most_probable_scanpath
from saccade.errors import ImageError, require
from saccade.io.image import decode_image, read_header
from saccade.keypoints.detectors import DETECTORS, keypoints_of, make_detector
from saccade.serving.controls import (
    MODELS,
    SCANPATHS,
    attention_file,
    detection_file,
)
from saccade.serving.recent import Recent
from saccade.serving.requests import chosen
from saccade.settings import settings_from, update_settings
from saccade.types import Float32Array
from saccade.viewing.page import photograph
from saccade.viewing.report import maps_data, points_data, scanpath_data

MAX_FILE_BYTES = 512_000_000
"""Maximum size of all photographs in memory, as files; least recently used dropped first."""
MAX_DECODED_PIXELS = 80_000_000
"""Maximum number of pixels of the decoded photographs in memory; others are decoded again."""
MAX_PIXELS = 40_000_000
"""Maximum number of pixels of a photograph."""
MAX_NAME = 200
"""Maximum length of a photograph's name."""
MAX_FIXATIONS = 100
"""Maximum length of a scanpath."""
MAX_POINTS = 2000
"""Maximum number of interest points drawn."""


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph as a file, and its name."""

    name: str
    data: bytes
    """Content of the file."""


class PhotoAnalyzer:
    """Keeps the most recent photographs in memory and analyzes them.

    Files are kept, of which hundreds fit into memory, so that a photograph outlives those that
    others open meanwhile; the last ones are kept decoded too.
    """

    def __init__(self) -> None:
        self.photos: Recent[Photo] = Recent(
            MAX_FILE_BYTES, "photograph", lambda photo: len(photo.data)
        )
        self._decoded: OrderedDict[Photo, Float32Array] = OrderedDict()
        self._cached_for: tuple[Photo, AttentionModel] | None = None

    def open(self, data: bytes, name: str) -> dict[str, Any]:
        """Stores a photograph.

        Args:
            data: content of the file.
            name: name of the file.

        Raises:
            ImageError: the data is not an image, or is too large or too small.
        """
        name = name[-MAX_NAME:]
        width, height = read_header(data, name)[:2]
        if width * height > MAX_PIXELS:
            raise ImageError(
                f"{name}: expected at most {MAX_PIXELS / 1e6:g} million pixels, "
                f"found {width} x {height}"
            )
        photo = Photo(name, data)
        pixels = self._pixels(photo)
        return {
            "photo": self.photos.add(photo),
            "name": name,
            "size": [pixels.shape[1], pixels.shape[0]],
            "image": photograph(pixels),
        }

    def _pixels(self, photo: Photo) -> Float32Array:
        """(H, W, 3) in [0, 1]: the decoded photograph."""
        if photo not in self._decoded:
            self._decoded[photo] = decode_image(photo.data, photo.name)
        self._decoded.move_to_end(photo)
        total = sum(each.size // 3 for each in self._decoded.values())
        while total > MAX_DECODED_PIXELS and len(self._decoded) > 1:
            total -= self._decoded.popitem(last=False)[1].size // 3
        return self._decoded[photo]

    def analyze(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Saliency maps and scanpath of a photograph.

        Args:
            request: "photo", "model", "fixations", "path", and the settings by kind.

        Raises:
            KeyError: the photograph is not in memory.
            SaccadeError: a setting outside its range.
        """
        photo = self.photos[request.get("photo")]
        model = chosen(request, "model", MODELS)
        fixations = request.get("fixations", 10)
        is_valid = type(fixations) is int and 1 <= fixations <= MAX_FIXATIONS
        require(is_valid, "fixations", f"1 to {MAX_FIXATIONS}", fixations)
        method = chosen(request, "path", SCANPATHS)
        kind, *parts = MODELS[model]
        settings = settings_from(model, request.get(kind, {}), kind)
        inner = {each: request[each] for each in parts if each in request}
        for group in (request.get(kind, {}), *inner.values()):
            names_only(group)
        attention = AttentionModel(update_settings(settings, inner, kind))
        table = SCANPATHS[method]
        config = settings_from(table, request[table], table) if table in request else None
        if self._cached_for != (photo, attention):
            try:
                found = attention.maps(self._pixels(photo))
            except ImageError as error:
                raise ImageError(f"{photo.name}: {error}") from error
            self._cached, self._cached_for = (found, maps_data(found.layers)), (photo, attention)
        found, maps = self._cached
        follow = most_probable_scanpath if table == "scanpath-model" else scanpath
        path = follow(found, config, fixations=fixations)
        return {
            "maps": maps,
            "scanpath": scanpath_data(path),
            "file": attention_file(model, attention.settings, fixations, method),
        }

    def detect(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Interest points of a photograph.

        Args:
            request: "photo", "detector", and its settings.

        Raises:
            KeyError: the photograph is not in memory.
            SaccadeError: a setting outside its range.
        """
        photo = self.photos[request.get("photo")]
        name = chosen(request, "detector", DETECTORS)
        settings = settings_from(name, request.get(name, {}), name)
        points = keypoints_of(make_detector(name, settings)(self._pixels(photo)))
        return {
            "points": points_data(points[:MAX_POINTS]),
            "count": len(points),
            "file": detection_file(name, settings),
        }

    def warm_up(self) -> None:
        """Compiles all kernels, so that the first photograph does not have to wait."""
        noise = np.random.default_rng(1).integers(0, 255, (160, 160, 3), np.uint8)
        analyzer = PhotoAnalyzer()
        token = analyzer.open(cv2.imencode(".png", noise)[1].tobytes(), "noise")["photo"]
        analyzer.analyze({"photo": token})
        for detector in DETECTORS:
            analyzer.detect({"photo": token, "detector": detector})


def names_only(group: Any) -> None:
    """Raises `ConfigError` for module:function in place of a name: a page may import no module."""
    for name, value in group.items() if isinstance(group, Mapping) else ():
        require(not (isinstance(value, str) and ":" in value), name, "a name of the table", value)
