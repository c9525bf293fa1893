"""`saccade evaluate features`: repeatability and matching on pairs with known homography."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from saccade.cli.options import Json, Preset, Settings

SHOWN = {
    "rep@3": ("repeatability",),
    "err px": ("localization",),
    "MMA@1/3/5": ("mma_1", "mma_3", "mma_5"),
    "ratio@1/3/5": ("ratio_1", "ratio_3", "ratio_5"),
    "score": ("score",),
    "AUC@1/3/5/10": ("auc_1", "auc_3", "auc_5", "auc_10"),
}
"""Columns of the table, and the scores in them."""

UNCAPPED = 1_000_000
"""Points: COLMAP's default of 8192 would leave out some of the images with most."""


def features(
    pairs: Annotated[
        Path, typer.Option(help="Folder of sequences: 1.png, 2.png, H_1_2.txt and so on.")
    ],
    detector: Annotated[
        list[str] | None,
        typer.Option(help="sift (ours), opencv, colmap, or module:callable; may be repeated."),
    ] = None,
    preset: Preset = None,
    config: Settings = None,
    ratio: Annotated[float, typer.Option(min=0.01, max=1, help="Of the ratio test.")] = 0.8,
    per_sequence: Annotated[bool, typer.Option(help="Also show every sequence.")] = False,
    as_json: Json = False,
) -> None:
    """Score interest points on pairs of images of one plane.

    Repeatability at 3 px, localization error, matching accuracy of mutual nearest neighbors at
    1, 3 and 5 px without and with the ratio test, matching score, and the area under the curve
    of the homography's corner error; means over the pairs with 95 % bootstrap intervals.
    A module:callable takes an (H, W, 3) image in [0, 1] and gives an object with xy and
    descriptors.
    """
    from dataclasses import asdict

    from saccade.cli.output import print_json, print_table
    from saccade.datasets.homography_pairs import homography_pairs

    found = homography_pairs(pairs)
    sequences = list(dict.fromkeys(pair.sequence for pair in found))
    rows, results = [], {}
    for name in detector or ["sift"]:
        detect = find_detector(name, preset, config)
        result = _score(name, detect, found, ratio)
        mean, (low, high) = result.mean(), result.interval()
        label = f"{name} {preset}" if name == "sift" and preset else name
        rows += [_row(label, mean), _row("  95 % from", low), _row("  to", high)]
        if per_sequence:
            rows += [_row(f"  {each}", result.of(each).mean()) for each in sequences]
        results[label] = {
            "mean": asdict(mean),
            "low": asdict(low),
            "high": asdict(high),
            "sequences": {each: asdict(result.of(each).mean()) for each in sequences},
        }
    if as_json:
        print_json({"pairs": len(found), "detectors": results})
        return
    print_table(f"{len(found)} pairs in {len(sequences)} sequences", ["", "points", *SHOWN], rows)


def find_detector(name: str, preset: str | None, config: Path | None) -> Callable[[Any], Any]:
    """A detector: from an (H, W, 3) image in [0, 1] to an object with xy and descriptors.

    Raises:
        ConfigError: there is none of this name, or what it needs is not installed.
    """
    from saccade.errors import ConfigError

    if name == "sift":
        from saccade.cli.detect import make_detector

        return make_detector(preset, config, None)
    if name == "opencv":
        return _opencv()
    if name == "colmap":
        return _colmap()
    if ":" in name:
        return _imported(name)
    raise ConfigError(f"detector: expected sift, opencv, colmap or module:callable, found {name!r}")


def _score(name: str, detect: Callable[[Any], Any], found: Any, ratio: float) -> Any:
    from saccade.cli.output import tracked
    from saccade.evaluation.features import FeatureScores, score_pairs
    from saccade.image import read_image
    from saccade.keypoints.matching import nearest_neighbors

    def features_of(path: str) -> Any:
        image = read_image(path)
        return _as_features(name, detect(image), image.shape[:2])

    images = [(str(pair.first), str(pair.second), pair.homography) for pair in found]
    scores = score_pairs(features_of, images, nearest_neighbors, ratio)
    names = [(pair.sequence, pair.second.stem) for pair in found]
    return FeatureScores(names, list(tracked(scores, name, len(found))))


def _as_features(name: str, points: Any, shape: tuple[int, int]) -> Any:
    import numpy as np

    from saccade.errors import ConfigError
    from saccade.evaluation.repeatability import Features

    xy, descriptors = getattr(points, "xy", None), getattr(points, "descriptors", None)
    if xy is None or descriptors is None:
        raise ConfigError(
            f"{name}: expected an object with xy and descriptors, found {type(points).__name__}"
        )
    xy, descriptors = np.asarray(xy, np.float64), np.asarray(descriptors)
    if xy.ndim != 2 or xy.shape[1] != 2 or descriptors.ndim != 2 or len(xy) != len(descriptors):
        raise ConfigError(
            f"{name}: expected xy (n, 2) and descriptors (n, d), "
            f"found {xy.shape} and {descriptors.shape}"
        )
    return Features(xy, descriptors, shape)


def _opencv() -> Callable[[Any], Any]:
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
        xy = np.array([point.pt for point in points])
        return SimpleNamespace(xy=xy, descriptors=descriptors.astype(np.uint8))

    return detect


def _colmap() -> Callable[[Any], Any]:
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
        # Its first pixel's centre is (0.5, 0.5).
        xy = np.array([(point.x, point.y) for point in points]).reshape(-1, 2) - 0.5
        return SimpleNamespace(xy=xy, descriptors=descriptors.data)

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


def _row(name: str, scores: Any) -> list[str]:
    cells = [
        " ".join(f"{getattr(scores, field):.3f}".removeprefix("0") for field in fields)
        for fields in SHOWN.values()
    ]
    return [name, f"{scores.keypoints:.0f}", *cells]
