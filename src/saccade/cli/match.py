"""`saccade match`: keypoint matches of two images."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from typer import Argument, Option

from saccade.cli.options import Config, Json, MaxKeypoints, Out, Preset, Spread

if TYPE_CHECKING:
    from saccade.keypoints.verification import Geometry


class GeometryChoice(StrEnum):
    """Two-view geometries that matches are verified by."""

    FUNDAMENTAL = "fundamental"
    HOMOGRAPHY = "homography"
    NONE = "none"


def match(
    first: Annotated[Path, Argument(metavar="A", help="First image.")],
    second: Annotated[Path, Argument(metavar="B", help="Second image of the same scene.")],
    out: Out = Path("saccade-match"),
    preset: Preset = None,
    config: Config = None,
    max_keypoints: MaxKeypoints = None,
    spread: Spread = False,
    ratio: Annotated[
        float, Option(min=0, max=1, help="Ratio test: maximum nearest / second nearest distance.")
    ] = 0.8,
    mutual: Annotated[bool, Option(help="Keep only mutual nearest neighbors.")] = True,
    geometry: Annotated[
        GeometryChoice,
        Option(
            help="Geometric verification: fundamental matrix for any rigid scene, homography for a "
            "plane or a rotating camera, or none."
        ),
    ] = GeometryChoice.FUNDAMENTAL,
    tolerance: Annotated[float, Option(min=0.01, metavar="PX", help="Inlier threshold.")] = 2.0,
    as_json: Json = False,
) -> None:
    """Match the keypoints of two images.

    Mutual nearest neighbors that pass the ratio test are verified by a two-view
    geometry (OpenCV's USAC with MAGSAC, deterministic). --out receives a figure
    (matches.png), an interactive report (report.html) and a table (matches.csv:
    indices and coordinates in both images, and 1 for an inlier).
    """
    from saccade.cli.detectors import make_detector
    from saccade.cli.match_run import LEAD, match_images
    from saccade.cli.output import print_json, print_table
    from saccade.viewing.report import ReportBuilder

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
