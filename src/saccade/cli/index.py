"""`saccade index`: an index of extracted keypoints."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from saccade.cli.options import Json


def index(
    folder: Annotated[
        Path, Argument(metavar="DIR", help="Data set of keypoints written by saccade extract.")
    ],
    points: Annotated[
        int, Option(min=1, metavar="N", help="Keypoints per image, the strongest.")
    ] = 1000,
    as_json: Json = False,
) -> None:
    """Build an index of extracted keypoints, for saccade find.

    It is written to DIR/index, and has to be built again when images are added.
    """
    from saccade.cli.output import print_result
    from saccade.extras import import_optional

    import_optional("pyarrow", "parquet")
    import_optional("faiss", "find")
    from saccade.batch.index import FOLDER, build_index

    row = build_index(folder, points)
    facts = {name: f"{value:,}" for name, value in row.items()}
    print_result(row, as_json, f"index -> {folder / FOLDER}", facts)
