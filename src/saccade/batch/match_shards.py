"""Matches the pairs of a shard: two shards of features in, a Parquet table out."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from saccade.batch.dataset import SUFFIX, read_shard, read_table, shard_file
from saccade.batch.job import Job
from saccade.batch.pairs import Pair
from saccade.batch.shards import ShardReport
from saccade.batch.store import Store, open_store
from saccade.batch.tables import parquet_options, record_batch
from saccade.errors import KeypointsError, OutputError, require
from saccade.keypoints.matching import match
from saccade.keypoints.verification import SAMPLE_SIZE, Geometry, Verification, verify
from saccade.types import Float32Array, IntArray, Keypoints

Key: TypeAlias = tuple[str, ...]
"""Of a row: names and contents of the images, and the fingerprint of the configuration."""
FOLDER = "matches"
_KEYS = ("first", "second", "first_content", "second_content", "configuration")
SCHEMA = pa.schema(
    [
        *((name, pa.string()) for name in (*_KEYS, "geometry")),
        *((name, pa.binary()) for name in ("pairs", "similarity", "inliers", "matrix")),
    ]
)
"""A row for every pair of images: their names, the hashes of their contents, the fingerprint of the
settings; (m, 2) int32 indices of the matched points, (m,) float32 similarities, (m,) which matches
are inliers, and the (3, 3) float64 matrix of the geometry, empty where there is none."""


@dataclass(frozen=True)
class MatchConfig:
    """How the keypoints of two images are matched, and the matches verified."""

    ratio: float | None = 0.8
    """See `saccade.match`."""
    mutual: bool = True
    """See `saccade.match`."""
    geometry: Geometry | None = "fundamental"
    """See `saccade.verify`; None for no verification."""
    tolerance: float = 2.0
    """Inlier threshold in pixels."""

    def __post_init__(self) -> None:
        ratio = self.ratio is None or 0 < self.ratio <= 1
        require(ratio, "ratio", "over 0 and at most 1, or None", self.ratio)
        known = self.geometry is None or self.geometry in SAMPLE_SIZE
        require(known, "geometry", "fundamental, homography or None", self.geometry)
        require(0 < self.tolerance < np.inf, "tolerance", "pixels over 0", self.tolerance)

    def fingerprint(self, job: Job) -> str:
        """Hash of these settings and those of the features, as 16 hexadecimal digits."""
        text = json.dumps([asdict(self), job.fingerprint], sort_keys=True)
        return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


class PairItem(NamedTuple):
    """A pair of images, and the hashes of their contents."""

    pair: Pair
    contents: Pair

    @property
    def name(self) -> str:
        """Of the pair, for reports."""
        return " ".join(self.pair)


class MatchShard(NamedTuple):
    """Pairs of images whose features are in the same two files."""

    items: Sequence[PairItem]
    files: tuple[str, str]
    """Records of the shards of features that hold the first and the second images."""

    @property
    def name(self) -> str:
        """Made of the pairs and the contents of their images."""
        text = json.dumps(self.items)
        return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


class MatchedPair(NamedTuple):
    """The matches of two images."""

    pair: Pair
    indices: IntArray
    """(m, 2) indices of keypoints, as `saccade.match` returns them."""
    similarity: Float32Array
    """(m,) cosine of the angle between the two descriptors, moved from [-1, 1] to [0, 1]."""
    verification: Verification | None
    """None where it was not asked for."""


def match_shard(
    config: MatchConfig, job: Job, features: str, out: str, shard: MatchShard
) -> ShardReport:
    """Match the pairs of a shard; runs in any process on any machine.

    Args:
        config: how they are matched.
        job: that extracted the features.
        features: location of the data set of keypoints.
        out: location of the store of matches.
        shard: the pairs.
    """
    store, fingerprint = open_store(features), config.fingerprint(job)
    points = {
        image.image: image.points
        for file in dict.fromkeys(shard.files)
        for image in read_shard(store, job.what, file)
    }
    rows = [
        {
            **dict(zip(_KEYS, (*item.pair, *item.contents, fingerprint), strict=True)),
            **_match(config, *(points[name] for name in item.pair)),
        }
        for item in shard.items
    ]
    table = pa.Table.from_batches([record_batch(rows, SCHEMA)])
    target = open_store(out)
    try:
        with (
            target.writing(f"{FOLDER}/{shard_file(f'{shard.name}-{fingerprint}')}") as path,
            path.open("wb") as file,
        ):
            pq.write_table(table, file, **parquet_options(SCHEMA))
    except OutputError as error:
        return ShardReport(lost=[(item.name, str(error)) for item in shard.items])
    return ShardReport(len(rows), rows=sum(len(row["pairs"]) // 8 for row in rows))


def read_keys(store: Store) -> Iterator[tuple[str, set[Key]]]:
    """Each file of matches, and the keys of its rows: names, contents, configuration."""
    for file in store.list_files(FOLDER):
        if not file.endswith(SUFFIX):
            continue
        columns = read_table(store, f"{FOLDER}/{file}", SCHEMA, _KEYS)
        yield file, set(zip(*(columns[name].to_pylist() for name in _KEYS), strict=True))


def read_matches(store: Store, file: str) -> Iterator[tuple[Key, MatchedPair]]:
    """Each row of a file: its key, and the matches.

    Raises:
        KeypointsError: the file is broken.
    """
    for row in read_table(store, f"{FOLDER}/{file}", SCHEMA).to_pylist():
        try:
            yield tuple(row[name] for name in _KEYS), _matched_pair(row)
        except ValueError as error:
            place = f"{store.location}/{FOLDER}/{file}"
            raise KeypointsError(f"{place}: expected matches: {error}; remove it") from error


def _match(config: MatchConfig, first: Keypoints, second: Keypoints) -> dict[str, Any]:
    """The cells of the matches of two images."""
    indices = match(first, second, config.ratio, config.mutual)
    units = [
        _unit(points.descriptors[column])
        for points, column in zip((first, second), indices.T, strict=True)
        if points.descriptors is not None
    ]
    cells: dict[str, Any] = {
        "geometry": config.geometry or "",
        "pairs": indices.astype("<i4").tobytes(),
        "similarity": ((1 + np.einsum("ij,ij->i", *units)) / 2).astype("<f4").tobytes(),
    }
    if config.geometry is not None:
        found = verify(first, second, indices, config.geometry, config.tolerance)
        cells["inliers"] = found.inliers.astype(np.uint8).tobytes()
        if found.matrix is not None:
            cells["matrix"] = found.matrix.astype("<f8").tobytes()
    return cells


def _unit(descriptors: Any) -> Float32Array:
    rows = descriptors.astype(np.float32)
    units: Float32Array = rows / np.maximum(np.linalg.norm(rows, axis=1), 1e-12)[:, None]
    return units


def _matched_pair(row: dict[str, Any]) -> MatchedPair:
    verification = None
    if row["geometry"]:
        matrix = np.frombuffer(row["matrix"], "<f8").reshape(-1, 3, 3)
        verification = Verification(
            cast("Geometry", row["geometry"]),
            matrix[0] if len(matrix) else None,
            np.frombuffer(row["inliers"], np.uint8) != 0,
        )
    return MatchedPair(
        (row["first"], row["second"]),
        np.frombuffer(row["pairs"], "<i4").reshape(-1, 2).astype(np.int64),
        np.frombuffer(row["similarity"], "<f4").astype(np.float32),
        verification,
    )
