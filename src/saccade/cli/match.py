"""`saccade match`: keypoint matches of two images."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from saccade.cli.options import Config, Json, MaxKeypoints, Out, Preset, Spread

if TYPE_CHECKING:
    from saccade.keypoints.sift import Sift
    from saccade.keypoints.verification import Geometry
    from saccade.viewing.report_builder import ReportBuilder

LEAD = "Matching interest points of two photographs."
TEXT = (
    "Lines join matched points: the inliers of one geometry, and the others. Click near the end of "
    "a line to see one match alone."
)


class GeometryChoice(StrEnum):
    """Two-view geometries that matches are verified by."""

    FUNDAMENTAL = "fundamental"
    HOMOGRAPHY = "homography"
    NONE = "none"


def match(
    first: Annotated[Path, typer.Argument(metavar="A", help="First image.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Second image of the same scene.")],
    out: Out = Path("saccade-match"),
    preset: Preset = None,
    config: Config = None,
    max_keypoints: MaxKeypoints = None,
    spread: Spread = False,
    ratio: Annotated[
        float,
        typer.Option(min=0, max=1, help="Ratio test: maximum nearest / second nearest distance."),
    ] = 0.8,
    mutual: Annotated[bool, typer.Option(help="Keep only mutual nearest neighbors.")] = True,
    geometry: Annotated[
        GeometryChoice,
        typer.Option(
            help="Geometric verification: fundamental matrix for any rigid scene, homography for a "
            "plane or a rotating camera, or none."
        ),
    ] = GeometryChoice.FUNDAMENTAL,
    tolerance: Annotated[
        float, typer.Option(min=0.01, metavar="PX", help="Inlier threshold.")
    ] = 2.0,
    as_json: Json = False,
) -> None:
    """Match the keypoints of two images.

    Mutual nearest neighbors that pass the ratio test are verified by a two-view
    geometry (OpenCV's USAC with MAGSAC, deterministic). --out receives a figure
    (matches.png), an interactive report (report.html) and a table (matches.csv:
    indices and coordinates in both images, and 1 for an inlier).
    """
    from saccade.cli.detectors import make_detector
    from saccade.cli.output import print_json, print_table
    from saccade.viewing.report_builder import ReportBuilder

    sift = make_detector("sift", preset, config, max_keypoints, spread=spread)
    model = None if geometry is GeometryChoice.NONE else cast("Geometry", geometry.value)
    builder = ReportBuilder("saccade match", LEAD)
    row = match_images(first, second, out, sift, builder, ratio, mutual, model, tolerance)
    row["report"] = str(builder.write(out / "report.html"))
    if as_json:
        print_json(row)
        return
    shared = [str(row["matches"])] + ([] if model is None else [str(row["inliers"])])
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
    builder: "ReportBuilder",
    ratio: float = 0.8,
    mutual: bool = True,
    geometry: "Geometry | None" = "fundamental",
    tolerance: float = 2.0,
) -> dict[str, Any]:
    """Match two images: write matches.png and .csv into `out`, return the row for --json."""
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
    xy = np.hstack([keypoints[0].xy[pairs[:, 0]], keypoints[1].xy[pairs[:, 1]]])
    lines = [
        f"{i},{j},{x1:.3f},{y1:.3f},{x2:.3f},{y2:.3f}"
        for (i, j), (x1, y1, x2, y2) in zip(pairs.tolist(), xy.tolist(), strict=True)
    ]
    header = "first,second,x1,y1,x2,y2"
    facts = {
        "interest points": " and ".join(f"{len(each):,}" for each in keypoints),
        "matches": f"{len(pairs):,}",
    }
    if inliers is not None:
        header += ",inlier"
        lines = [f"{line},{inlier:d}" for line, inlier in zip(lines, inliers, strict=True)]
        facts["inliers"] = f"{inliers.sum():,} ({inliers.mean() if len(pairs) else 0:.0%})"
    table = out / "matches.csv"
    write_text(table, "\n".join([header, *lines]) + "\n")
    section = Section(f"{first.name} and {second.name}", TEXT, facts=facts)
    builder.add(lambda: match_part(section, images, keypoints, pairs, inliers))
    row: dict[str, Any] = {
        "first": str(first),
        "second": str(second),
        "first_points": len(keypoints[0]),
        "second_points": len(keypoints[1]),
        "matches": len(pairs),
        "picture": str(picture),
        "table": str(table),
    }
    if verified is not None:
        row |= {
            "inliers": int(verified.inliers.sum()),
            "geometry": verified.geometry,
            "matrix": None if verified.matrix is None else verified.matrix.tolist(),
        }
    return row
