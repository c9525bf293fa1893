"""One door to every landmark log."""

from pathlib import Path
from typing import Literal, TypeAlias, cast, get_args

from saccade.datasets.archive import Archive
from saccade.datasets.logs.dlr import read_dlr
from saccade.datasets.logs.isam import Entries, read_isam
from saccade.datasets.logs.isam_writer import Dialect, write_isam
from saccade.datasets.logs.log_csv import read_log_csv, write_log_csv
from saccade.datasets.logs.mrclam import MRCLAM_ODOMETRY, MRCLAM_SENSOR, read_mrclam
from saccade.datasets.logs.mrclam_writer import write_mrclam
from saccade.datasets.logs.victoria_park import (
    VICTORIA_PARK_ODOMETRY,
    VICTORIA_PARK_SENSOR,
    Reference,
    read_victoria_park,
)
from saccade.datasets.odometry import OdometryNoise
from saccade.errors import ConfigError, LogError, require
from saccade.types import LandmarkLog

Kind: TypeAlias = Literal["auto", "csv", "g2o", "isam", "mrclam", "victoria-park", "dlr"]
"""The data sets; "auto" looks at the path and into the file."""
Format: TypeAlias = Literal["auto", "csv", "g2o", "isam", "toro", "gtsam", "mrclam"]
"""What a log can be written as; "auto" goes by the suffix."""
_FORMATS: dict[str, Format] = {".csv": "csv", ".g2o": "g2o", ".isam": "isam", ".graph": "toro"}


def load(
    kind: Kind,
    path: str | Path,
    *,
    robot: int | None = None,
    entries: Entries | None = None,
    odometry_noise: OdometryNoise | None = None,
    sensor_sigma: tuple[float, float] | None = None,
    reference: Reference | None = None,
) -> LandmarkLog:
    """Read a landmark log.

    Args:
        kind: "csv" (see `log_csv`), "g2o" or "isam" (g2o, iSAM, TORO or GTSAM text: one
            reader), "mrclam" (folder or .npz), "victoria-park" (raw .mat, or GTSAM's .txt),
            "dlr" (.npz), or "auto".
        path: the file or folder.
        robot: mrclam: which of the five; the first unless told otherwise.
        entries: g2o and isam: what the matrices are; found out unless told otherwise.
        odometry_noise: mrclam and the raw Victoria Park log: how far the odometry
            goes astray.
        sensor_sigma: mrclam and the raw Victoria Park log: standard deviations of
            range (m) and bearing (rad).
        reference: the raw Victoria Park log: whether poses are of the "laser", beside
            the GPS antenna, or of the rear "axle".

    Returns:
        The log.

    Raises:
        LogError: the file is missing, broken, or not of this kind; one line that
            names it.
        ConfigError: no such kind, or an argument that this kind does not have.
    """
    require(kind in get_args(Kind), "kind", f"one of {', '.join(get_args(Kind))}", kind)
    path = Path(path)
    if not path.exists():
        raise LogError(f"{path}: expected a landmark log, found no such file or folder")
    if kind == "auto":
        kind = detect_format(path)
    park = kind == "victoria-park" and path.suffix.lower() == ".mat"
    for name, given, has in (
        ("robot", robot, kind == "mrclam"),
        ("entries", entries, kind in ("g2o", "isam")),
        ("odometry_noise", odometry_noise, kind == "mrclam" or park),
        ("sensor_sigma", sensor_sigma, kind == "mrclam" or park),
        ("reference", reference, park),
    ):
        if given is not None and not has:
            raise ConfigError(f"{name}: {path} read as {kind} does not have it; leave it out")
    if kind == "mrclam":
        return read_mrclam(
            path,
            1 if robot is None else robot,
            odometry_noise or MRCLAM_ODOMETRY,
            sensor_sigma or MRCLAM_SENSOR,
        )
    if kind == "victoria-park":
        return read_victoria_park(
            path,
            odometry_noise or VICTORIA_PARK_ODOMETRY,
            sensor_sigma or VICTORIA_PARK_SENSOR,
            reference or "laser",
        )
    if kind == "dlr":
        return read_dlr(path)
    if kind == "csv":
        return read_log_csv(path)
    return read_isam(path, entries or "auto")


def save(path: str | Path, log: LandmarkLog, kind: Format = "auto") -> None:
    """Write a landmark log.

    Args:
        path: the file, or the folder of "mrclam".
        log: what to write.
        kind: "csv", which keeps everything but the truth; "g2o", "isam", "toro" or "gtsam", text
            without a clock (see `write_isam`); "mrclam", a folder of speeds without noise; or
            "auto": .csv, .g2o, .isam, .graph (TORO), a name without suffix (a folder of mrclam).

    Raises:
        LogError: the log holds what the format has no place for.
        OutputError: it cannot be written.
        ConfigError: no such format.
    """
    require(kind in get_args(Format), "kind", f"one of {', '.join(get_args(Format))}", kind)
    path = Path(path)
    if kind == "auto":
        known: dict[str, Format] = {**_FORMATS, "": "mrclam"}
        suffix = path.suffix.lower()
        require(suffix in known, "path", f"a file that ends in {', '.join(_FORMATS)}", str(path))
        kind = known[suffix]
    if kind == "csv":
        write_log_csv(path, log)
    elif kind == "mrclam":
        write_mrclam(path, log)
    else:
        write_isam(path, log, cast("Dialect", kind))


def detect_format(path: Path) -> Kind:
    """Which data set a file or folder is of.

    Raises:
        LogError: it is none of them.
    """
    if path.is_dir():
        if (path / "Barcodes.dat").exists():
            return "mrclam"
        raise LogError(f"{path}: expected a folder with Barcodes.dat (mrclam), found none")
    if path.suffix.lower() == ".mat":
        return "victoria-park"
    if path.suffix.lower() == ".npz":
        archive = Archive(path)
        if "barcodes" in archive:
            return "mrclam"
        if "observations" in archive:
            return "dlr"
        found = ", ".join(sorted(archive.tables))
        raise LogError(f"{path}: expected the tables of mrclam or dlr, found {found[:80]}")
    return "csv" if path.suffix.lower() == ".csv" else "isam"
