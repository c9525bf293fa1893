"""`saccade index` and `saccade find`: which images of a data set show the same thing."""

from pathlib import Path
from typing import Annotated, Any

import typer

from saccade.cli.options import Json


def index(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A data set of points, as extract made it.")
    ],
    points: Annotated[
        int, typer.Option(min=1, metavar="N", help="Of each image at most; the strongest.")
    ] = 1000,
    as_json: Json = False,
) -> None:
    """Make an index of extracted points, for `saccade find`.

    It appears in DIR/index, and is made anew when images have come.
    """
    _require()
    from saccade.batch.index import FOLDER, build_index
    from saccade.cli.output import print_json, print_table

    made = build_index(folder, points)
    if as_json:
        print_json(made)
        return
    print_table(
        f"index -> {folder / FOLDER}", ["", ""], [(name, f"{n:,}") for name, n in made.items()]
    )


def find(
    image: Annotated[Path, typer.Argument(metavar="IMAGE", help="What to look for.")],
    folder: Annotated[
        Path, typer.Option("--in", metavar="DIR", help="A data set with an index.")
    ] = Path("saccade-extract"),
    top: Annotated[int, typer.Option(min=1, metavar="N", help="Images to list.")] = 10,
    candidates: Annotated[
        int, typer.Option(min=1, metavar="N", help="Images whose geometry is checked.")
    ] = 30,
    min_inliers: Annotated[
        int, typer.Option(min=8, metavar="N", help="Inliers of one geometry that confirm an image.")
    ] = 15,
    as_json: Json = False,
) -> None:
    """List the images that show the same thing as IMAGE, the surest first.

    The points of IMAGE are found as those of the data set were. Images with
    similar points are candidates; of each it is counted how many matches agree on
    one geometry of the two views. The exit code is 1 where no image has enough.
    """
    _require()
    from saccade.batch.index import Index
    from saccade.cli.output import print_json, print_message, print_table

    retrieval = Index(folder)
    found = retrieval.find(
        _points(retrieval, image), candidates=max(candidates, top), min_inliers=min_inliers
    )
    confirmed = [each for each in found if each.inliers is not None][:top]
    rows: list[dict[str, Any]] = [
        {"image": each.image, "inliers": each.inliers, "similarity": float(each.similarity)}
        for each in confirmed
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
        print_message(f"{image}: none of {len(retrieval)} images shows the same thing")
        raise typer.Exit(1)


def _points(retrieval: Any, image: Path) -> Any:
    """The points of an image, found with the settings of the data set."""
    from saccade.image import read_image
    from saccade.keypoints import Must, Sift, SymRoid
    from saccade.settings import settings_from

    detector = {"sift": Sift, "must": Must, "symroid": SymRoid}[retrieval.what]
    points = detector(settings_from(retrieval.what, retrieval.settings, "index"))(read_image(image))
    return getattr(points, "keypoints", points)


def _require() -> None:
    from saccade.extras import import_optional

    import_optional("pyarrow", "parquet")
    import_optional("faiss", "find")
