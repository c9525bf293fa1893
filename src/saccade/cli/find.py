"""`saccade find`: image retrieval from extracted keypoints."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from saccade.cli.detect import DETECTORS, keypoints_of
from saccade.cli.group import argument, option
from saccade.cli.options import JsonOption
from saccade.cli.output import Result, Table, facts_table, print_message
from saccade.extras import import_optional
from saccade.io.image import read_image
from saccade.settings import settings_from

CANDIDATES = 30
"""Images that are verified geometrically."""


@dataclass(frozen=True, kw_only=True)
class FindOptions(JsonOption):
    """Options of `saccade find`."""

    image: Path | None = argument("IMAGE", None)
    """Query image; without one the index is made anew."""
    folder: Path = option(Path("saccade-extract"), "--in", metavar="DIR")
    """Data set of keypoints, of saccade extract."""
    top: int = option(10, min=1)
    """Maximum number of results."""
    min_inliers: int = option(15, min=8)
    """Minimum number of epipolar inliers."""
    points: int | None = option(None, min=1)
    """Make the index anew, of the N strongest keypoints of each image; 1000 by default."""


def find(options: FindOptions) -> Result:
    """List the images that show the same scene as IMAGE, best first.

    Keypoints of IMAGE are detected with the settings of the data set. Images
    with similar keypoints are candidates, ranked by the number of matches that
    are inliers of one epipolar geometry. Exit code 1: no image has enough.

    The index is written to DIR/index where there is none. When images were
    added it has to be made anew: without IMAGE, or with --points.
    """
    import_optional("pyarrow", "parquet")
    import_optional("faiss", "find")
    from saccade.batch.index import FOLDER, Index, build_index

    image, folder = options.image, options.folder
    query = None if image is None else read_image(image)
    if query is None or options.points is not None or not (folder / FOLDER).exists():
        row = build_index(folder, options.points or 1000)
        if query is None:
            return Result(row, [facts_table(f"index -> {folder / FOLDER}", row)])
        print_message(f"index of {row['images']:,} images -> {folder / FOLDER}")
    data = Index(folder)
    detector = DETECTORS[data.what](settings_from(data.what, data.settings, "index"))
    points = keypoints_of(detector(query))
    candidates = max(CANDIDATES, options.top)
    found = data.find(points, candidates=candidates, min_inliers=options.min_inliers)
    confirmed = [each for each in found if each.inliers is not None]
    rows: list[dict[str, Any]] = [
        {"image": each.image, "inliers": each.inliers, "similarity": float(each.similarity)}
        for each in confirmed[: options.top]
    ]
    if not rows:
        print_message(f"{image}: none of {len(data)} images shows the same scene")
    cells = [[row["image"], str(row["inliers"]), f"{row['similarity']:.1f}"] for row in rows]
    table = Table(f"{image} in {folder}", ["image", "inliers", "similarity"], cells)
    return Result({"image": str(image), "found": rows}, [table] if rows else [], int(not rows))
