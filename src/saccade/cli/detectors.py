"""The detectors that a command line can name: ours, peers, and those of the user."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

NAMES = ("sift", "must", "symroid", "sift-random", "sift-salient", "opencv", "colmap")
"""Besides module:callable."""
OURS = NAMES[:3]
NO_THRESHOLD = 1e-4
"""Of the response, for images in [0, 1]: what is under it is rounding."""
DUPLICATES = 2
"""Points to a place, about: a place may have several directions."""
WEAK_REGION = 1e-3
"""Threshold of regions by the strongest, where weak ones count too."""
UNCAPPED = 1_000_000
"""Points: COLMAP's default of 8192 would leave out some of the images with most."""
SEED = 2010
"""Of the points that are chosen at random."""


def find_detector(
    name: str, preset: str | None, config: Path | None, most: int | None = None
) -> Callable[[Any], Any]:
    """A detector: from an (H, W, 3) image in [0, 1] to an object with xy and descriptors.

    The points come strongest first, COLMAP's largest first, those of a callable as it gives them.

    Args:
        name: one of `NAMES`, or module:callable.
        preset: of ours.
        config: likewise.
        most: how many places are wanted of ours, whatever their strength; None for those that
            are strong enough.

    Raises:
        ConfigError: there is none of this name, or what it needs is not installed.
    """
    from saccade.errors import ConfigError

    if name in OURS:
        made = make_detector(name, preset, config, most and DUPLICATES * most, weak=bool(most))
        return cast("Callable[[Any], Any]", made)
    if name in ("sift-random", "sift-salient"):
        sift = make_detector("sift", preset, config, None)
        return _in_random_order(sift) if name == "sift-random" else _by_saliency(sift)
    if name == "opencv":
        return _opencv()
    if name == "colmap":
        return _colmap()
    if ":" in name:
        return _imported(name)
    raise ConfigError(f"detector: expected {', '.join(NAMES)} or module:callable, found {name!r}")


def make_detector(
    name: str,
    preset: str | None,
    config: Path | None,
    most: int | None,
    *,
    spread: bool = False,
    weak: bool = False,
) -> Any:
    """A `Sift`, `Must` or `SymRoid` from the options of the command line.

    Args:
        name: one of `OURS`.
        preset: see `load_settings`.
        config: likewise.
        most: how many points to keep; None for as the configuration says.
        spread: whether those that spread over the image.
        weak: whether weak ones count too.

    Raises:
        ConfigError: a setting that the detector does not have.
    """
    from dataclasses import replace

    from saccade.errors import require
    from saccade.keypoints import Must, Sift, SymRoid
    from saccade.settings import load_settings

    settings = load_settings(name, preset, config)
    if most is not None:
        settings = replace(settings, max_keypoints=most)
    if name == "symroid":
        require(not spread, "spread", "a detector of points", name)
        return SymRoid(replace(settings, seed_threshold=WEAK_REGION) if weak else settings)
    if spread:
        settings = replace(settings, spread=True)
    if weak:
        settings = replace(settings, contrast_threshold=NO_THRESHOLD)
    return {"sift": Sift, "must": Must}[name](settings)


def _in_random_order(sift: Any) -> Callable[[Any], Any]:
    import numpy as np

    def detect(image: Any) -> Any:
        points = sift(image)
        return points[np.random.default_rng(SEED).permutation(len(points))]

    return detect


def _by_saliency(sift: Any) -> Callable[[Any], Any]:
    """SIFT's points, first those at the highest values of the attention map."""
    import numpy as np

    from saccade.attention import attention_saliency
    from saccade.pyramid import resize

    def detect(image: Any) -> Any:
        points = sift(image)
        saliency = resize(attention_saliency(image).saliency, image.shape[:2])
        column, row = np.rint(points.xy).astype(np.int64).T
        return points[np.argsort(-saliency[row, column], kind="stable")]

    return detect


def _opencv() -> Callable[[Any], Any]:
    """OpenCV's SIFT as it is installed; it gives its points by place, hence the sorting."""
    from types import SimpleNamespace

    import cv2
    import numpy as np

    from saccade.image import as_gray

    sift = cv2.SIFT.create()

    def detect(image: Any) -> Any:
        points, descriptors = sift.detectAndCompute(
            np.rint(as_gray(image) * 255).astype("u1"), None
        )
        if not points:
            return SimpleNamespace(xy=np.zeros((0, 2)), descriptors=np.zeros((0, 128)))
        order = np.argsort([-point.response for point in points], kind="stable")
        xy = np.array([point.pt for point in points])[order]
        return SimpleNamespace(xy=xy, descriptors=descriptors[order].astype(np.uint8))

    return detect


def _colmap() -> Callable[[Any], Any]:
    """COLMAP's SIFT, the largest first: it has no responses, and of too many keeps the largest."""
    from types import SimpleNamespace

    import numpy as np

    from saccade.exchange.colmap import import_pycolmap
    from saccade.image import as_gray

    pycolmap = import_pycolmap()
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features = UNCAPPED
    sift = pycolmap.FeatureExtractor.create(options)

    def detect(image: Any) -> Any:
        gray = np.ascontiguousarray(as_gray(image), np.float32)
        points, descriptors = sift.extract_from_float32_array(gray)
        order = np.argsort([-point.compute_scale() for point in points], kind="stable")
        # Its first pixel's centre is (0.5, 0.5).
        xy = np.array([(point.x, point.y) for point in points]).reshape(-1, 2)[order] - 0.5
        return SimpleNamespace(xy=xy, descriptors=descriptors.data[order])

    return detect


def _imported(name: str) -> Callable[[Any], Any]:
    from importlib import import_module

    from saccade.errors import ConfigError

    module, _, path = name.partition(":")
    try:
        found: Any = import_module(module)
        for part in path.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"detector: {name}: {error}") from error
    if not callable(found):
        raise ConfigError(f"detector: {name}: expected a callable, found {type(found).__name__}")
    return cast("Callable[[Any], Any]", found)
