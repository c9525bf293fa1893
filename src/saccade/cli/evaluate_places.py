"""`saccade evaluate places`: place recognition on repeated laps."""

from pathlib import Path
from typing import Annotated

from typer import Option

from saccade.cli.options import Images, Json, Report

COLUMNS = ["", "matched to", "inliers", "correct"]
MEANING = (
    "Revisits: photographs after the first lap; detections: those matched to an earlier one; "
    "correct: those matched to a photograph that is a whole number of laps away, to within two. "
    "Precision: correct over detections; recall: correct over revisits."
)


def places(
    images: Images,
    lap: Annotated[int, Option(min=2, metavar="N", help="Photographs per lap.")],
    points: Annotated[
        int, Option(min=50, metavar="N", help="Maximum number of keypoints per photograph.")
    ] = 500,
    min_inliers: Annotated[
        int, Option(min=8, metavar="N", help="Minimum number of epipolar inliers.")
    ] = 22,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Score place recognition on photographs of several laps along one route.

    The photographs are ordered by the numbers in their names.
    """
    from saccade import Sift, SiftConfig, read_image
    from saccade.cli.output import print_json, print_table, tracked
    from saccade.evaluation.places import score_places
    from saccade.image import find_images
    from saccade.viewing.report import Table, write_tables
    from saccade.visual.loop_detection import LoopDetectionConfig

    paths = sorted((path for each in images for path in find_images(each)), key=_number)
    sift = Sift(SiftConfig(max_keypoints=points, ranking="response", spread=True))
    frames = (sift(read_image(path)) for path in tracked(paths, "recognizing", len(paths)))
    scores = score_places(frames, lap, LoopDetectionConfig(min_inliers=min_inliers))
    row = {
        "images": scores.frames,
        "revisits": scores.revisits,
        "detections": len(scores.detections),
        "correct": scores.correct,
        "precision": scores.precision,
        "recall": scores.recall,
    }
    pairs = [
        {"image": paths[frame].name, "match": paths[match].name, "inliers": n, "correct": correct}
        for frame, match, n, correct in scores.detections
    ]
    facts = [[name, _formatted(value)] for name, value in row.items()]
    detections = [
        [paths[frame].name, paths[match].name, str(inliers), "yes" if correct else "no"]
        for frame, match, inliers, correct in scores.detections
    ]
    write_tables(
        report,
        "saccade evaluate places",
        "Recognition of places that were visited before.",
        [
            Table("All photographs", ["", "value"], facts, MEANING, "figure"),
            Table("Detections", COLUMNS, detections, first="photograph"),
        ],
    )
    if as_json:
        print_json({**row, "pairs": pairs})
        return
    print_table("places", ["", ""], facts)


def _number(path: Path) -> tuple[int, str]:
    digits = "".join(letter for letter in path.stem if letter.isdigit())
    return (int(digits) if digits else 0, path.name)


def _formatted(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)
