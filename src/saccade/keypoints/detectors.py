"""The table of detectors, and users' own functions in their place."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pkgutil import resolve_name
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ConfigError, KeypointsError, Settings, require
from saccade.extras import import_function, name_of
from saccade.io.keypoint_fields import FIELDS, keypoints_from
from saccade.keypoints.must_config import MustConfig, SymRoidConfig
from saccade.keypoints.sift_config import SiftConfig
from saccade.types import BoolArray, Image, Keypoints, Regions

Detections: TypeAlias = Keypoints | Regions


@dataclass(frozen=True)
class Detector:
    """A detector in the table."""

    summary: str
    """What it finds, for help texts."""
    path: str
    """module:Class of a callable `Class(settings, threads=)(image, mask)` that returns `Keypoints`
    or `Regions`; keypoints without descriptors are described by SIFT. It is imported at its first
    use."""
    settings: type[Settings]
    """Class of its settings, with a field `max_keypoints`."""
    threshold: str
    """Setting that is its threshold."""
    lowest_threshold: float | None = None
    """Value of the threshold that keeps every keypoint, for detection by number."""
    gives_regions: bool = False
    """Whether it returns `Regions`."""

    def by_number(self, settings: Any, max_keypoints: int) -> Any:
        """Settings that keep the strongest keypoints, however weak."""
        limits = {"max_keypoints": max_keypoints, self.threshold: self.lowest_threshold}
        chosen: Any = settings or self.settings()
        return replace(chosen, **limits)


DETECTORS: Mapping[str, Detector] = {
    "sift": Detector(
        "SIFT keypoints",
        "saccade.keypoints.sift:Sift",
        SiftConfig,
        "contrast_threshold",
    ),
    "must": Detector(
        "points of symmetry",
        "saccade.keypoints.must:Must",
        MustConfig,
        "contrast_threshold",
    ),
    "symroid": Detector(
        "regions of symmetry",
        "saccade.keypoints.symroid:SymRoid",
        SymRoidConfig,
        "seed_threshold",
        lowest_threshold=1e-3,
        gives_regions=True,
    ),
}
"""Detectors by name, which is also the name of their settings; the first is the default."""
DEFAULT_DETECTOR = next(iter(DETECTORS))
OWN = "module:function"
"""Form of the name of a user's function."""


class Detect(Protocol):
    """A detector with its settings."""

    def __call__(self, image: Image, mask: npt.ArrayLike | None = None) -> Detections:
        """Described keypoints or regions where the (H, W) mask is not zero."""


def make_detector(
    detector: str | Callable[..., Any],
    settings: Any = None,
    *,
    max_keypoints: int | None = None,
    threads: int | None = None,
) -> Detect:
    """The detector of a name, or of a user's function.

    Args:
        detector: a name in `DETECTORS`; or a function, or its name as module:function, from an
            image (H, W, 3) to `Keypoints`, `Regions` or any object with `xy` (n, 2) and, if it
            has them, `size`, `angle`, `response` (n,) and `descriptors` (n, d), strongest first.
            Without descriptors SIFT describes the points, along their angles or, if they are all
            0, along their dominant orientations.
        settings: of a detector in the table; None for the default.
        max_keypoints: number of keypoints to keep, the strongest; None for all.
        threads: of a detector in the table; None for one per core.

    Raises:
        ConfigError: an unknown detector, or settings for a function.
    """
    row = DETECTORS.get(detector) if isinstance(detector, str) else None
    if row is None:
        function = own_function(detector)
        given = f"no settings for {name_of(function)}"
        require(settings is None, "detector", given, settings)
    else:
        settings = row.settings() if settings is None else settings
        if max_keypoints is not None:
            settings = replace(settings, max_keypoints=max_keypoints)
        max_keypoints = settings.max_keypoints
        function = resolve_name(row.path)(settings, threads=threads)
    name = name_of(detector)

    def detect(image: Image, mask: npt.ArrayLike | None = None) -> Detections:
        if row is not None:
            found = function(image, mask)
            return found if isinstance(found, Regions) else described(found, image, max_keypoints)
        return own_detections(function, image, name, mask, max_keypoints)

    return detect


def own_detections(
    function: Callable[..., Any],
    image: Image,
    name: str,
    mask: npt.ArrayLike | None = None,
    max_keypoints: int | None = None,
) -> Detections:
    """The described detections of a user's function where a mask and the alpha channel allow them.

    Raises:
        ConfigError: the function fails, or returns no detections.
    """
    from saccade.io.preparation import opaque_part  # slow to import

    colors, opaque = opaque_part(image)
    detections = as_detections(call(function, colors, name), name)
    for each in (mask, opaque):
        if each is not None:
            detections = kept(detections, np.flatnonzero(inside(detections.xy, each, colors)))
    detections = kept(detections, slice(max_keypoints))
    return (
        detections
        if isinstance(detections, Regions)
        else described(detections, colors, max_keypoints)
    )


def own_function(detector: str | Callable[..., Any]) -> Callable[..., Any]:
    """The user's function, given itself or as module:function.

    Raises:
        ConfigError: it cannot be imported, or a name without a module is in no table.
    """
    if not isinstance(detector, str):
        require(callable(detector), "detector", "a name or a function", detector)
        return detector
    require(":" in detector, "detector", f"one of {', '.join(DETECTORS)} or {OWN}", detector)
    return import_function("detector", detector)


def call(function: Callable[..., Any], image: Image, name: str) -> Any:
    """The result of a user's function.

    Raises:
        ConfigError: the function fails.
    """
    try:
        return function(image)
    except Exception as error:  # whatever the user's function raises
        raise ConfigError(f"{name}: failed: {type(error).__name__}: {error}") from error


def as_detections(found: Any, name: str) -> Detections:
    """Validates what a user's function returns.

    Raises:
        ConfigError: no object with `xy`, or other shapes or numbers.
    """
    if isinstance(found, Regions):
        return found
    if getattr(found, "xy", None) is None:
        kind = type(found).__name__
        raise ConfigError(f"{name}: expected an object with xy and descriptors, found {kind}")
    fields = {field: getattr(found, field, None) for field in FIELDS}
    try:
        return keypoints_from(name, found.xy, getattr(found, "descriptors", None), **fields)
    except KeypointsError as error:
        raise ConfigError(str(error)) from error


def described(keypoints: Keypoints, image: Image, count: int | None) -> Keypoints:
    """The keypoints, described by SIFT if they have no descriptors; then at most `count`.

    SIFT makes a keypoint of each dominant orientation of a point.
    """
    if keypoints.descriptors is not None:
        return keypoints
    from saccade.keypoints.sift import Sift  # slow to import

    return Sift().describe(image, keypoints, orient=not keypoints.angle.any())[:count]


def inside(xy: npt.ArrayLike, mask: npt.ArrayLike, image: Image) -> BoolArray:
    """(n,) whether the pixel nearest to each position is set in a mask of the image's shape."""
    from saccade.io.preparation import check_mask  # slow to import

    set_pixels = check_mask(mask, np.shape(image)[:2])
    columns, rows = np.rint(np.asarray(xy, np.float64)).astype(np.int64).reshape(-1, 2).T
    height, width = set_pixels.shape
    chosen: BoolArray = set_pixels[rows.clip(0, height - 1), columns.clip(0, width - 1)]
    return chosen


def kept(detections: Detections, index: Any) -> Detections:
    """The detections that an index array or a slice selects."""
    if isinstance(detections, Regions):
        return Regions(detections.keypoints[index], detections.boxes[index])
    return detections[index]


def keypoints_of(detections: Detections) -> Keypoints:
    """The detections as keypoints, of regions those of their centers."""
    return detections.keypoints if isinstance(detections, Regions) else detections


def summaries() -> str:
    """The detectors and what they find, for help texts."""
    rows = (f"{name} ({row.summary})" for name, row in DETECTORS.items())
    return f"{', '.join(rows)} or {OWN}"
