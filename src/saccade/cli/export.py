"""`saccade export`: extracted points in the formats of others."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from saccade.cli.options import Json


class Format(StrEnum):
    """Files that points are written to."""

    COLMAP = "colmap"
    HDF5 = "hdf5"
    OPENCV = "opencv"
    CSV = "csv"


def export(
    folder: Annotated[
        str, typer.Argument(metavar="DIR", help="A data set of points, as extract made it.")
    ],
    to: Annotated[
        Format, typer.Option("--format", "-f", help="colmap, hdf5 (hloc), opencv or csv.")
    ] = Format.HDF5,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File, or folder of csv and opencv.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write extracted points in the format of another program.

    One file for all images: colmap (a database), hdf5 (as hloc reads it). A file
    for each image, in a folder: csv (no descriptors), opencv (keypoints and
    descriptors as YAML, for cv::FileStorage).
    """
    from saccade.cli.output import print_json, print_table
    from saccade.extras import import_optional

    import_optional("pyarrow", "parquet")
    from saccade.batch.export import EXPORTS, export_points

    target = out or Path(EXPORTS[to.value].default_name)
    images = export_points(folder, to.value, target)
    row: dict[str, Any] = {"images": images, "format": to.value, "out": str(target)}
    if as_json:
        print_json(row)
        return
    print_table(f"{folder} -> {target}", ["", ""], [(name, str(v)) for name, v in row.items()])
