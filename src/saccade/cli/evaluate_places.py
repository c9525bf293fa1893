"""`saccade evaluate places`: whether places are recognized on the second lap."""

from typing import Annotated, Any

import typer

from saccade.cli.options import Images, Json, Report

NEIGHBORS = 2
"""Photographs before and after the right one that show the same place."""
PAIR = ["", "shows the place of", "matches that agree", "right"]
"""Headings of what was recognized."""


def places(
    images: Images,
    lap: Annotated[int, typer.Option(min=2, help="Photographs to a lap.")],
    points: Annotated[int, typer.Option(min=50, help="Of each photograph at most.")] = 500,
    agreeing: Annotated[
        int, typer.Option(min=8, help="Matches that must agree on one geometry.")
    ] = 22,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Walk the same way several times, and recognize places seen before.

    The photographs are in the order of the numbers in their names. One is recognized rightly
    if the place it is said to show is as many laps away, give or take two photographs.
    """
    from saccade import Sift, SiftConfig, read_image
    from saccade.cli.output import print_json, print_table, tracked
    from saccade.cli.report_builder import Table, write_table_page
    from saccade.image import find_images
    from saccade.visual.loop_detection import LoopDetectionConfig, LoopDetector

    paths = sorted((path for each in images for path in find_images(each)), key=_number)
    sift = Sift(SiftConfig(max_keypoints=points, spread=True))
    memory = LoopDetector(LoopDetectionConfig(min_inliers=agreeing))
    found: list[dict[str, Any]] = []
    for number, path in enumerate(tracked(paths, "walking", len(paths))):
        seen = memory.detect(sift(read_image(path)))
        if seen is not None:
            turn = (number - seen.place + lap // 2) % lap - lap // 2
            same = abs(turn) <= NEIGHBORS
            pair = {"image": path.name, "shows": paths[seen.place].name}
            found.append({**pair, "agreeing": seen.inliers, "right": same})
    right = sum(row["right"] for row in found)
    again = max(len(paths) - lap, 0)
    row = {
        "images": len(paths),
        "seen_again": again,
        "recognized": len(found),
        "right": right,
        "precision": right / len(found) if found else None,
        "recall": right / again if again else None,
    }
    shown = [[name.replace("_", " "), _shown(value)] for name, value in row.items()]
    lead = "Whether places are recognized that were seen before."
    pairs = [
        [each["image"], each["shows"], str(each["agreeing"]), "yes" if each["right"] else "no"]
        for each in found
    ]
    write_table_page(
        report,
        "saccade evaluate places",
        lead,
        [
            Table("Over all photographs", ["", "value"], shown, _meaning(lap), "figure"),
            Table("Each that was recognized", PAIR, pairs, first="photograph"),
        ],
    )
    if as_json:
        print_json({**row, "pairs": found})
        return
    print_table("places", ["", ""], shown)


def _meaning(lap: int) -> str:
    return (
        f"The walk is {lap} photographs long and repeated. Seen again: photographs after the first "
        "lap; recognized: those said to show a place of an earlier lap; right: where that is "
        f"at most {NEIGHBORS} photographs from the place. Precision: right of the recognized; "
        "recall: right of those seen again."
    )


def _number(path: Any) -> tuple[int, str]:
    digits = "".join(letter for letter in path.stem if letter.isdigit())
    return (int(digits) if digits else 0, path.name)


def _shown(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)
