"""`saccade evaluate features`: repeatability and matching on pairs with known homography."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from saccade.cli.detectors import NAMES, OURS, find_detector
from saccade.cli.options import Json, Preset, Report, Settings

SHOWN = {
    "found again": ("repeatability",),
    "error [px]": ("localization",),
    "MMA@1/3/5": ("mma_1", "mma_3", "mma_5"),
    "ratio@1/3/5": ("ratio_1", "ratio_3", "ratio_5"),
    "score": ("score",),
    "AUC@1/3/5/10": ("auc_1", "auc_3", "auc_5", "auc_10"),
}
"""Columns of the table, and the scores in them."""

MEANING = (
    "Found again: share of the points in view in both images that are found in the other; error: "
    "their distance from where they should be. MMA: share of right matches among mutual nearest "
    "neighbors within 1, 3 and 5 px; ratio: among those that pass the ratio test. Score: right "
    "matches of all points in view. AUC: how exactly the matches tell where the corners of the "
    "image are in the other. More is better, but of the error."
)

CLEAN = "clean"
"""No disturbance."""


def features(
    pairs: Annotated[
        Path, typer.Option(help="Folder of sequences: 1.png, 2.png, H_1_2.txt and so on.")
    ],
    detector: Annotated[
        list[str] | None,
        typer.Option(help=f"{', '.join(NAMES)}, or module:callable; may be repeated."),
    ] = None,
    preset: Preset = None,
    config: Settings = None,
    points: Annotated[
        list[int] | None,
        typer.Option(
            min=1,
            help="Only so many places of each image, the strongest, COLMAP's largest; "
            "may be repeated.",
        ),
    ] = None,
    disturb: Annotated[
        list[str] | None,
        typer.Option(
            help="What is done to the second image of each pair: noise:20 (grey levels), "
            "contrast:0.5, blur:2 (px) or clean; may be repeated."
        ),
    ] = None,
    radius: Annotated[
        float, typer.Option(min=0.1, max=100, help="Pixels within which a point is found again.")
    ] = 3.0,
    ratio: Annotated[float, typer.Option(min=0.01, max=1, help="Of the ratio test.")] = 0.8,
    per_sequence: Annotated[bool, typer.Option(help="Also show every sequence.")] = False,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Score interest points on pairs of images of one plane.

    Repeatability ("found again"), localization error, matching accuracy of mutual nearest
    neighbors at 1, 3 and 5 px without and with the ratio test, matching score, and the area under
    the curve of the homography's corner error; means over the pairs with 95 % bootstrap intervals.
    With --points our own detectors have no threshold, so that there are so many also where
    contrast is low; OpenCV's and COLMAP's keep theirs. A module:callable takes an (H, W, 3) image
    in [0, 1] and gives an object with xy and descriptors, the strongest first.
    """
    from saccade.cli.output import print_json, print_table
    from saccade.cli.report_builder import Table, write_table_page
    from saccade.datasets.homography_pairs import homography_pairs
    from saccade.evaluation.degradation import Degradation

    found = homography_pairs(pairs)
    sequences = list(dict.fromkeys(pair.sequence for pair in found))
    disturbances = [
        None if text == CLEAN else Degradation.parse(text) for text in disturb or [CLEAN]
    ]
    counts: Sequence[int | None] = points or [None]
    results: dict[str, Any] = {}
    for name in detector or ["sift"]:
        label = f"{name} {preset}" if name in OURS and preset else name
        detect = find_detector(name, preset, config, max(points) if points else None)
        for disturbance in disturbances:
            scored = _score(name, detect, found, ratio, counts, disturbance, radius)
            for count, result in zip(counts, scored, strict=True):
                words = [label, f"{count} points" if count else "", str(disturbance or "")]
                results[", ".join(filter(None, words))] = result
    title = f"{len(found)} pairs in {len(sequences)} sequences, within {radius:g} px"
    columns = ["", "points", *SHOWN]
    lead = f"How well interest points are found again and matched: {title}."
    means, every = _rows(results, []), _rows_of(results, sequences)
    write_table_page(
        report,
        "saccade evaluate features",
        lead,
        [
            Table("Mean over the pairs", columns, _named(means), MEANING, "detector"),
            Table("Each sequence", columns, every, first="detector, sequence"),
        ],
    )
    if as_json:
        print_json(
            {
                "pairs": len(found),
                "detectors": {
                    label: _as_json(result, sequences) for label, result in results.items()
                },
            }
        )
        return
    print_table(title, columns, _rows(results, sequences) if per_sequence else means)


def _rows(results: dict[str, Any], sequences: list[str]) -> list[list[str]]:
    """Of each detector the mean and its interval, and the mean of some sequences."""
    rows = []
    for label, result in results.items():
        mean, (low, high) = result.mean(), result.interval()
        rows += [_row(label, mean), _row("  95 % from", low), _row("  95 % to", high)]
        rows += [_row(f"  {each}", result.of(each).mean()) for each in sequences]
    return rows


def _rows_of(results: dict[str, Any], sequences: list[str]) -> list[list[str]]:
    """Of each detector the mean of each sequence."""
    return [
        _row(f"{label}, {each}", result.of(each).mean())
        for label, result in results.items()
        for each in sequences
    ]


def _named(rows: list[list[str]]) -> list[list[str]]:
    """Rows that say whose they are, in whatever order they are read."""
    named, owner = [], ""
    for name, *cells in rows:
        owner = owner if name.startswith(" ") else name
        named.append([f"{owner}, {name.strip()}" if name.startswith(" ") else name, *cells])
    return named


def _as_json(result: Any, sequences: list[str]) -> dict[str, Any]:
    from dataclasses import asdict

    low, high = result.interval()
    return {
        "mean": asdict(result.mean()),
        "low": asdict(low),
        "high": asdict(high),
        "sequences": {each: asdict(result.of(each).mean()) for each in sequences},
    }


def _score(
    name: str,
    detect: Callable[[Any], Any],
    found: Any,
    ratio: float,
    counts: Sequence[int | None],
    disturbance: Any,
    radius: float,
) -> list[Any]:
    """The scores of a detector by number of points; every image is looked at once."""
    from saccade.cli.output import tracked
    from saccade.evaluation.features import FeatureScores, score_pairs
    from saccade.image import read_image
    from saccade.keypoints.matching import nearest_neighbors

    seen: dict[tuple[str, int | None], Any] = {}

    def features_of(key: tuple[str, int | None]) -> Any:
        """The places of an image; a number says that it is disturbed, and seeds the noise."""
        if key not in seen:
            path, seed = key
            image = read_image(path)
            if disturbance is not None and seed is not None:
                image = disturbance.apply(image, seed)
            seen[key] = _as_features(name, detect(image), image.shape[:2])
        return seen[key]

    images = [
        ((str(pair.first), None), (str(pair.second), number), pair.homography)
        for number, pair in enumerate(found)
    ]
    names = [(pair.sequence, pair.second.stem) for pair in found]
    table: list[list[Any]] = [[] for _ in counts]
    for image in tracked(images, f"{name} {disturbance or ''}", len(images)):
        for scores, count in zip(table, counts, strict=True):

            def strongest(key: Any, count: int | None = count) -> Any:
                return features_of(key).strongest(count)

            scores += score_pairs(strongest, [image], nearest_neighbors, ratio, radius)
        del seen[image[1]]
    return [FeatureScores(names, scores) for scores in table]


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


def _row(name: str, scores: Any) -> list[str]:
    cells = [
        " ".join(f"{getattr(scores, field):.3f}".removeprefix("0") for field in fields)
        for fields in SHOWN.values()
    ]
    return [name, f"{scores.keypoints:.0f}", *cells]
