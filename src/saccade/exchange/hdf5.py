"""HDF5 as hloc, the toolbox for visual localization, keeps it: a group for every image.

A group holds `keypoints` (n, 2), `scores` (n,), `scales` (n,) and `oris` (n,) in degrees,
`descriptors` (d, n) of unit length, and `image_size` (width, height), which matchers ask for.
As here, the centre of the first pixel is (0, 0): hloc adds the half pixel of COLMAP's when it
imports. `octaves` and `norms`, which it does not know, bring back what we wrote.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.exchange.fields import check_name, checked, keypoints_from, reading
from saccade.extras import import_optional
from saccade.files import atomic_write
from saccade.formats import FORMATS, check_format
from saccade.npz import check_unpacked
from saccade.types import Float32Array, Keypoints

NOTE = "saccade_format"
"""Attribute with the version of files that are ours."""
QUANTUM = 512
"""Of a unit descriptor in 8 bits, in files that do not say."""


def write_hdf5(
    path: str | Path,
    keypoints: Mapping[str, Keypoints],
    shapes: Mapping[str, tuple[int, ...]] | None = None,
) -> None:
    """Write the features of many images to one file.

    Args:
        path: whole or not at all; an old file is replaced.
        keypoints: by the name of their image, as hloc lists it: a path from its folder.
        shapes: (H, W, ...) of each image; hloc's learned matchers need them, others do not.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        ConfigError: h5py is not installed.
        OutputError: the file cannot be written.
    """
    h5py = import_optional("h5py", "hdf5")
    with atomic_write(path) as temporary, _created(h5py, temporary) as file:
        file.attrs[NOTE] = FORMATS["points"]
        for name, points in keypoints.items():
            group = file.create_group(check_name(name))
            for field, values in _datasets(checked(name, points)).items():
                group.create_dataset(field, data=values)
            if shapes is not None and name in shapes:
                height, width = shapes[name][:2]
                group.create_dataset("image_size", data=np.array([width, height]))


@contextmanager
def _created(h5py: Any, path: Path) -> Iterator[Any]:
    """A new HDF5 file.

    Raises:
        OSError: it cannot be written.
    """
    with _Patient(path, "w+b") as raw:
        try:
            with h5py.File(raw, "w") as file:
                yield file
        finally:
            if raw.failure is not None:
                raise raw.failure


class _Patient(FileIO):
    """A file that tells at the end what could not be written: h5py kills the process meanwhile."""

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of it, or nothing that counts."""
        left = memoryview(data).cast("B")
        try:
            while left:
                left = left[super().write(left) :]
        except OSError as error:
            self.failure = self.failure or error
        return len(memoryview(data).cast("B"))

    def truncate(self, size: int | None = None) -> int:
        """Give the file a size."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0


def read_hdf5(path: str | Path) -> dict[str, Keypoints]:
    """Read features as `write_hdf5` or hloc with SIFT writes them.

    Returns:
        Points by the name of their image, in the order of the names.

    Raises:
        KeypointsError: the file is missing or something else, an image lacks keypoints, or its
            descriptors are not of SIFT's kind, which has no entry below 0.
        ConfigError: h5py is not installed.
    """
    h5py = import_optional("h5py", "hdf5")
    path = Path(path)
    groups: list[str] = []

    unpacked = 0

    def visit(name: str, item: Any) -> None:
        nonlocal unpacked
        if isinstance(item, h5py.Dataset):
            unpacked += item.nbytes
            if name.endswith("/keypoints"):
                groups.append(name.removesuffix("/keypoints"))

    # The library raises what the broken bytes happen to provoke.
    with reading(path, "an HDF5 file of features", Exception), h5py.File(path, "r") as file:
        if NOTE in file.attrs:
            check_format("points", file.attrs[NOTE].tolist(), path, KeypointsError)
        file.visititems(visit)
        check_unpacked(path.stat().st_size, unpacked)
        if len(file) and not groups:
            raise KeypointsError(f"{path}: expected groups with keypoints, found none")
        return {name: _points(f"{path}: {name}", file[name]) for name in groups}


def _datasets(points: Keypoints) -> dict[str, npt.NDArray[Any]]:
    fields: dict[str, npt.NDArray[Any]] = {
        "keypoints": points.xy,
        "scores": points.response,
        "scales": points.size / 2,
        "oris": np.degrees(points.angle.astype(np.float64)),
        "octaves": points.octave,
    }
    if points.descriptors is not None:
        rows = points.descriptors.astype(np.float32)
        norms = np.linalg.norm(rows, axis=1)
        fields["descriptors"] = (rows / np.maximum(norms, 1)[:, None]).T
        fields["norms"] = norms
    return fields


def _points(source: str, group: Any) -> Keypoints:
    def field(name: str) -> npt.NDArray[Any] | None:
        return np.asarray(group[name][()]) if name in group else None

    scales, oris, rows = (field(each) for each in ("scales", "oris", "descriptors"))
    return keypoints_from(
        source,
        np.asarray(group["keypoints"][()]),
        None if scales is None else 2 * scales,
        None if oris is None else np.radians(oris.astype(np.float64)),
        field("scores"),
        field("octaves"),
        None if rows is None else _bytes(source, rows.T.astype(np.float32), field("norms")),
    )


def _bytes(
    source: str, units: Float32Array, norms: npt.NDArray[Any] | None
) -> npt.NDArray[np.float32]:
    """(n, d) whole numbers up to 255, of descriptors of about unit length."""
    if units.size and not units.min() >= 0:
        raise KeypointsError(
            f"{source}: descriptors: expected SIFT's, at least 0, found {units.min()}"
        )
    scale = QUANTUM if norms is None else norms[:, None]
    return np.minimum(np.rint(units * scale), 255)
