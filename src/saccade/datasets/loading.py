"""One door to every landmark log."""

from pathlib import Path
from typing import Literal, TypeAlias, get_args

from saccade.datasets.archive import Archive
from saccade.datasets.dlr import read_dlr
from saccade.datasets.isam import Entries, read_isam
from saccade.datasets.mrclam import MRCLAM_ODOMETRY, MRCLAM_SENSOR, read_mrclam
from saccade.datasets.odometry import OdometryNoise
from saccade.datasets.victoria_park import (
    VICTORIA_PARK_ODOMETRY,
    VICTORIA_PARK_SENSOR,
    Reference,
    read_victoria_park,
)
from saccade.errors import ConfigError, LogError, require
from saccade.types import LandmarkLog

Kind: TypeAlias = Literal["auto", "victoria-park", "mrclam", "isam", "dlr"]
"""The data sets; "auto" looks at the path and into the file."""


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
        kind: "victoria-park" (raw .mat, or GTSAM's .txt), "mrclam" (folder or
            .npz), "isam" (iSAM, TORO or GTSAM text), "dlr" (.npz), or "auto".
        path: the file or folder.
        robot: mrclam: which of the five; the first unless told otherwise.
        entries: isam: what the matrices are; found out unless told otherwise.
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
        kind = recognize(path)
    park = kind == "victoria-park" and path.suffix.lower() == ".mat"
    for name, given, has in (
        ("robot", robot, kind == "mrclam"),
        ("entries", entries, kind == "isam"),
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
    return read_isam(path, entries or "auto")


def recognize(path: Path) -> Kind:
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
    return "isam"
