"""`saccade find`: image retrieval from extracted keypoints."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from saccade.cli.options import Json
from saccade.cli.output import Table, emit, print_message
from saccade.extras import import_optional
from saccade.io.image import read_image
from saccade.keypoints import Must, Sift, SymRoid
from saccade.settings import settings_from

if TYPE_CHECKING:
    from saccade.batch.index import Index


def find(
    image: Annotated[
        Path | None,
        Argument(metavar="IMAGE", help="Query image; without one the index is made anew."),
    ] = None,
    folder: Annotated[
        Path, Option("--in", metavar="DIR", help="Data set of keypoints, of saccade extract.")
    ] = Path("saccade-extract"),
    top: Annotated[int, Option(min=1, metavar="N", help="Maximum number of results.")] = 10,
    candidates: Annotated[
        int, Option(min=1, metavar="N", help="Candidates that are verified geometrically.")
    ] = 30,
    min_inliers: Annotated[
        int, Option(min=8, metavar="N", help="Minimum number of epipolar inliers.")
    ] = 15,
    points: Annotated[
        int | None,
        Option(
            min=1,
            metavar="N",
            help="Make the index anew, of the N strongest keypoints of each image; 1000 by "
            "default.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
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

    if image is not None:
        query = read_image(image)
    if image is None or points is not None or not (folder / FOLDER).exists():
        row = build_index(folder, points or 1000)
        facts = [(name, f"{value:,}") for name, value in row.items()]
        if image is None:
            emit(row, as_json, Table(f"index -> {folder / FOLDER}", ["", ""], facts))
            return
        print_message(f"index of {row['images']:,} images -> {folder / FOLDER}")
    data = Index(folder)
    found = data.find(
        _keypoints(data, query), candidates=max(candidates, top), min_inliers=min_inliers
    )
    confirmed = [each for each in found if each.inliers is not None]
    rows: list[dict[str, Any]] = [
        {"image": each.image, "inliers": each.inliers, "similarity": float(each.similarity)}
        for each in confirmed[:top]
    ]
    cells = [[row["image"], str(row["inliers"]), f"{row['similarity']:.1f}"] for row in rows]
    table = Table(f"{image} in {folder}", ["image", "inliers", "similarity"], cells)
    emit({"image": str(image), "found": rows}, as_json, *([table] if rows else []))
    if not rows:
        print_message(f"{image}: none of {len(data)} images shows the same scene")
        raise typer.Exit(1)


def _keypoints(data: "Index", image: Any) -> Any:
    """Keypoints of an image, detected with the settings of the data set."""
    detector = {"sift": Sift, "must": Must, "symroid": SymRoid}[data.what]
    detections = detector(settings_from(data.what, data.settings, "index"))(image)
    return getattr(detections, "keypoints", detections)
