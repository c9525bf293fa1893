"""HDF5 in the layout of hloc, the visual localization toolbox: one group per image.

A group holds `keypoints` (n, 2), `scores` (n,), `scales` (n,) and `oris` (n,) in degrees,
`descriptors` (d, n) of unit length, and `image_size` (width, height), which matchers require. The
center of the first pixel is (0, 0), as in `Keypoints`; hloc adds COLMAP's half pixel on import.
`octaves` and `norms` are for `read_hdf5`; hloc ignores them.

Matches are in a second file, a group for every pair of images. The group of the images "a/1.jpg"
and "b/2.jpg" is "a-1.jpg/b-2.jpg". It holds `matches0` (n,), the index of each first-image
keypoint's match in the second image or -1, and `matching_scores0` (n,) from 0 to 1.
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.exchange.orientation import (
    UPRIGHT,
    orientation_of,
    stored_keypoints,
    stored_shape,
)
from saccade.extras import import_optional
from saccade.io.files import FORMATS, atomic_write, check_file, check_format, reading
from saccade.io.keypoint_fields import MAX_BYTE, check_name, checked, keypoints_from
from saccade.io.npz import check_unpacked
from saccade.types import Float32Array, IntArray, Keypoints, check_pairs

VERSION_ATTRIBUTE = "saccade_format"
SIFT_LENGTH = 128
UNIT = 512
"""Norm of SIFT's descriptors in bytes, for files without `norms`."""
MAX_ROUNDING = 0.01
"""Largest rounding error of bytes that are stored with unit length."""


def write_hdf5(
    path: str | Path,
    keypoints: Mapping[str, Keypoints],
    shapes: Mapping[str, tuple[int, ...]] | None = None,
    orientations: Mapping[str, int] | None = None,
) -> None:
    """Writes the features of many images to one file.

    Args:
        path: the file, written atomically; an existing file is replaced.
        keypoints: keypoints by image name, a path relative to the image folder as in hloc's lists.
        shapes: (H, W, ...) of each image; required by hloc's learned matchers, and for images that
            are not stored upright.
        orientations: EXIF orientations of the files (`saccade.exchange.read_orientation`), which
            hloc ignores: keypoints and sizes are written in stored pixels.

    Raises:
        KeypointsError: inconsistent shapes, or NaN.
        ConfigError: h5py is not installed.
        OutputError: the file cannot be written.
    """
    h5py = import_optional("h5py", "hdf5")
    with atomic_write(path) as temporary, create_hdf5(h5py, temporary) as file:
        file.attrs[VERSION_ATTRIBUTE] = FORMATS["points"]
        for name, points in keypoints.items():
            group = file.create_group(check_name(name))
            orientation, stored = orientation_of(name, orientations), checked(name, points)
            if shapes is None or name not in shapes:
                if orientation != UPRIGHT:
                    raise KeypointsError(f"{name}: expected a shape for this image, found none")
                shape = None
            else:
                stored = stored_keypoints(stored, shapes[name], orientation)
                shape = stored_shape(shapes[name], orientation)
            for field, values in _datasets(stored).items():
                group.create_dataset(field, data=values)
            if shape is not None:
                height, width = shape
                group.create_dataset("image_size", data=np.array([width, height]))


@contextmanager
def create_hdf5(h5py: Any, path: Path) -> Iterator[Any]:
    """A new HDF5 file.

    Raises:
        OSError: it cannot be written.
    """
    with _DeferringFile(path, "w+b") as raw:
        try:
            with h5py.File(raw, "w") as file:
                yield file
        finally:
            if raw.error is not None:
                raise raw.error


class _DeferringFile(FileIO):
    """A file that stores its first error, since an exception inside h5py would kill the process."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        """Writes all data; always reports success."""
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while rest:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.error = self.error or error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Resizes the file; always reports success."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0


def read_hdf5(path: str | Path, names: Collection[str] | None = None) -> dict[str, Keypoints]:
    """Reads features written by `write_hdf5` or by hloc, also learned ones.

    Args:
        path: the file.
        names: of the images to read, of those in the file; None for all.

    Returns:
        Points by image name, sorted by name.

    Raises:
        KeypointsError: the file is missing or has another format, or an image has no keypoints.
        ConfigError: h5py is not installed.
    """
    path = Path(path)
    with _opened(path, "features") as (file, datasets):
        if VERSION_ATTRIBUTE in file.attrs:
            check_format("points", file.attrs[VERSION_ATTRIBUTE].tolist(), path, KeypointsError)
        groups = [name.rpartition("/")[0] for name in datasets if name.endswith("/keypoints")]
        if len(file) and not groups:
            raise KeypointsError(f"{path}: expected groups with keypoints, found none")
        chosen = [name for name in groups if names is None or name in names]
        return {name: _read_group(f"{path}: {name}", file[name]) for name in chosen}


def names_in(path: str | Path) -> list[str]:
    """Names of the images with keypoints in a file of features; raises as `read_hdf5`."""
    with _opened(Path(path), "features") as (_, datasets):
        return [name.rpartition("/")[0] for name in datasets if name.endswith("/keypoints")]


@contextmanager
def _opened(path: Path, content: str) -> Iterator[tuple[Any, list[str]]]:
    """An HDF5 file opened for reading, and the names of its data sets."""
    h5py = import_optional("h5py", "hdf5")
    sizes: dict[str, int] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            sizes[name] = item.nbytes

    # h5py raises arbitrary exceptions for a broken file.
    with reading(path, KeypointsError, f"an HDF5 file of {content}", Exception):
        check_file(path)
        with h5py.File(path, "r") as file:
            file.visititems(visit)
            check_unpacked(path.stat().st_size, sum(sizes.values()))
            yield file, [*sizes]


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
        fields["descriptors"] = (rows / np.where(norms > 0, norms, 1)[:, None]).T
        fields["norms"] = norms
    return fields


def _read_group(source: str, group: Any) -> Keypoints:
    fields = {
        name: np.asarray(group[name][()])
        for name in ("keypoints", "scores", "scales", "oris", "octaves", "descriptors", "norms")
        if name in group
    }
    descriptors = None
    if "descriptors" in fields:
        descriptors = _descriptors(fields["descriptors"].T.astype(np.float32), fields.get("norms"))
    return keypoints_from(
        source,
        fields["keypoints"],
        descriptors,
        size=2 * fields["scales"] if "scales" in fields else None,
        angle=np.radians(fields["oris"].astype(np.float64)) if "oris" in fields else None,
        response=fields.get("scores"),
        octave=fields.get("octaves"),
    )


def _descriptors(
    units: npt.NDArray[np.float32], norms: npt.NDArray[Any] | None
) -> npt.NDArray[np.float32]:
    """(n, d) descriptors of a file: whole numbers up to 255 of SIFT's, else as they are.

    Args:
        units: (n, d) of unit length.
        norms: (n,) their norms; None in files of other programs.
    """
    if norms is None:
        is_sift = units.shape[1:] == (SIFT_LENGTH,) and units.min(initial=0) >= 0
        return np.minimum(np.rint(units * UNIT), MAX_BYTE) if is_sift else units
    rows = units * norms.astype(np.float32)[:, None]
    whole = np.rint(rows)
    are_bytes = whole.min(initial=0) >= 0 and whole.max(initial=0) <= MAX_BYTE
    return whole if are_bytes and np.abs(rows - whole).max(initial=0) < MAX_ROUNDING else rows


NONE = -1
"""Index that means no match."""


def write_hloc_matches(
    path: str | Path,
    matches: Mapping[tuple[str, str], IntArray],
    counts: Mapping[str, int],
    similarities: Mapping[tuple[str, str], Float32Array] | None = None,
) -> None:
    """Write the matches of many pairs of images.

    Args:
        path: the file, written atomically; an existing file is replaced.
        matches: (m, 2) indices into the keypoints of two images, by image names, as returned by
            `saccade.match`.
        counts: number of keypoints of each image.
        similarities: (m,) scores in [0, 1] for each pair, for thresholds in hloc; None for 1.

    Raises:
        KeypointsError: an image without a count, indices out of range, or two pairs with the same
            group name, since hloc replaces slashes.
        ConfigError: h5py is not installed.
        OutputError: the file cannot be written.
    """
    h5py = import_optional("h5py", "hdf5")
    groups: dict[str, tuple[str, str]] = {}
    for pair, indices in matches.items():
        for name in pair:
            if name not in counts:
                raise KeypointsError(f"{name}: expected a number of keypoints, found none")
        check_pairs(indices, (counts[pair[0]], counts[pair[1]]), f"matches of {' and '.join(pair)}")
        group = group_of(*pair)
        if group in groups:
            told = " and ".join(map(" ".join, (groups[group], pair)))
            raise KeypointsError(f"{path}: expected one pair named {group}, found {told}")
        groups[group] = pair
    with atomic_write(path) as temporary, create_hdf5(h5py, temporary) as file:
        for group, pair in groups.items():
            first, second = matches[pair].T
            partners = np.full(counts[pair[0]], NONE, np.int32)
            partners[first] = second
            scores = np.zeros(len(partners), np.float16)
            scores[first] = 1 if similarities is None else similarities[pair]
            file[f"{group}/matches0"] = partners
            file[f"{group}/matching_scores0"] = scores


def read_hloc_matches(path: str | Path) -> dict[str, tuple[IntArray, Float32Array]]:
    """Reads matches written by hloc or by `write_hloc_matches`.

    Returns:
        (m, 2) indices into the keypoints of two images and (m,) scores, by `group_of`.

    Raises:
        KeypointsError: the file is missing or has another format.
        ConfigError: h5py is not installed.
    """
    found: dict[str, tuple[IntArray, Float32Array]] = {}
    with _opened(Path(path), "matches") as (file, _):
        for group in [f"{one}/{two}" for one in file for two in file[one]]:
            partners = np.asarray(file[group]["matches0"][()], np.int64)
            matched = np.flatnonzero(partners != NONE)
            scores = np.asarray(file[group]["matching_scores0"][()], np.float32)
            found[group] = np.stack([matched, partners[matched]], axis=1), scores[matched]
    return found


def group_of(first: str, second: str) -> str:
    """The name of the group of two images."""
    return "/".join(check_name(name).replace("/", "-") for name in (first, second))
