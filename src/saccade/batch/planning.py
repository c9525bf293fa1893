"""Cuts a source into shards, and finds which images are already done."""

import hashlib
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.batch.dataset import (
    RECORDS,
    name_generation,
    read_record,
    read_table,
    record_files,
    split_generation,
)
from saccade.batch.items import Item
from saccade.batch.job import MAPS, Job
from saccade.batch.shards import Shard
from saccade.batch.sources import Source
from saccade.batch.store import Store
from saccade.batch.tables import MAP_SCHEMA

Hashes: TypeAlias = npt.NDArray[np.uint64]
"""(n,) 64-bit hashes of names."""

MAX_SHARD_SIZE = 256
"""Images in a shard: minutes of work, and a file of about 30 MB."""
MIN_SHARD_SIZE = 4
"""Images in a shard of a small job: a file costs as much as a tenth of an image."""
MIN_SHARDS = 32
"""Into which a small job is cut if it has enough images, so that all workers have work."""


def plan_shards(source: Source, store: Store, shard_size: int | None = None) -> Iterator[Shard]:
    """First the recorded shards, whose images may have changed, then the new ones.

    A new shard is a block of the source without the images that are done, so that after any
    interruption the same images make the same shard. Planning takes up to 32 bytes of memory an
    image, for hashes of the names and their order.

    Args:
        source: the images.
        store: of the results.
        shard_size: images in a shard; None to choose it.
    """
    if shard_size is None:
        shard_size = min(max(len(source) // MIN_SHARDS, MIN_SHARD_SIZE), MAX_SHARD_SIZE)
    hashes = _hash_names(source[number].name for number in range(len(source)))
    recorded = {}
    for file in record_files(store):
        names: list[str] = read_record(store, file, ["image"])["image"].to_pylist()
        recorded[file] = _hash_names(names)
    is_new = ~np.isin(hashes, np.concatenate([*recorded.values(), hashes[:0]]))
    return chain(
        _recorded_shards(source, hashes, recorded), _new_shards(source, is_new, shard_size)
    )


def _recorded_shards(
    source: Source, hashes: Hashes, recorded: dict[str, Hashes]
) -> Iterator[Shard]:
    """The next generation of every recorded shard, with its images that the source still has."""
    order = np.argsort(hashes, kind="stable")
    ordered = hashes[order]
    for file, names in recorded.items():
        index = np.searchsorted(ordered, names)
        inside = index < len(ordered)
        index, names = index[inside], names[inside]
        numbers = order[index[ordered[index] == names]]
        shard, generation = split_generation(file)
        items = [source[number] for number in numbers.tolist()]
        yield Shard(name_generation(shard, generation + 1), items, previous=file)


def _new_shards(source: Source, is_new: npt.NDArray[np.bool_], shard_size: int) -> Iterator[Shard]:
    for first in range(0, len(source), shard_size):
        numbers = first + np.flatnonzero(is_new[first : first + shard_size])
        if len(numbers):
            items = [source[number] for number in numbers.tolist()]
            yield Shard(_name_shard(first, items), items)


def remove_orphans(store: Store, job: Job) -> None:
    """Remove tables that an interrupted run left without a record, and older generations."""
    recorded = set(record_files(store))
    for file in store.list_files(RECORDS):
        if file not in recorded:
            store.remove(f"{RECORDS}/{file}")
    for file in store.list_files(job.what):
        if file not in recorded:
            name = f"{job.what}/{file}"
            if job.what in MAPS:
                for map_file in read_table(store, name, MAP_SCHEMA, ["file"])["file"].unique():
                    store.remove(str(map_file))
            store.remove(name)


def _name_shard(first: int, items: list[Item]) -> str:
    """The number of the first image, and a hash of the names of all."""
    names = "\n".join(item.name for item in items)
    return f"{first:09d}-{hashlib.blake2b(names.encode(), digest_size=4).hexdigest()}"


def _hash_names(names: Iterable[str]) -> Hashes:
    """A 64-bit hash of each name."""
    digests = (hashlib.blake2b(name.encode(), digest_size=8).digest() for name in names)
    return np.frombuffer(b"".join(digests), np.uint64)
