"""`saccade evaluate features`: repeatability and matching on image pairs."""

from collections.abc import Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from typer import Option

from saccade.cli.options import Config, Preset, ReportOptions
from saccade.cli.output import emit, progress_bar, with_interval
from saccade.datasets.drives.loading import load_drive
from saccade.datasets.drives.sidecar_files import read_kitti_poses
from saccade.datasets.homography_pairs import homography_pairs
from saccade.errors import ConfigError, require
from saccade.evaluation.detectors import CONFIGURATIONS, OURS, find_detector
from saccade.evaluation.features import (
    ESTIMATORS,
    Degradation,
    FeatureDifference,
    FeatureScores,
    PairScores,
    feature_difference,
    score_detector,
)
from saccade.evaluation.relative_pose import (
    PoseScores,
    RelativePoseScores,
    pose_difference,
    score_relative_poses,
)
from saccade.evaluation.synthetic_pairs import write_synthetic_pairs
from saccade.settings import load_settings
from saccade.viewing.report import Table

SCORES = {
    "rep.": ("repeatability",),
    "error": ("localization",),
    "MMA@1/3/5": ("mma_1", "mma_3", "mma_5"),
    "ratio@1/3/5": ("ratio_1", "ratio_3", "ratio_5"),
    "score": ("score",),
    "AUC@1/3/5/10": ("auc_1", "auc_3", "auc_5", "auc_10"),
}
"""Columns of the table, and their scores."""
COLUMNS = ["", "points", *SCORES]
PRINTED = (
    ("", "points", "rep.", "error", "AUC@1/3/5/10"),
    ("", "MMA@1/3/5", "ratio@1/3/5", "score"),
)
"""Columns of the two tables that are printed, which fit into 80 characters."""
MEANING = (
    "Rep.: repeatability, the fraction of the locations visible in both images that both detect; "
    "error: their mean distance in px. MMA: fraction of the mutual nearest neighbors correct "
    "within 1, 3 and 5 px; ratio: the same of those that pass the ratio test. Score: correct "
    "matches over the locations visible in both images. AUC: area under the cumulative curve of "
    "the corner error of the homography that is estimated from the matches that pass the ratio "
    "test. Higher is better, except for the error."
)
CLEAN = "clean"
"""Value of --degrade for images as they are."""


def features(
    shown: ReportOptions,
    pairs: Annotated[
        Path | None,
        Option(metavar="DIR", help="Folder of sequences with 1.png, 2.png, H_1_2.txt and so on."),
    ] = None,
    synthetic: Annotated[
        bool,
        Option(
            "--synthetic",
            help="Instead of --pairs: at least 200 pairs of known views of photographs.",
        ),
    ] = False,
    images: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="Photographs of --synthetic.",
            show_default="eleven of this package",
        ),
    ] = None,
    drive: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="Instead of --pairs: a recording in KITTI's layout with poses.txt, for the "
            "relative pose of its frames.",
        ),
    ] = None,
    gap: Annotated[
        list[int] | None,
        Option(
            min=1,
            metavar="N",
            help="With --drive: frames from the first of a pair to the second; several with "
            "commas.",
            show_default="1",
        ),
    ] = None,
    detector: Annotated[
        list[str] | None,
        Option(
            help="sift, must, symroid, sift-random, sift-salient, opencv, opencv-root (RootSIFT), "
            "colmap or module:callable; several with commas.",
            show_default="sift",
        ),
    ] = None,
    preset: Preset = None,
    config: Config = None,
    points: Annotated[
        list[int] | None,
        Option(
            min=1,
            metavar="N",
            help="Keep N keypoints of each image, the strongest (COLMAP: the largest); several "
            "with commas.",
        ),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        Option(
            help="Of the homographies: verify, magsac (OpenCV) or colmap; several with commas.",
            show_default="verify",
        ),
    ] = None,
    degrade: Annotated[
        list[str] | None,
        Option(
            metavar="KIND:AMOUNT",
            help="Degrade the second image of each pair by noise:20 (gray levels), contrast:0.5 "
            "or blur:2 (px), or leave it clean; several with commas.",
        ),
    ] = None,
    radius: Annotated[
        float,
        Option(min=0.1, max=100, metavar="PX", help="Maximum distance of a repeated keypoint."),
    ] = 3.0,
    ratio: Annotated[float, Option(min=0.01, max=1, help="Threshold of the ratio test.")] = 0.8,
    per_sequence: Annotated[bool, Option("--per-sequence", help="List every sequence.")] = False,
) -> None:
    """Score detectors and descriptors on image pairs related by a homography, or by a motion.

    Means over the pairs with 95 % bootstrap intervals, and with several
    detectors the paired differences of each from the first.

    With --points the detectors of this package have no threshold, so that there
    are enough keypoints where contrast is low; OpenCV and COLMAP keep theirs. A
    module:callable takes an (H, W, 3) image in [0, 1] and returns an object
    with xy and descriptors, strongest first.
    """
    elsewhere = pairs or synthetic or degrade or shown.report or per_sequence or estimator
    if drive is not None and elsewhere:
        raise ConfigError(
            "--drive: does not go with --pairs, --synthetic, --degrade, --estimator, --report, "
            "--per-sequence"
        )
    if drive is not None:
        detectors = detector or ["sift"], preset, config
        relative_poses(drive, *detectors, points or [], gap or [1], ratio, shown.as_json)
        return
    if (pairs is None) != synthetic:
        raise ConfigError("--pairs: expected a folder of image pairs, --synthetic, or --drive")
    if images is not None and not synthetic:
        raise ConfigError("--images: expected --synthetic with it")
    estimators: list[Any] = [*(estimator or ["verify"])]
    for each in estimators:
        require(each in ESTIMATORS, "estimator", f"one of {', '.join(ESTIMATORS)}", each)
    with TemporaryDirectory() as temporary:
        if pairs is None:
            pairs = Path(temporary)
            write_synthetic_pairs(pairs, images)
        found = homography_pairs(pairs)
        sequences = list(dict.fromkeys(pair.sequence for pair in found))
        degradations = [
            None if text == CLEAN else Degradation.parse(text) for text in degrade or [CLEAN]
        ]
        counts: list[int | None] = [*points] if points else [None]
        results: dict[str, FeatureScores] = {}
        differences: dict[str, FeatureDifference] = {}
        reference: dict[tuple[int | None, str], FeatureScores] = {}
        for name in detector or ["sift"]:
            kind = CONFIGURATIONS.get(name)
            settings = None if kind is None else load_settings(kind, preset, config)
            label = f"{name} {preset}" if name in OURS and preset else name
            for degradation, count in product(degradations, counts):
                detect = find_detector(name, settings, count)
                with progress_bar(f"{name} {degradation or ''}", len(found)) as progress:
                    scores = score_detector(
                        *(detect, found, degradation, ratio, radius, progress, estimators)
                    )
                for by, result in zip(estimators, scores, strict=True):
                    words = [label, f"{count} points" if count else "", str(degradation or "")]
                    row = ", ".join(filter(None, [*words, "" if by == "verify" else by]))
                    results[row] = result
                    first = reference.setdefault((count, words[2]), result)
                    if first is not result:
                        differences[row] = feature_difference(first, result)
    difference_title = f"Paired difference from {(detector or ['sift'])[0]}"
    title = f"{len(found)} pairs in {len(sequences)} sequences, within {radius:g} px"
    shown.write(
        "evaluate features",
        f"Repeatability and matching of keypoints: {title}.",
        [
            Table(
                "Mean over the pairs",
                COLUMNS,
                [
                    _row(f"{label}, {name}" if name else label, scores)
                    for label, result in results.items()
                    for name, scores in _means(result, [])
                ],
                MEANING,
                "detector",
            ),
            *(
                [Table(difference_title, COLUMNS, _difference_rows(differences), first="detector")]
                if differences
                else []
            ),
            Table(
                "Each sequence",
                COLUMNS,
                [
                    _row(f"{label}, {sequence}", result.of(sequence).mean())
                    for label, result in results.items()
                    for sequence in sequences
                ],
                first="detector, sequence",
            ),
        ],
    )
    tables = {label: _as_json(result, sequences) for label, result in results.items()}
    minus_first = {
        label: {end: asdict(scores) for end, scores in each._asdict().items()}
        for label, each in differences.items()
    }
    scored = {"pairs": len(found), "detectors": tables, "differences": minus_first}
    rows = [
        _row(f"  {name}" if name else label, scores)
        for label, result in results.items()
        for name, scores in _means(result, sequences if per_sequence else [])
    ]
    printed = _fitting(title, rows)
    if differences:
        printed += _fitting(difference_title, _difference_rows(differences))
    emit(scored, shown.as_json, *printed)


def _fitting(title: str, rows: Sequence[Sequence[str]]) -> list[Table]:
    """Rows of `COLUMNS` as the tables of `PRINTED`."""
    return [
        Table(title, names, [[row[COLUMNS.index(name)] for name in names] for row in rows])
        for names in PRINTED
    ]


def _means(result: "FeatureScores", sequences: list[str]) -> "list[tuple[str | None, PairScores]]":
    """The mean over the pairs, the ends of its interval, and the means of sequences, named."""
    low, high = result.interval()
    return [
        (None, result.mean()),
        ("95 % from", low),
        ("95 % to", high),
        *((sequence, result.of(sequence).mean()) for sequence in sequences),
    ]


def _difference_rows(differences: "dict[str, FeatureDifference]") -> list[list[str]]:
    """The mean difference of each detector, and the ends of its interval."""
    return [
        _row(f"  {name}" if name else label, scores, sign="+")
        for label, each in differences.items()
        for name, scores in zip(("", "95 % from", "95 % to"), each, strict=True)
    ]


def _as_json(result: "FeatureScores", sequences: list[str]) -> dict[str, Any]:
    means = {name: asdict(result.of(name).mean()) for name in sequences}
    return with_interval(result.mean(), *result.interval()) | {"sequences": means}


def _row(name: str, scores: "PairScores", sign: str = "") -> list[str]:
    cells = [
        " ".join(f"{getattr(scores, field):{sign}.3f}".replace("0.", ".", 1) for field in fields)
        for fields in SCORES.values()
    ]
    return [name, f"{scores.keypoints:{sign}.0f}", *cells]


ANGLES = ["", "pairs", "matches", "rotation", "direction"]
AREAS = ["", "AUC@1/3/5/10"]


def relative_poses(
    path: Path,
    detectors: Sequence[str],
    preset: str | None,
    config: Path | None,
    points: Sequence[int],
    gaps: Sequence[int],
    ratio: float,
    as_json: bool,
) -> None:
    """Score detectors on the frames of a recording, and print the scores."""
    drive = load_drive("kitti", path)
    poses = read_kitti_poses(path / "poses.txt", drive.time)
    rows, results = [], {}
    reference: dict[tuple[int, int | None], RelativePoseScores] = {}
    for name in detectors:
        kind = CONFIGURATIONS.get(name)
        settings = None if kind is None else load_settings(kind, preset, config)
        tables: dict[tuple[int, int | None], RelativePoseScores] = {}
        for count in points or (None,):
            detect = find_detector(name, settings, count)
            with progress_bar(name, len(drive)) as progress:
                table = score_relative_poses(detect, drive, poses, gaps, ratio, progress)
            tables |= {(gap, count): scores for gap, scores in table.items()}
        for (gap, count), scores in tables.items():
            words = [name, f"{count} points" if count else "", f"gap {gap}"]
            label, (low, high) = ", ".join(filter(None, words)), scores.interval()
            named = {"mean": scores.mean(), "low": low, "high": high}
            first = reference.setdefault((gap, count), scores)
            if first is not scores:
                mean, *ends = pose_difference(first, scores)
                named |= {"difference": mean, "difference_low": ends[0], "difference_high": ends[1]}
            results[label] = {key: asdict(value) for key, value in named.items()}
            pairs = str(len(scores.scores))
            rows += [
                _pose_row(label if key == "mean" else f"  {WORDS[key]}", pairs, value)
                for key, value in named.items()
            ]
    title = f"{drive.name}: relative pose of {len(drive)} frames, degrees"
    emit(
        {"frames": len(drive), "detectors": results},
        as_json,
        Table(title, ANGLES, [row[:-1] for row in rows]),
        Table(title, AREAS, [[row[0], row[-1]] for row in rows]),
    )


WORDS = {
    "low": "95 % from",
    "high": "95 % to",
    "difference": "minus the first",
    "difference_low": "95 % from",
    "difference_high": "95 % to",
}
"""Rows below a mean."""


def _pose_row(name: str, pairs: str, scores: "PoseScores") -> list[str]:
    fields = (scores.auc_1, scores.auc_3, scores.auc_5, scores.auc_10)
    areas = " ".join(f"{value:.3f}".replace("0.", ".", 1) for value in fields)
    angles = [f"{scores.rotation:.3f}", f"{scores.direction:.2f}"]
    return [name, pairs, f"{scores.matches:.0f}", *angles, areas]
