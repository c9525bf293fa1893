"""`saccade match`: keypoint matches of two images, or of many."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from typer import Argument, Option

from saccade.cli.batch_run import Workers, preload
from saccade.cli.options import (
    Config,
    Detector,
    DetectorOption,
    Json,
    MaxKeypoints,
    Out,
    Preset,
    Spread,
)
from saccade.extras import import_optional

if TYPE_CHECKING:
    from saccade.keypoints.two_view_fit import Geometry


class GeometryChoice(StrEnum):
    """Two-view geometries that matches are verified by."""

    FUNDAMENTAL = "fundamental"
    HOMOGRAPHY = "homography"
    NONE = "none"


class Format(StrEnum):
    """File formats of the figure of two images, and of the matches of many."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"
    HDF5 = "hdf5"
    COLMAP = "colmap"


def match(
    first: Annotated[
        str,
        Argument(
            metavar="A", help="First image; or, alone, many: a folder, quoted pattern, list or tar."
        ),
    ],
    second: Annotated[
        Path | None, Argument(metavar="B", help="Second image of the same scene.")
    ] = None,
    pairs: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Of many images match these pairs, two names to a line; all pairs by default.",
        ),
    ] = None,
    out: Out = Path("saccade-match"),
    detector: DetectorOption = Detector.SIFT,
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
    formats: Annotated[
        list[Format] | None,
        Option(
            "--format",
            "-f",
            help="Output format: of the figure of two images, png by default, svg or pdf; of many "
            "images hdf5 for hloc, by default, or colmap; several with commas.",
        ),
    ] = None,
    redo: Annotated[
        bool,
        Option("--redo", help="Of many images replace the features of other settings."),
    ] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Match the keypoints of two images, or of many.

    Mutual nearest neighbors that pass the ratio test are verified by a two-view
    geometry (OpenCV's USAC with MAGSAC, deterministic). --out receives a figure
    (matches.png), the strongest keypoints in both images, each in its own frame,
    whether they matched or not (frames.png), an interactive report (report.html)
    and a table (matches.csv: indices and coordinates in both images, and 1 for an
    inlier).

    Of many images --out receives features.h5 and matches.h5 (in the layout of
    hloc) or database.db (for COLMAP, with two-view geometries), the numbers of
    each pair (pairs.csv) and the pairs (pairs.txt). The same command resumes an
    interrupted run, and matches what is new or has changed.
    """
    from saccade.cli.detectors import make_detector
    from saccade.errors import require

    model = None if geometry is GeometryChoice.NONE else cast("Geometry", geometry.value)
    many = second is None
    allowed = (Format.HDF5, Format.COLMAP) if many else (Format.PNG, Format.SVG, Format.PDF)
    names = " or ".join(allowed)
    chosen = list(dict.fromkeys(formats or [allowed[0]]))
    for each in chosen:
        expected = f"{names} for {'many images' if many else 'two images'}"
        require(each in allowed, "format", expected, each.value)
    find = make_detector(detector.value, preset, config, max_keypoints, spread=spread)
    if second is None:
        preload(first, workers)
        import_optional("pyarrow", "parquet")
        from saccade.batch import Job, MatchConfig
        from saccade.cli.match_many import match_many

        match_many(
            *(first, pairs, out, Job(detector.value, find.config, exact=True)),
            MatchConfig(ratio, mutual, model, tolerance),
            [each.value for each in chosen],
            workers=workers,
            redo=redo,
            as_json=as_json,
        )
        return
    given = pairs or redo or workers
    require(not given, "pairs", "--pairs, --redo and --workers with many images", str(second))
    from saccade.cli.match_run import LEAD, match_images
    from saccade.cli.output import print_json, print_table
    from saccade.io.files import results_in
    from saccade.viewing.report import ReportBuilder

    builder = ReportBuilder("saccade match", LEAD)
    with results_in(out):
        row = match_images(
            *(Path(first), second, out, find, builder, ratio, mutual, model, tolerance),
            figures=chosen,
        )
        row["report"] = str(builder.write(out / "report.html"))
    if as_json:
        print_json(row)
        return
    shared = [str(row["matches"])] + ([] if model is None else [str(row["inliers"])])
    print_table(
        f"matches -> {out}",
        ["image", "points", "matched", "inliers"][: 2 + len(shared)],
        [
            [first, str(row["first_points"]), *shared],
            [str(second), str(row["second_points"]), *shared],
        ],
    )
