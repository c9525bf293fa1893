"""`saccade convert`: a landmark log, or extracted keypoints, in another format."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from cyclopts import Parameter

from saccade import datasets
from saccade.cli.options import OUTPUT, JsonOptions
from saccade.cli.output import Result, facts_table
from saccade.cli.recordings import LogOptions
from saccade.datasets.logs.formats import LOG_FORMATS
from saccade.errors import require
from saccade.extras import import_optional

FORMATS_HELP = (
    f"Format of FILE: {' or '.join(name for name, form in LOG_FORMATS.items() if form.write)} "
    "for logs, colmap or hdf5 for keypoints; by default from its suffix."
)
"""Help of --to."""


@dataclass(frozen=True, kw_only=True)
class ConvertOptions(LogOptions, JsonOptions):
    """Options of `saccade convert`."""

    to: Annotated[str | None, OUTPUT, Parameter(help=FORMATS_HELP)] = None


Log: TypeAlias = Annotated[
    str,
    Parameter(help="Landmark log: a file, folder or ROS bag; or keypoints of saccade extract."),
]
File: TypeAlias = Annotated[Path, Parameter(help="File or folder to write.")]


def convert(log: Log, file: File, /, options: ConvertOptions = ConvertOptions()) -> Result:
    """Convert a landmark log or extracted keypoints to another format.

    Landmark logs: csv keeps everything except the true landmarks; its header
    names the columns. g2o is a pose graph in text form, without time stamps;
    it requires a label for every observation.

    Keypoints: colmap (database, .db) and hdf5 (in the layout of hloc, .h5)
    write one file for all images.

    Example: saccade convert victoria_park.txt park.g2o
    """
    to = options.to
    if "://" in log or (Path(log) / "manifest.json").exists():
        row, name = _convert_points(log, file, to), log
    else:
        loaded = options.load(Path(log))
        datasets.save(file, loaded, to or "auto")
        counts = {"poses": len(loaded.time), "observations": len(loaded.observation)}
        row, name = {"log": loaded.name, **counts, "file": str(file)}, loaded.name
    return Result(row, [facts_table(f"{name} -> {file}", row)])


def _convert_points(folder: str, file: Path, to: str | None) -> dict[str, Any]:
    """Export the keypoints of a data set to COLMAP or hloc."""
    import_optional("pyarrow", "parquet")
    from saccade.batch.dataset import EXPORTS, export_points

    form = to or {".db": "colmap", ".h5": "hdf5", ".hdf5": "hdf5"}.get(file.suffix, "")
    require(form in EXPORTS, "--to", f"{' or '.join(EXPORTS)} for keypoints", to or file.name)
    return {"images": export_points(folder, form, file), "format": form, "file": str(file)}
