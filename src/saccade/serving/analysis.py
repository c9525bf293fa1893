"""Analyzes the photographs of `saccade serve`: saliency, scanpath and interest points."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from saccade import keypoints
from saccade.attention.channels import Channel
from saccade.attention.contrast import (
    ContrastConfig,
    FeatureMap,
    contrast_saliency,
)
from saccade.attention.maps import SaliencyMaps
from saccade.attention.models import AttentionModel
from saccade.attention.scanpath import scanpath
from saccade.errors import ImageError, require
from saccade.io.image import decode_image, read_header
from saccade.scale.pyramid import FloatMap
from saccade.serving.controls import (
    DETECTORS,
    MODELS,
    attention_command,
    attention_python,
    detection_command,
    detection_python,
    read_python,
)
from saccade.serving.recent import Recent
from saccade.settings import settings_from, update_settings
from saccade.types import Float32Array, Image
from saccade.viewing.page import heat, photograph, shrunk
from saccade.viewing.report import maps_data, points_data, scanpath_data

MAX_PHOTOS = 4
"""Photographs kept in memory: the most recently used."""
MAX_PIXELS = 40_000_000
"""Pixels of a photograph."""
MAX_NAME = 200
"""Characters of a photograph's name that are kept."""
MAX_FIXATIONS = 100
"""Length of a scanpath."""
MAX_POINTS = 2000
"""Interest points that are drawn."""
LEVEL_SIDE = 200
"""Pixels of the longer side of a pyramid level on the page."""


class Photo(NamedTuple):
    """A photograph and its name."""

    name: str
    pixels: Float32Array
    """(H, W, 3) in [0, 1]."""


class PhotoAnalyzer:
    """Keeps the most recent photographs in memory and analyzes them."""

    def __init__(self) -> None:
        self.photos: Recent[Photo] = Recent(MAX_PHOTOS, "photograph")
        self._cached_for: tuple[str, AttentionModel] | None = None

    def open(self, data: bytes, name: str) -> dict[str, Any]:
        """Keep a photograph.

        Args:
            data: content of its file.
            name: name of its file.

        Raises:
            ImageError: it is no image, or too large or too small.
        """
        name = name[-MAX_NAME:]
        width, height = read_header(data, name)[:2]
        if width * height > MAX_PIXELS:
            raise ImageError(
                f"{name}: expected at most {MAX_PIXELS / 1e6:g} million pixels, "
                f"found {width} x {height}"
            )
        pixels = decode_image(data, name)
        return {
            "photo": self.photos.add(Photo(name, pixels)),
            "name": name,
            "size": [pixels.shape[1], pixels.shape[0]],
            "image": photograph(pixels),
            "python": read_python(name),
        }

    def analyze(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Saliency maps and scanpath of a photograph.

        Args:
            request: "photo", "model", "fixations", and the settings by kind.

        Raises:
            KeyError: the photograph is not in memory.
            SaccadeError: a setting outside its range.
        """
        photo = self.photos[request.get("photo")]
        model = request.get("model", "attention")
        require(model in list(MODELS), "model", f"one of {', '.join(MODELS)}", model)
        fixations = request.get("fixations", 10)
        is_valid = type(fixations) is int and 1 <= fixations <= MAX_FIXATIONS
        require(is_valid, "fixations", f"1 to {MAX_FIXATIONS}", fixations)
        kind, *parts = MODELS[model]
        settings = settings_from(model, request.get(kind, {}), kind)
        inner = {each: request[each] for each in parts if each in request}
        attention = AttentionModel(update_settings(settings, inner, kind))
        config = settings_from("scanpath", request.get("scanpath", {}), "scanpath")
        found, maps = self._maps(request["photo"], attention)
        path = scanpath(found, config, fixations=fixations)
        choices = (model, attention.settings, config, fixations)
        return {
            "maps": maps,
            "scanpath": scanpath_data(path),
            "python": attention_python(*choices),
            "command": attention_command(photo.name, *choices),
        }

    def features(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Pyramids and feature maps of the contrast model, by channel.

        Args:
            request: "photo" and the settings "contrast".

        Raises:
            KeyError: the photograph is not in memory.
            SaccadeError: a setting outside its range.
        """
        photo = self.photos[request.get("photo")]
        config = settings_from("contrast", request.get("contrast", {}), "contrast")
        with _naming(photo):
            return {"channels": feature_data(photo.pixels, config)}

    def detect(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Interest points of a photograph.

        Args:
            request: "photo", "detector", and its settings.

        Raises:
            KeyError: the photograph is not in memory.
            SaccadeError: a setting outside its range.
        """
        photo = self.photos[request.get("photo")]
        name = request.get("detector", "sift")
        require(name in DETECTORS, "detector", f"one of {', '.join(DETECTORS)}", name)
        settings = settings_from(name, request.get(name, {}), name)
        detected = getattr(keypoints, DETECTORS[name])(settings)(photo.pixels)
        points = detected.keypoints if name == "symroid" else detected
        return {
            "points": points_data(points[:MAX_POINTS]),
            "count": len(points),
            "python": detection_python(name, settings),
            "command": detection_command(photo.name, name, settings),
        }

    def warm_up(self) -> None:
        """Compile everything, so that the first photograph does not have to wait."""
        noise = np.random.default_rng(1).random((160, 160, 3), np.float32)
        analyzer = PhotoAnalyzer()
        token = analyzer.photos.add(Photo("", noise))
        analyzer.analyze({"photo": token})
        for detector in DETECTORS:
            analyzer.detect({"photo": token, "detector": detector})

    def _maps(
        self, token: str, attention: AttentionModel
    ) -> tuple[SaliencyMaps, list[dict[str, str]]]:
        """The maps, and as the page reads them; computed only if a choice changed."""
        if self._cached_for != (token, attention):
            photo = self.photos[token]
            with _naming(photo):
                found = attention.maps(photo.pixels)
            self._cached = found, maps_data(found.layers)
            self._cached_for = (token, attention)
        return self._cached


@contextmanager
def _naming(photo: Photo) -> Iterator[None]:
    """Adds the name of a photograph to errors about it."""
    try:
        yield
    except ImageError as error:
        raise ImageError(f"{photo.name}: {error}") from error


def feature_data(image: Image, config: ContrastConfig) -> list[dict[str, Any]]:
    """What the contrast model computes, by channel, as the page reads it.

    Args:
        image: (H, W, 3).
        config: of the model.

    Returns:
        For each channel its name, the levels of its pyramid (A.1-A.6), its center-surround maps
        (A.7-A.10) and the same after normalization; last the conspicuity maps (A.11-A.13) and the
        saliency (A.14).
    """
    maps = contrast_saliency(image, config, keep_features=True)
    channels = [
        {"name": channel_name(channel), "rows": _rows(levels, maps.features, channel)}
        for channel, levels in maps.pyramids.items()
    ]
    sums = _row("conspicuity", {name: heat(values) for name, values in maps.layers.items()})
    return [*channels, {"name": "all channels", "rows": [sums]}]


def channel_name(channel: Channel) -> str:
    """The name of a channel, with the angle of an orientation."""
    angle = "" if channel.angle is None else f" {channel.angle:g}\N{DEGREE SIGN}"
    return channel.name + angle


def _rows(
    levels: Mapping[int, FloatMap], features: tuple[FeatureMap, ...], channel: Channel
) -> list[dict[str, Any]]:
    own = [each for each in features if each.channel == channel]
    names = [f"{each.center} against {each.surround}" for each in own]
    pyramid = {f"level {number}": _level(level) for number, level in sorted(levels.items())}
    differences = {name: heat(each.values) for name, each in zip(names, own, strict=True)}
    normalized = {name: heat(each.normalized) for name, each in zip(names, own, strict=True)}
    return [
        _row("pyramid", pyramid),
        _row("center against surround", differences),
        _row("normalized", normalized),
    ]


def _row(name: str, addresses: Mapping[str, str]) -> dict[str, Any]:
    """A row of pictures, by name of each."""
    return {"name": name, "maps": [{"name": n, "address": a} for n, a in addresses.items()]}


def _level(level: FloatMap) -> str:
    """A level from its smallest value to its largest: those of opponent colors have signs."""
    small = shrunk(level, LEVEL_SIDE / max(level.shape))
    return heat(small - small.min())
