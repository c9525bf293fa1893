"""`saccade export`: an extracted data set in another format."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from saccade.cli.options import Json


class Format(StrEnum):
    """File formats of keypoints."""

    COLMAP = "colmap"
    HDF5 = "hdf5"
    OPENCV = "opencv"
    CSV = "csv"


def export(
    folder: Annotated[
        str, Argument(metavar="DIR", help="Data set of keypoints written by saccade extract.")
    ],
    to: Annotated[Format, Option("--format", "-f", help="Output format.")] = Format.HDF5,
    out: Annotated[
        Path | None, Option("--out", "-o", help="Output file; for csv and opencv a folder.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Export extracted keypoints to the format of another program.

    colmap (database) and hdf5 (in the layout of hloc) are one file for all
    images; csv (without descriptors) and opencv (YAML of keypoints and
    descriptors, for cv::FileStorage) are folders with a file for each image.
    """
    from saccade.cli.output import print_result
    from saccade.extras import import_optional

    import_optional("pyarrow", "parquet")
    from saccade.batch.export import EXPORTS, FileFormat, export_points
    from saccade.io.files import results_in

    target = out or Path(EXPORTS[to.value].default_name)
    with results_in(target, is_file=isinstance(EXPORTS[to.value], FileFormat)):
        images = export_points(folder, to.value, target)
    row: dict[str, Any] = {"images": images, "format": to.value, "out": str(target)}
    print_result(row, as_json, f"{folder} -> {target}")
