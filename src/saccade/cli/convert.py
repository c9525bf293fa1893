"""`saccade convert`: a landmark log, or extracted keypoints, in another format."""

from pathlib import Path
from typing import Annotated, Any, cast

from typer import Argument, Option

from saccade import datasets
from saccade.cli.options import Json, LogFormat, Robot, Topics
from saccade.cli.output import emit_facts
from saccade.errors import require
from saccade.extras import import_optional
from saccade.io.files import results_in


def convert(
    source: Annotated[
        str,
        Argument(
            metavar="LOG|DIR",
            help="Landmark log: a file, folder or ROS bag; or keypoints of saccade extract.",
        ),
    ],
    file: Annotated[Path, Argument(metavar="FILE", help="File or folder to write.")],
    kind: LogFormat = None,
    to: Annotated[
        str | None,
        Option(
            help="Format of FILE: csv, g2o, isam, toro, gtsam or mrclam; of keypoints colmap, "
            "hdf5, opencv or csv; given by its suffix by default."
        ),
    ] = None,
    robot: Robot = None,
    topic: Topics = None,
    as_json: Json = False,
) -> None:
    """Convert a landmark log or extracted keypoints to another format.

    Of a log csv keeps everything but the ground truth; its header names the
    columns. g2o, isam, toro and gtsam are pose graphs as text, without time
    stamps; mrclam is a folder of velocities without covariance. All but csv
    need the identity of every landmark.

    Of keypoints colmap (database, .db) and hdf5 (in the layout of hloc, .h5)
    are one file for all images; csv (without descriptors) and opencv (YAML of
    keypoints and descriptors, for cv::FileStorage) are folders with a file for
    each image.
    """
    if "://" in source or (Path(source) / "manifest.json").exists():
        row = _convert_points(source, file, to)
        emit_facts(row, as_json, f"{source} -> {file}")
        return
    recorded = datasets.load(
        cast("datasets.Kind", kind or "auto"), Path(source), robot=robot, topic=topic
    )
    datasets.save(file, recorded, cast("datasets.Format", to or "auto"))
    row = {
        "log": recorded.name,
        "poses": len(recorded.time),
        "observations": len(recorded.observation),
        "file": str(file),
    }
    emit_facts(row, as_json, f"{recorded.name} -> {file}")


def _convert_points(folder: str, file: Path, to: str | None) -> dict[str, Any]:
    """Write the keypoints of a data set in the format of another program."""
    import_optional("pyarrow", "parquet")
    from saccade.batch.dataset import FILE_FORMATS, FOLDER_FORMATS, export_points

    form = to or {".db": "colmap", ".h5": "hdf5", ".hdf5": "hdf5"}.get(file.suffix, "")
    names = [*FILE_FORMATS, *FOLDER_FORMATS]
    require(form in names, "--to", f"one of {', '.join(names)} for keypoints", to or file.name)
    with results_in(file, is_file=form in FILE_FORMATS):
        images = export_points(folder, form, file)
    return {"images": images, "format": form, "file": str(file)}
