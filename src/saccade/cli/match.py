"""`saccade match`: keypoint matches of two images, or of many."""

from collections.abc import Sequence
from contextlib import ExitStack
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import numpy as np
import typer
from matplotlib.figure import Figure
from typer import Argument, Option

from saccade.cli import options
from saccade.cli.batch_run import (
    INTERRUPTED,
    Workers,
    batch_progress,
    local_engine,
    preload,
    stop_on_interrupt,
)
from saccade.cli.detect import DetectorOptions, contributing_pairs
from saccade.cli.output import Table, emit, print_message, write_text
from saccade.errors import require
from saccade.extras import import_optional
from saccade.io.files import results_in
from saccade.io.image import read_image
from saccade.keypoints import Must, SymRoid, Verification, verify
from saccade.keypoints import match as nearest_matches
from saccade.keypoints.two_view_fit import Geometry
from saccade.types import BoolArray, Float32Array, IntArray, Keypoints, Regions
from saccade.viewing import Picture, Section, keypoint_frame_figure, match_figure, save_figures
from saccade.viewing.keypoints import KeypointView, Outcome
from saccade.viewing.page import figure_uri
from saccade.viewing.report import ReportBuilder, match_part

if TYPE_CHECKING:
    from saccade.batch.engines import ShardReport
    from saccade.batch.job import Job
    from saccade.batch.matching import Format as ManyFormat
    from saccade.batch.matching import MatchConfig, MatchRun


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
    *,
    detector: DetectorOptions,
    pairs: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Of many images match these pairs, two names to a line; all pairs by default.",
        ),
    ] = None,
    out: options.Out = Path("saccade-match"),
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
    as_json: options.Json = False,
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
    model = None if geometry is GeometryChoice.NONE else cast("Geometry", geometry.value)
    many = second is None
    allowed = (Format.HDF5, Format.COLMAP) if many else (Format.PNG, Format.SVG, Format.PDF)
    names = " or ".join(allowed)
    chosen = list(dict.fromkeys(formats or [allowed[0]]))
    for each in chosen:
        expected = f"{names} for {'many images' if many else 'two images'}"
        require(each in allowed, "format", expected, each.value)
    find = detector.make()
    if second is None:
        preload(first, workers)
        import_optional("pyarrow", "parquet")
        from saccade.batch import Job, MatchConfig

        match_many(
            *(first, pairs, out, Job(detector.detector.value, find.config, exact=True)),
            MatchConfig(ratio, mutual, model, tolerance),
            [each.value for each in chosen],
            workers=workers,
            redo=redo,
            as_json=as_json,
        )
        return
    given = pairs or redo or workers
    require(not given, "pairs", "--pairs, --redo and --workers with many images", str(second))
    builder = ReportBuilder("saccade match", LEAD)
    with results_in(out):
        row = match_images(
            *(Path(first), second, out, find, builder, ratio, mutual, model, tolerance),
            figures=chosen,
        )
        row["report"] = str(builder.write(out / "report.html"))
    shared = [str(row["matches"])] + ([] if model is None else [str(row["inliers"])])
    columns = ["image", "points", "matched", "inliers"][: 2 + len(shared)]
    cells = [
        [first, str(row["first_points"]), *shared],
        [str(second), str(row["second_points"]), *shared],
    ]
    emit(row, as_json, Table(f"matches -> {out}", columns, cells))


LEAD = "Matching interest points of two photographs."
TEXT = (
    "Lines join matched points: the inliers of one geometry, and the others. Click near the end of "
    "a line to see one match alone."
)


def match_images(
    first: Path,
    second: Path,
    out: Path,
    detector: Any,
    builder: ReportBuilder,
    ratio: float = 0.8,
    mutual: bool = True,
    geometry: Geometry | None = "fundamental",
    tolerance: float = 2.0,
    figures: Sequence[str] = ("png",),
) -> dict[str, Any]:
    """Match two images: write matches.png, .csv and frames.png, return the row for --json."""
    images = (read_image(first), read_image(second))
    keypoints = (detected(detector, images[0]), detected(detector, images[1]))
    pairs = nearest_matches(*keypoints, ratio=ratio, mutual=mutual)
    verified = None if geometry is None else verify(*keypoints, pairs, geometry, tolerance)
    inliers = None if verified is None else verified.inliers
    figure = match_figure(images, keypoints, pairs, inliers)
    picture = save_figures(figure, out / "matches", figures)
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
    verdicts = None if verified is None or verified.matrix is None else inliers
    frames = frames_figure(detector, images, keypoints, pairs, verdicts)
    pictures = [] if frames is None else [Picture(figure_uri(frames[0]), *frames[1:], wide=True)]
    section = Section(f"{first.name} and {second.name}", TEXT, pictures, facts)
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
    if frames is not None:
        row["frames"] = str(save_figures(frames[0], out / "frames", figures))
    if verified is not None:
        row |= {
            "inliers": int(verified.inliers.sum()),
            "geometry": verified.geometry,
            "matrix": None if verified.matrix is None else verified.matrix.tolist(),
            "corner_sigma_px": corner_sigma(verified, images[0].shape),
        }
    return row


def corner_sigma(verified: Verification, shape: tuple[int, ...]) -> float | None:
    """Standard deviation in pixels of the corner that a homography projects worst, if known."""
    if verified.geometry != "homography" or verified.covariance is None:
        return None
    height, width = shape[:2]
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)
    return float(np.sqrt(np.linalg.eigvalsh(verified.projection_covariance(corners)).max()))


def detected(detector: Any, image: Float32Array) -> Keypoints:
    """The keypoints of an image, or those of its regions."""
    detections = detector(image)
    return detections.keypoints if isinstance(detections, Regions) else detections


MAX_SHOWN = 12
"""Number of the strongest keypoints of the first image that are drawn."""
CAPTION = (
    "The strongest keypoints of the first image, each above its nearest neighbor in the second, "
    "turned and scaled to the frame of the keypoint."
)


def frames_figure(
    detector: Any,
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: BoolArray | None,
) -> tuple[Figure, str, str] | None:
    """Draw the strongest keypoints in both images; None where there are none.

    Args:
        detector: that found the keypoints.
        images: two (H, W, 3) in [0, 1].
        keypoints: of each.
        pairs: (m, 2) matches.
        inliers: (m,) which matches agree with one geometry; None without verification.
    """
    views, outcomes = in_frames(detector, images, keypoints, pairs, inliers)
    if not views:
        return None
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in dict.fromkeys(outcomes))
    figure = keypoint_frame_figure(views, outcomes)
    return figure, f"Patches of keypoints in two images: {counts}", CAPTION


def in_frames(
    detector: Any,
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: BoolArray | None,
) -> tuple[list[tuple[KeypointView, KeypointView]], list[Outcome]]:
    """The strongest keypoints with their nearest neighbors, and what became of them."""
    shown = strongest_positions(keypoints[0])
    nearest = nearest_matches(keypoints[0][shown], keypoints[1], ratio=None, mutual=False)
    rows = shown[nearest[:, 0]], nearest[:, 1]
    first, second = (
        views_of(detector, image, points[index])
        for image, points, index in zip(images, keypoints, rows, strict=True)
    )
    outcomes = [outcome(row, pairs, inliers) for row in rows[0].tolist()]
    return list(zip(first, second, strict=True)), outcomes


def strongest_positions(keypoints: Keypoints) -> IntArray:
    """Indices of the strongest keypoints, one for each position."""
    order = np.argsort(-keypoints.response, kind="stable")
    _, first = np.unique(keypoints.xy[order], axis=0, return_index=True)
    return order[np.sort(first)[:MAX_SHOWN]]


def views_of(detector: Any, image: Float32Array, keypoints: Keypoints) -> list[KeypointView]:
    """Each keypoint with the pairs of its symmetry, where it was detected by symmetry."""
    rows = [keypoints[i : i + 1] for i in range(len(keypoints))]
    if not isinstance(detector, Must | SymRoid):
        return [KeypointView(image, row) for row in rows]
    pairs = contributing_pairs(detector, image, keypoints)
    return [KeypointView(image, row, each) for row, each in zip(rows, pairs, strict=True)]


def outcome(row: int, pairs: IntArray, inliers: BoolArray | None) -> Outcome:
    """Outcome of a keypoint of the first image."""
    matched = pairs[:, 0] == row
    if not matched.any():
        return "rejected"
    if inliers is None:
        return "matched"
    return "inlier" if inliers[matched].any() else "outlier"


def match_many(
    source: str,
    pairs: Path | None,
    out: Path,
    job: "Job",
    config: "MatchConfig",
    formats: Sequence[str],
    *,
    workers: int | None,
    redo: bool,
    as_json: bool,
) -> None:
    """Match many images and print the counts.

    Raises:
        Exit: an image failed, or the run was stopped.
    """
    from saccade.batch.matching import FEATURES, match_images

    with ExitStack() as stack:
        stopped = stack.enter_context(stop_on_interrupt())
        watch = _Watch(stack)
        run = match_images(
            source,
            out,
            pairs=pairs,
            job=job,
            config=config,
            formats=cast("Sequence[ManyFormat]", formats),
            engine=partial(local_engine, workers=workers),
            redo=redo,
            should_stop=stopped,
            on_report=watch,
        )
    row = _as_row(run)
    names = {"done": "pairs matched now", "already_done": "pairs matched before"}
    facts = [(names.get(name, name.replace("_", " ")), value) for name, value in row.items()]
    shown = [(name, str(value)) for name, value in facts if not isinstance(value, bool | dict)]
    emit(row, as_json, Table(f"{source} -> {out}", ["", ""], [*shown, *row["files"].items()]))
    if not run.complete:
        total = run.done + run.unchanged
        print_message(f"stopped after {total} of {run.pairs} pairs; run it again to resume")
        raise SystemExit(INTERRUPTED)
    if run.extraction.failed:
        print_message(
            f"{run.extraction.failed} images failed, and {run.pairs - len(run.matched)} pairs are "
            f"left out; see {out / FEATURES}/errors.parquet"
        )
        raise typer.Exit(1)


class _Watch:
    """A progress bar for the images, then one for the pairs."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._bars: dict[str, Any] = {}

    def __call__(self, stage: str, total: int, report: "ShardReport") -> None:
        """Advance the bar of a stage."""
        if stage not in self._bars:
            self._bars[stage] = self._stack.enter_context(batch_progress(stage, total))
        self._bars[stage](report)


def _as_row(run: "MatchRun") -> dict[str, Any]:
    counts = [
        len(each.indices) if each.verification is None else int(each.verification.inliers.sum())
        for each in run.matched
    ]
    verified = any(each.verification is not None for each in run.matched)
    row: dict[str, Any] = {
        "images": run.extraction.done + run.extraction.unchanged,
        "pairs": run.pairs,
        "done": run.done,
        "already_done": run.unchanged,
        "matches": sum(len(each.indices) for each in run.matched),
    }
    if verified:
        row |= {"verified_pairs": int(np.count_nonzero(counts)), "inliers": sum(counts)}
    return {
        **row,
        "complete": run.complete,
        "files": {name: str(path) for name, path in run.files.items()},
    }
