"""Which images make a shard, and which of them are done."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from saccade.batch.job import MAPS, Job
from saccade.batch.manifest import generation_of, name_of, record_files
from saccade.batch.shards import RECORDS, Shard, read_record, read_rows
from saccade.batch.sources import Item, Source
from saccade.batch.store import Store
from saccade.batch.tables import MAP_ROWS

MOST = 256
"""Images to a shard: minutes of work, and a file of about 30 MB."""
LEAST = 4
"""Images to a shard of a small job: a file costs as much as a tenth of an image."""
SHARDS = 32
"""That a small job is cut into, where it has so many images, so that there is work for all."""


@dataclass(frozen=True)
class Plan:
    """The shards of a job. Of the images only 8 bytes each are kept."""

    source: Source
    size: int
    """Images to a shard."""
    known: tuple[str, ...]
    """Files of the shards that have a record."""
    done: npt.NDArray[np.uint64]
    """Sorted hashes of the names that are in a record."""

    @classmethod
    def of(cls, source: Source, store: Store, size: int | None = None) -> "Plan":
        """Look what is in the store."""
        files = record_files(store)
        hashes = [
            hashed(name)
            for file in files
            for name in read_record(store, file, ["image"])["image"].to_pylist()
        ]
        at_once = size or min(max(len(source) // SHARDS, LEAST), MOST)
        return cls(source, at_once, tuple(files), np.sort(np.array(hashes, np.uint64)))

    def shards(self, store: Store) -> Iterator[Shard]:
        """First those that have to be looked at again, then the others.

        The images of the others are those of a block of the source that are not yet done: the
        same ones make the same shard, whenever the run before was cut off.
        """
        for file in self.known:
            names = read_record(store, file, ["image"])["image"].to_pylist()
            numbers = [self.source.find(name) for name in names]
            items = [self.source[number] for number in numbers if number is not None]
            shard, generation = generation_of(file)
            yield Shard(name_of(shard, generation + 1), items, before=file)
        for first in range(0, len(self.source), self.size):
            block = range(first, min(first + self.size, len(self.source)))
            items = [item for item in map(self.source.__getitem__, block) if self._is_new(item)]
            if items:
                yield Shard(shard_name(first, items), items)

    def _is_new(self, item: Item) -> bool:
        value = hashed(item.name)
        place = int(np.searchsorted(self.done, value))
        return place == len(self.done) or bool(self.done[place] != value)


def remove_orphans(store: Store, job: Job) -> None:
    """Take away what a run that was cut off left without a record, and older generations."""
    recorded = set(record_files(store))
    for file in store.names(RECORDS):
        if file not in recorded:
            store.remove(f"{RECORDS}/{file}")
    for file in store.names(job.what):
        if file not in recorded:
            name = f"{job.what}/{file}"
            if job.what in MAPS:
                for each in read_rows(store, name, MAP_ROWS, ["file"])["file"].unique():
                    store.remove(str(each))
            store.remove(name)


def shard_name(first: int, items: list[Item]) -> str:
    """The number of the first image, and a hash of the names of all."""
    names = "\n".join(item.name for item in items)
    return f"{first:09d}-{hashlib.blake2b(names.encode(), digest_size=4).hexdigest()}"


def hashed(name: str) -> np.uint64:
    """64 bits of a name."""
    return np.uint64(int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest()))
