"""Matches in hloc's HDF5: a group for every pair of images, beside the file of their features.

The group of the images "a/1.jpg" and "b/2.jpg" is "a-1.jpg/b-2.jpg". It holds `matches0` (n,), for
each keypoint of the first image the index of its match in the second or -1, and `matching_scores0`
(n,), a number from 0 to 1.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from saccade.errors import KeypointsError
from saccade.exchange.fields import check_name, reading
from saccade.exchange.hdf5 import create_hdf5
from saccade.extras import import_optional
from saccade.io.files import atomic_write
from saccade.io.npz import check_unpacked
from saccade.types import Float32Array, IntArray, check_pairs

NONE = -1
"""Index of no match."""


def write_hloc_matches(
    path: str | Path,
    matches: Mapping[tuple[str, str], IntArray],
    counts: Mapping[str, int],
    similarities: Mapping[tuple[str, str], Float32Array] | None = None,
) -> None:
    """Write the matches of many pairs of images.

    Args:
        path: written whole or not at all; an old file is replaced.
        matches: by the names of two images, (m, 2) indices into their keypoints, as
            `saccade.match` returns them.
        counts: number of keypoints of each image.
        similarities: (m,) in [0, 1] for each pair, which hloc may set a threshold on; None for 1.

    Raises:
        KeypointsError: an image without a count, indices out of range, or two pairs that have
            one group, since hloc replaces slashes in names.
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
    """Read matches as hloc or `write_hloc_matches` writes them.

    Returns:
        By `group_of` two images, (m, 2) indices into their keypoints, and (m,) scores.

    Raises:
        KeypointsError: the file is missing or something else.
        ConfigError: h5py is not installed.
    """
    h5py = import_optional("h5py", "hdf5")
    path = Path(path)
    found: dict[str, tuple[IntArray, Float32Array]] = {}
    # h5py raises anything for a broken file.
    with reading(path, "an HDF5 file of matches", Exception), h5py.File(path, "r") as file:
        groups = [f"{one}/{two}" for one in file for two in file[one]]
        size = sum(each.nbytes for group in groups for each in file[group].values())
        check_unpacked(path.stat().st_size, size)
        for group in groups:
            partners = np.asarray(file[group]["matches0"][()], np.int64)
            matched = np.flatnonzero(partners != NONE)
            scores = np.asarray(file[group]["matching_scores0"][()], np.float32)
            found[group] = np.stack([matched, partners[matched]], axis=1), scores[matched]
    return found


def group_of(first: str, second: str) -> str:
    """The name of the group of two images."""
    return "/".join(check_name(name).replace("/", "-") for name in (first, second))
