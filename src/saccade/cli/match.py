"""`saccade match`: interest points that two images share."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from saccade.cli.detect import Most, Spread
from saccade.cli.options import Json, Out, Preset, Settings
from saccade.cli.report_builder import ReportBuilder

if TYPE_CHECKING:
    from saccade.keypoints.sift import Sift
    from saccade.keypoints.verification import Geometry

LEAD = "Interest points that two photographs share."
TEXT = (
    "Lines join matched points, those that agree with one geometry and the others. "
    "Click near the end of a line to see one match alone."
)


class Choice(StrEnum):
    """What matches are to agree with."""

    FUNDAMENTAL = "fundamental"
    HOMOGRAPHY = "homography"
    NONE = "none"


def match(
    first: Annotated[Path, typer.Argument(metavar="A", help="One photograph.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another of the same place.")],
    out: Out = Path("saccade-match"),
    preset: Preset = None,
    config: Settings = None,
    most: Most = None,
    spread: Spread = False,
    ratio: Annotated[
        float, typer.Option(min=0, max=1, help="Nearest / second nearest distance, at most.")
    ] = 0.8,
    mutual: Annotated[bool, typer.Option(help="Keep only pairs that choose each other.")] = True,
    geometry: Annotated[
        Choice,
        typer.Option(help="Of any rigid scene; of a plane or a turning camera; or unchecked."),
    ] = Choice.FUNDAMENTAL,
    tolerance: Annotated[
        float, typer.Option(min=0.01, help="Pixels by which an inlier may miss.")
    ] = 2.0,
    as_json: Json = False,
) -> None:
    """Match the interest points of two images.

    Nearest neighbors with ratio test and mutual check; then which of them are
    inliers, that is agree with one geometry (OpenCV's USAC with MAGSAC; the
    same every time). The picture (matches.png), a page to look at each of
    them (report.html) and the list (matches.csv: index, x and y in both
    images, and 1 for an inlier) appear in --out.
    """
    from saccade.cli.detectors import make_detector
    from saccade.cli.output import print_json, print_table

    sift = make_detector("sift", preset, config, most, spread=spread)
    wanted = None if geometry is Choice.NONE else cast("Geometry", geometry.value)
    row = match_images(first, second, out, sift, ratio, mutual, wanted, tolerance)
    if as_json:
        print_json(row)
        return
    shared = [str(row["matches"])] + ([] if wanted is None else [str(row["inliers"])])
    print_table(
        f"matches -> {out}",
        ["image", "points", "matched", "inliers"][: 2 + len(shared)],
        [
            [str(first), str(row["first_points"]), *shared],
            [str(second), str(row["second_points"]), *shared],
        ],
    )


def match_images(
    first: Path,
    second: Path,
    out: Path,
    sift: "Sift",
    ratio: float,
    mutual: bool,
    geometry: "Geometry | None" = "fundamental",
    tolerance: float = 2.0,
    builder: ReportBuilder | None = None,
) -> dict[str, Any]:
    """Match two images: write matches.png and .csv into `out`, give the row for --json.

    The report is written too, unless an album takes the images and their matches.
    """
    import numpy as np

    from saccade.cli.output import write_text
    from saccade.image import read_image
    from saccade.keypoints.matching import match as match_keypoints
    from saccade.keypoints.verification import verify
    from saccade.viewing import match_figure, save_figure
    from saccade.viewing.page import Section
    from saccade.viewing.report_image import match_part

    images = (read_image(first), read_image(second))
    keypoints = (sift(images[0]), sift(images[1]))
    pairs = match_keypoints(*keypoints, ratio=ratio, mutual=mutual)
    verified = None if geometry is None else verify(*keypoints, pairs, geometry, tolerance)
    inliers = None if verified is None else verified.inliers
    picture = save_figure(match_figure(images, keypoints, pairs, inliers), out / "matches.png")
    places = np.hstack([keypoints[0].xy[pairs[:, 0]], keypoints[1].xy[pairs[:, 1]]])
    lines = [
        f"{i},{j},{x1:.3f},{y1:.3f},{x2:.3f},{y2:.3f}"
        for (i, j), (x1, y1, x2, y2) in zip(pairs.tolist(), places.tolist(), strict=True)
    ]
    header = "first,second,x1,y1,x2,y2"
    if inliers is not None:
        header += ",inlier"
        lines = [f"{line},{inlier:d}" for line, inlier in zip(lines, inliers, strict=True)]
    table = out / "matches.csv"
    write_text(table, "\n".join([header, *lines]) + "\n")
    names = f"{first.name} and {second.name}"
    own = ReportBuilder("saccade match", LEAD) if builder is None else builder
    facts = {
        "interest points": " and ".join(f"{len(each):,}" for each in keypoints),
        "matches": f"{len(pairs):,}",
    }
    if inliers is not None:
        facts["inliers"] = f"{inliers.sum():,}, that is {inliers.mean() if len(pairs) else 0:.0%}"
    section = Section(names, TEXT, facts=facts)
    own.add(lambda: match_part(section, images, keypoints, pairs, inliers))
    row: dict[str, Any] = {
        "first": str(first),
        "second": str(second),
        "first_points": len(keypoints[0]),
        "second_points": len(keypoints[1]),
        "matches": len(pairs),
        "picture": str(picture),
        "table": str(table),
    }
    if builder is None:
        row["report"] = str(own.write(out / "report.html"))
    if verified is not None:
        matrix = None if verified.matrix is None else verified.matrix.tolist()
        row |= {
            "inliers": int(verified.inliers.sum()),
            "geometry": verified.geometry,
            "matrix": matrix,
        }
    return row
