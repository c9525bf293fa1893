"""`saccade match`: keypoint matches of two or more images."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, cast, get_args

import numpy as np
from cyclopts import Parameter

from saccade.cli.detect import CameraMode, CameraModel, DetectorOptions
from saccade.cli.options import (
    EXECUTION,
    INPUT,
    OUTPUT,
    SEVERAL,
    FigureFormat,
    JsonOptions,
    OutputFolder,
    figure_formats,
)
from saccade.cli.output import (
    INTERRUPTED,
    Result,
    Table,
    facts_table,
    print_message,
    stop_on_interrupt,
    write_text,
)
from saccade.errors import require, setting
from saccade.exchange.colmap_cameras import parse_cameras
from saccade.extras import import_optional
from saccade.io.files import results_in
from saccade.io.image import as_rgb
from saccade.io.masks import check_masks
from saccade.io.preparation import warnings_of
from saccade.keypoints import Verification, verify
from saccade.keypoints import match as nearest_matches
from saccade.keypoints.detectors import DEFAULT_DETECTOR, keypoints_of
from saccade.keypoints.guided import verified_again
from saccade.keypoints.two_view_fit import Geometry
from saccade.keypoints.verification import MIN_INLIERS

if TYPE_CHECKING:
    from saccade.batch import Job
    from saccade.batch.matching import Format as ManyFormat
    from saccade.batch.matching import MatchRun
    from saccade.viewing.report import ReportBuilder


FORMATS = {"two images": get_args(FigureFormat), "many images": ("hdf5", "colmap")}
"""File formats of the figures, and of the matches."""


@dataclass(frozen=True, kw_only=True)
class MatchOptions(DetectorOptions, JsonOptions):
    """Options of `saccade match`."""

    pairs: Annotated[str | None, INPUT] = None
    """Pairs to match among many images: a file with two names per line; sequential:N for each image
    with the next N; gps:N for each with the N nearest by the GPS positions of their EXIF data. All
    pairs by default."""
    root: Annotated[str | None, INPUT, Parameter(metavar="DIR")] = None
    """Folder from which the paths in a list of images start; by default that of the list."""
    features: Annotated[Path | None, INPUT, Parameter(metavar="FILE")] = None
    """Keypoints of many images from a file, in place of a detector: HDF5 as saccade detect, match
    and hloc write it, or a database.db of COLMAP, with the names of the images."""
    out: OutputFolder = Path("saccade-match")
    ratio: float = setting(0.8, 0, 1)
    """Ratio test: maximum nearest / second nearest distance, 0 to 1."""
    geometry: Literal["fundamental", "homography", "none"] = "fundamental"
    """Geometric verification: fundamental matrix (any rigid scene), homography (a plane or a
    rotating camera), or none."""
    tolerance: Annotated[float, Parameter(metavar="PX")] = setting(2.0, 0.01)
    """Inlier threshold, at least .01."""
    formats: Annotated[
        list[Literal["png", "svg", "pdf", "hdf5", "colmap"]] | None,
        OUTPUT,
        SEVERAL,
        Parameter(("--format", "-f")),
    ] = None
    """Output format for the figure of two images: png (the default), svg or pdf; for many images:
    hdf5 (for hloc, the default) or colmap; several with commas."""
    min_inliers: int = setting(MIN_INLIERS, 1)
    """Smallest number of distinct inliers of an accepted geometry."""
    guided: bool = False
    """Match verified pairs again along their epipolar lines or homography, and verify the result.
    Its ratio test lies halfway between --ratio and 1."""
    camera: CameraModel = None
    camera_mode: CameraMode = None
    workers: Annotated[int | None, EXECUTION] = setting(None, 1)
    """Number of processes; by default as many as cores and memory allow."""

    @property
    def verification(self) -> Geometry | None:
        """Geometry that verifies the matches; None for no verification."""
        return None if self.geometry == "none" else self.geometry


First: TypeAlias = Annotated[
    str,
    Parameter(
        help="First image; or, without SECOND, many images: a folder, quoted pattern or list."
    ),
]
Second: TypeAlias = Annotated[Path | None, Parameter(help="Second image of the same scene.")]


def match(first: First, second: Second = None, /, options: MatchOptions = MatchOptions()) -> Result:
    """Match the keypoints of two or more images.

    Mutual nearest neighbors that pass the ratio test are verified by two-view
    geometry (OpenCV's USAC, deterministic). Two images: --out
    receives a figure (matches.png), an interactive report (report.html) and a
    table (matches.csv: indices and coordinates in both images, and 1 for
    inliers).

    Many images: --out receives features.h5 and matches.h5 (in the layout of
    hloc) or database.db (for COLMAP, with two-view geometries), the counts for
    each pair (pairs.csv) and the pairs (pairs.txt). Repeating the command resumes
    an interrupted run and matches new or changed images.

    Example: saccade match left.jpg right.jpg --geometry homography
    """
    from saccade.viewing.report import ReportBuilder

    words = "many images" if second is None else "two images"
    chosen = list(dict.fromkeys(options.formats or FORMATS[words][:1]))
    verified = options.verification is not None or not options.guided
    require(verified, "guided", "--geometry fundamental or homography", options.geometry)
    for each in chosen:
        expected = f"{' or '.join(FORMATS[words])} for {words}"
        require(each in FORMATS[words], "format", expected, each)
    if second is None:
        return match_many(first, options, chosen)
    many = ("pairs", "root", "features", "workers", "camera", "camera_mode")
    given = any(getattr(options, name) is not None for name in many)
    expected = "--pairs, --root, --features, --camera, --camera-mode and --workers with many images"
    require(not given, "pairs", expected, str(second))
    builder = ReportBuilder("saccade match", LEAD)
    with results_in(options.out):
        row = match_images(options.make_detector(), (Path(first), second), options, builder)
        row["report"] = str(builder.write(options.out / "report.html"))
    shared = [str(row["matches"])] + ([str(row["inliers"])] if "inliers" in row else [])
    columns = ["image", "points", "matched", "inliers"][: 2 + len(shared)]
    if row.get("matrix", ()) is None:
        print_message(
            f"{row['inliers']} of {row['matches']} matches agree with a geometry; "
            f"{options.min_inliers} are required (--min-inliers)"
        )
    cells = [[row[name], str(row[f"{name}_points"]), *shared] for name in ("first", "second")]
    return Result(row, [Table(f"matches -> {options.out}", columns, cells)])


LEAD = "Matching interest points of two photographs."
TEXT = (
    "Lines join matched points, with inliers and outliers of the geometry. Click near the end of "
    "a line to see a single match."
)


def match_images(
    detector: Any, paths: tuple[Path, Path], options: MatchOptions, builder: "ReportBuilder"
) -> dict[str, Any]:
    """Match two images: write matches.png and .csv, return the row for --json."""
    from saccade.viewing import Section, match_figure, save_figures
    from saccade.viewing.report import match_part

    first, second = paths
    out, geometry = options.out, options.verification
    figures = figure_formats(options.formats)
    check_masks(options.masks)
    found = []
    for path in paths:
        with warnings_of(str(path)):
            image, mask = options.read(path, path.name)
            found.append((as_rgb(image), keypoints_of(detector(image, mask))))
    images, keypoints = (found[0][0], found[1][0]), (found[0][1], found[1][1])
    pairs = nearest_matches(*keypoints, ratio=options.ratio)
    verified = None
    if geometry is not None:
        verified = verify(*keypoints, pairs, geometry, options.tolerance, options.min_inliers)
        if options.guided:
            ratio, tolerance = options.ratio, options.tolerance
            pairs, verified = verified_again(
                *keypoints, pairs, verified, ratio=ratio, tolerance=tolerance
            )
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
    if verified is not None:
        facts["model"] = verified.model or f"none: {options.min_inliers} inliers are required"
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
            "model": verified.model,
            "matrix": None if verified.matrix is None else verified.matrix.tolist(),
            "corner_sigma_px": corner_sigma(verified, images[0].shape),
        }
    return row


def corner_sigma(verified: Verification, shape: tuple[int, ...]) -> float | None:
    """Standard deviation in pixels of the least certain corner under a homography, if known."""
    if verified.geometry != "homography" or verified.covariance is None:
        return None
    height, width = shape[:2]
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)
    return float(np.sqrt(np.linalg.eigvalsh(verified.projection_covariance(corners)).max()))


def match_many(source: str, options: MatchOptions, formats: Sequence[str]) -> Result:
    """Match many images, with progress bars for images and pairs."""
    given = options.preset or options.config or options.features
    if "colmap" in formats and options.detector == DEFAULT_DETECTOR and given is None:
        options = replace(options, preset="mapping")
    import_optional("pyarrow", "parquet")
    from saccade.batch import MatchConfig
    from saccade.batch.matching import FEATURES, match_images
    from saccade.cli.extract import batch_progress, print_failures

    require(options.camera is None or "colmap" in formats, "camera", "--format colmap", formats)
    bars: dict[str, Callable[[int, int, int], None]] = {}
    with ExitStack() as stack:

        def show(stage: str, done: int, failed: int, total: int) -> None:
            if stage not in bars:
                bars[stage] = stack.enter_context(batch_progress(stage))
            bars[stage](done, failed, total)

        run = match_images(
            source,
            options.out,
            pairs=options.pairs,
            root=options.root,
            job=features_of(options),
            config=MatchConfig(
                options.ratio,
                geometry=options.verification,
                tolerance=options.tolerance,
                min_inliers=options.min_inliers,
                guided=options.guided,
            ),
            formats=cast("Sequence[ManyFormat]", formats),
            cameras=parse_cameras(options.camera),
            camera_mode=options.camera_mode,
            workers=options.workers,
            should_stop=stack.enter_context(stop_on_interrupt()),
            on_progress=show,
        )
    row, code = _as_row(run), 0
    if not run.complete:
        total, code = run.done + run.unchanged, INTERRUPTED
        print_message(f"stopped after {total} of {run.pairs} pairs; run it again to resume")
    elif run.extraction.failed:
        code = 1
        print_message(
            f"{len(run.extraction.failed)} images failed, and {run.pairs - len(run.matched)} pairs "
            f"are left out; see {options.out / FEATURES}/images.parquet"
        )
        print_failures(run.extraction.failed)
    table = facts_table(f"{source} -> {options.out}", row | row["files"])
    return Result(row, [table], code)


def features_of(options: MatchOptions) -> "Job":
    """The features of many images: those of a detector, or of a file.

    Raises:
        ConfigError: settings of a detector with a file, or those that it does not have.
    """
    from saccade.batch import Job
    from saccade.batch.job import FROM_FILE

    masks = None if options.masks is None else str(options.masks)
    if options.features is not None:
        given = [options.preset, options.config, options.max_keypoints]
        own = options.detector != DEFAULT_DETECTOR or any(each is not None for each in given)
        found = "settings of a detector"
        require(not own, "features", "no --detector, --preset, --config and --max", found)
        require(not options.stretch, "features", "no --stretch", "--stretch")
        return Job(FROM_FILE, masks=masks, file=str(options.features))
    settings = options.detector_settings()
    limited = settings is None and options.max_keypoints is not None
    require(not limited, "max", "a detector in the table for many images", options.detector)
    return Job(options.detector, settings, stretch=options.stretch, masks=masks)


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
