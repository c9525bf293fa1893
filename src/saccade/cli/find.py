"""`saccade find`: image retrieval from an indexed data set."""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from saccade.cli.options import Json


def find(
    image: Annotated[Path, Argument(metavar="IMAGE", help="Query image.")],
    folder: Annotated[Path, Option("--in", metavar="DIR", help="Data set with an index.")] = Path(
        "saccade-extract"
    ),
    top: Annotated[int, Option(min=1, metavar="N", help="Maximum number of results.")] = 10,
    candidates: Annotated[
        int, Option(min=1, metavar="N", help="Candidates that are verified geometrically.")
    ] = 30,
    min_inliers: Annotated[
        int, Option(min=8, metavar="N", help="Minimum number of epipolar inliers.")
    ] = 15,
    as_json: Json = False,
) -> None:
    """List the images that show the same scene as IMAGE, best first.

    Keypoints of IMAGE are detected with the settings of the data set. Images
    with similar keypoints are candidates, ranked by the number of matches that
    are inliers of one epipolar geometry. Exit code 1: no image has enough.
    """
    from saccade.cli.output import print_json, print_message, print_table
    from saccade.extras import import_optional

    import_optional("pyarrow", "parquet")
    import_optional("faiss", "find")
    from saccade.batch.index import Index

    data = Index(folder)
    found = data.find(
        _keypoints(data, image), candidates=max(candidates, top), min_inliers=min_inliers
    )
    confirmed = [each for each in found if each.inliers is not None]
    rows: list[dict[str, Any]] = [
        {"image": each.image, "inliers": each.inliers, "similarity": float(each.similarity)}
        for each in confirmed[:top]
    ]
    if as_json:
        print_json({"image": str(image), "found": rows})
    elif rows:
        print_table(
            f"{image} in {folder}",
            ["image", "inliers", "similarity"],
            [[row["image"], str(row["inliers"]), f"{row['similarity']:.1f}"] for row in rows],
        )
    if not rows:
        print_message(f"{image}: none of {len(data)} images shows the same scene")
        raise typer.Exit(1)


def _keypoints(data: Any, image: Path) -> Any:
    """Keypoints of an image, detected with the settings of the data set."""
    from saccade.io.image import read_image
    from saccade.keypoints import Must, Sift, SymRoid
    from saccade.settings import settings_from

    detector = {"sift": Sift, "must": Must, "symroid": SymRoid}[data.what]
    detections = detector(settings_from(data.what, data.settings, "index"))(read_image(image))
    return getattr(detections, "keypoints", detections)
