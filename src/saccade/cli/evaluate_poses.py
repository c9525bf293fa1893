"""`saccade evaluate features --drive`: relative poses of the frames of a recording."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from saccade.evaluation.relative_pose import PoseScores, RelativePoseScores

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
    from saccade.cli.output import print_json, print_table, progress_bar
    from saccade.datasets.drives.loading import load_drive
    from saccade.datasets.drives.sidecar_files import read_kitti_poses
    from saccade.evaluation.detectors import CONFIGURATIONS, find_detector
    from saccade.evaluation.relative_pose import pose_difference, score_relative_poses
    from saccade.settings import load_settings

    drive = load_drive("kitti", path)
    poses = read_kitti_poses(path / "poses.txt", drive.time)
    rows, results = [], {}
    reference: dict[tuple[int, int | None], RelativePoseScores] = {}
    for name in detectors:
        kind = CONFIGURATIONS.get(name)
        settings = None if kind is None else load_settings(kind, preset, config)
        detect = find_detector(name, settings, max(points) if points else None)
        with progress_bar(name, len(drive)) as progress:
            table = score_relative_poses(
                detect, drive, poses, points or (None,), gaps, ratio, progress
            )
        for (gap, count), scores in table.items():
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
                _row(label if key == "mean" else f"  {WORDS[key]}", pairs, value)
                for key, value in named.items()
            ]
    if as_json:
        print_json({"frames": len(drive), "detectors": results})
        return
    title = f"{drive.name}: relative pose of {len(drive)} frames, degrees"
    print_table(title, ANGLES, [row[:-1] for row in rows])
    print_table(title, AREAS, [[row[0], row[-1]] for row in rows])


WORDS = {
    "low": "95 % from",
    "high": "95 % to",
    "difference": "minus the first",
    "difference_low": "95 % from",
    "difference_high": "95 % to",
}
"""Rows below a mean."""


def _row(name: str, pairs: str, scores: "PoseScores") -> list[str]:
    fields = (scores.auc_1, scores.auc_3, scores.auc_5, scores.auc_10)
    areas = " ".join(f"{value:.3f}".replace("0.", ".", 1) for value in fields)
    angles = [f"{scores.rotation:.3f}", f"{scores.direction:.2f}"]
    return [name, pairs, f"{scores.matches:.0f}", *angles, areas]
