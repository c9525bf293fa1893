"""`saccade evaluate features`: repeatability and matching on image pairs."""

from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from saccade.cli.options import INPUT, SEVERAL, JsonOptions, SettingsOptions
from saccade.cli.output import Result, comparison, progress_bar
from saccade.datasets.homography_pairs import homography_pairs
from saccade.errors import setting
from saccade.evaluation.detectors import PEERS, find_detector
from saccade.evaluation.features import (
    REPEAT_RADIUS,
    Degradation,
    FeatureScores,
    PairScores,
    score_detector,
)
from saccade.evaluation.intervals import Estimate
from saccade.keypoints.detectors import DEFAULT_DETECTOR, DETECTORS, OWN

SCORES = {
    "rep.": ("repeatability",),
    "error": ("localization",),
    "MMA@1/3/5": ("mma_1", "mma_3", "mma_5"),
    "ratio@1/3/5": ("ratio_1", "ratio_3", "ratio_5"),
    "score": ("score",),
    "AUC@1/3/5/10": ("auc_1", "auc_3", "auc_5", "auc_10"),
}
"""Columns of the table, and the scores that they show."""
CLEAN = "clean"
"""Value of --degrade for unchanged images."""


@dataclass(frozen=True, kw_only=True)
class FeatureOptions(SettingsOptions, JsonOptions):
    """Options of `saccade evaluate features`."""

    pairs: Annotated[Path, INPUT, Parameter(metavar="DIR")]
    """Folder of sequences with 1.png, 2.png, H_1_2.txt and so on."""
    detector: Annotated[
        list[str] | None,
        SEVERAL,
        Parameter(
            metavar="NAME",
            help=f"Detectors: {', '.join((*DETECTORS, *PEERS))} or {OWN}; several with commas.",
        ),
    ] = None
    points: Annotated[list[int] | None, SEVERAL, Parameter(metavar="N")] = setting(None, 1)
    """Number of keypoints per image, at least 1: the strongest (COLMAP: the largest); several with
    commas."""
    degrade: Annotated[list[str] | None, SEVERAL, Parameter(metavar="KIND:AMOUNT")] = None
    """Degradation of the second image of each pair: noise:20 (gray levels), contrast:0.5, blur:2
    (px) or clean; several with commas."""


def features(options: FeatureOptions) -> Result:
    """Score detectors and descriptors on image pairs related by a homography.

    Prints means over the pairs with 95 % bootstrap intervals and, for several
    detectors, the paired difference of each from the first.

    With --points the detectors of this package use no contrast threshold, which
    yields enough keypoints at low contrast; OpenCV and COLMAP keep theirs. A
    module:function takes an (H, W, 3) image in [0, 1] and returns an object
    with xy and perhaps descriptors, strongest first; SIFT describes the others.

    docs/evaluation.md defines the figures.

    Example: saccade evaluate features --pairs oxford --detector opencv
    """
    found = homography_pairs(options.pairs)
    sequences = list(dict.fromkeys(pair.sequence for pair in found))
    names, preset = options.detector or [DEFAULT_DETECTOR], options.preset
    degradations = [
        None if text == CLEAN else Degradation.parse(text) for text in options.degrade or [CLEAN]
    ]
    results: dict[str, FeatureScores] = {}
    differences: dict[str, Estimate[PairScores]] = {}
    first: dict[tuple[int | None, Degradation | None], FeatureScores] = {}
    counts: list[int | None] = [*options.points] if options.points else [None]
    for name, degradation, count in product(names, degradations, counts):
        settings = options.settings(name) if name in DETECTORS else None
        detect = find_detector(name, settings, count)
        with progress_bar(f"{name} {degradation or ''}", len(found)) as progress:
            scores = score_detector(detect, found, degradation, progress=progress)
        words = f"{name} {preset}" if name in DETECTORS and preset else name
        row = ", ".join(
            filter(None, [words, f"{count} points" if count else "", str(degradation or "")])
        )
        results[row] = scores
        if first.setdefault((count, degradation), scores) is not scores:
            differences[row] = scores.minus(first[count, degradation])
    title = f"{len(found)} pairs in {len(sequences)} sequences, within {REPEAT_RADIUS:g} px"
    tables = comparison(
        title,
        {name: scores.estimate() for name, scores in results.items()},
        f"paired differences from {names[0]}",
        differences,
        ["points", *SCORES],
        _cells,
    )
    row_of = {
        name: scores.estimate().as_dict()
        | {"sequences": {each: asdict(scores.of(each).mean()) for each in sequences}}
        for name, scores in results.items()
    }
    minus_first = {name: each.as_dict() for name, each in differences.items()}
    return Result({"pairs": len(found), "detectors": row_of, "differences": minus_first}, tables)


def _cells(scores: PairScores) -> list[str]:
    cells = [
        " ".join(f"{getattr(scores, field):.3f}".replace("0.", ".", 1) for field in fields)
        for fields in SCORES.values()
    ]
    return [f"{scores.keypoints:.0f}", *cells]
