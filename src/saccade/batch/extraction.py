"""Extracts features from all images of a source into a data set.

A block of images is processed by one worker and makes one Parquet file, named by the hash of the
names of its images. An image is done if a file lists it with its content and the settings of the
job: that is all a run resumes from. Results that are out of date are removed before any image is
processed, so that every image is in one file at most, whenever a run ends.
"""

import hashlib
import json
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import compute

import saccade
from saccade.batch.dataset import (
    MANIFEST,
    SUFFIX,
    ImageRecord,
    all_columns,
    block_files,
    read_block,
    read_manifest,
)
from saccade.batch.job import FROM_FILE, MAPS, Job
from saccade.batch.schemas import empty_schema, feature_rows
from saccade.batch.sources import (
    Item,
    Source,
    content_hash,
    content_reader,
    decode,
    orientation_of,
)
from saccade.batch.storage import Store
from saccade.batch.stored import read_stored, stored_points
from saccade.errors import ConfigError, ImageError, KeypointsError, SaccadeError
from saccade.exchange.arrow import column, rows_of, write_rows
from saccade.exchange.maps import encode_png
from saccade.extras import name_of
from saccade.io.files import FORMATS
from saccade.io.masks import read_mask
from saccade.io.preparation import opaque_part, stretch_contrast, warnings_of
from saccade.keypoints.detectors import (
    DETECTORS,
    call,
    make_detector,
    own_detections,
    own_function,
)
from saccade.types import BoolArray, Image
from saccade.workers import DIED, run_blocks

MAX_BLOCK = 256
"""Images in a block: minutes of work, and a file of about 30 MB."""
MIN_BLOCK = 4
"""Images in a block of a small job: a file costs as much as a tenth of an image."""
MIN_BLOCKS = 32
"""Number of blocks of a small job with enough images, so that all workers have work."""
MAP_FOLDER = "maps"
SUMMARY = "images.parquet"
"""Table of all images of a data set, written at the end of a run."""


@dataclass(frozen=True)
class Extraction:
    """Results of a run."""

    done: int
    """Images processed without failure."""
    unchanged: int
    """Images of the source that were done before."""
    failed: Mapping[str, str]
    """Reasons by the names of the images that failed; the next run tries them again."""
    images: int
    """Images in the data set."""
    rows: int
    """Rows of its table."""
    complete: bool
    """Whether all images of the source were processed; false if the run was stopped."""


def extract(
    source: Source,
    job: Job,
    out: str,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    block_size: int | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    on_progress: Callable[[int, int, int], None] = lambda done, failed, total: None,
) -> Extraction:
    """Runs a job on all images of a source that are not done.

    Args:
        source: the images.
        job: features to extract from each.
        out: folder or URL of the data set; of one job only.
        workers: number of processes; with 1 the work is done in this process.
        scheduler: address of a Dask scheduler, whose workers are used; they must see the same
            paths or URLs.
        block_size: images in a block; None to choose it so that every worker has work.
        should_stop: called before or after every block; true ends the run after the blocks that
            have begun.
        on_progress: called after every block with the numbers of images that are done, that failed,
            and that this run has to process.

    Returns:
        Counts of this run and of the data set.

    Raises:
        ConfigError: the data set was made with other settings, or another run writes to it.
        OutputError: it cannot be written.
    """
    store = Store(out)
    with store.locked():
        _prepare(store, job)
        finished = remove_outdated(store, source, job)
        blocks = plan_blocks(source, finished, block_size)
        total, done, failed = sum(map(len, blocks)), 0, dict[str, str]()
        work = partial(extract_block, job, out)
        for block, report in run_blocks(
            work, blocks, workers=workers, scheduler=scheduler, should_stop=should_stop
        ):
            reasons = {item.name: DIED for item in block} if report is None else report
            done += len(block) - len(reasons)
            failed |= reasons
            on_progress(done, len(failed), total)
        files = block_files(store, job.folder)
        records = [record for file in files for record in read_block(store, file)[0]]
        _write_summary(store, records, failed)
    return Extraction(
        done,
        unchanged=len(source) - total,
        failed=failed,
        images=len(records),
        rows=sum(record.rows for record in records),
        complete=done + len(failed) == total,
    )


def remove_outdated(store: Store, source: Source, job: Job) -> set[str]:
    """Removes the results of other settings and of images that have changed.

    Results of images that the source does not have are kept. Returns the names of images that are
    done.
    """
    item_of = {item.name: item for item in source}
    read, done = content_reader(), set[str]()

    def is_current(record: ImageRecord) -> bool:
        if record.image in done or record.job != job.fingerprint:
            return False
        item = item_of.get(record.image)
        if item is None or item.stamp == record.stamp:
            return True
        try:
            return content_hash(read(item)) == record.content
        except ImageError:
            return True

    for file in block_files(store, job.folder):
        records, _ = read_block(store, file)
        kept = [record for record in records if is_current(record)]
        names = [record.image for record in kept]
        done.update(names)
        if not kept:
            store.remove(file)
        elif len(kept) < len(records):
            _, table = read_block(store, file, all_columns)
            rows = table.filter(compute.is_in(table["image"], column(names, pa.string())))
            with store.writing(file) as path:
                write_rows(
                    path, rows.to_batches(), table.schema, [asdict(record) for record in kept]
                )
    return done


def plan_blocks(
    source: Source, finished: Collection[str], block_size: int | None = None
) -> list[list[Item]]:
    """Blocks of the images whose names are not in `finished`.

    The source is cut into blocks before finished images are left out, so that the same images make
    the same block after any interruption.
    """
    size = block_size or min(max(len(source) // MIN_BLOCKS, MIN_BLOCK), MAX_BLOCK)
    blocks = (
        [item for item in source[first : first + size] if item.name not in finished]
        for first in range(0, len(source), size)
    )
    return [block for block in blocks if block]


def extract_block(job: Job, location: str, block: Sequence[Item]) -> dict[str, str]:
    """Processes a block of images into a file; runs in any process on any machine.

    Returns:
        Reasons by the names of the images that failed.
    """
    store = Store(location)
    digest = hashlib.blake2b("\n".join(item.name for item in block).encode(), digest_size=12)
    file = f"{job.folder}/{digest.hexdigest()}{SUFFIX}"
    records: list[dict[str, Any]] = []
    failed: dict[str, str] = {}
    batches = _extract_images(job, store, block, records, failed)
    first = next(batches, None)
    schema, begin = (empty_schema(job), []) if first is None else (first.schema, [first])
    with store.writing(file) as path:
        write_rows(path, chain(begin, batches), schema, records)
    if not records:
        store.remove(file)
    return failed


def _extract_images(
    job: Job,
    store: Store,
    block: Sequence[Item],
    records: list[dict[str, Any]],
    failed: dict[str, str],
) -> Iterator[pa.RecordBatch]:
    """The rows of each image that has any; fills the records, and the reasons of failures."""
    read, features = content_reader(), make_features(job, [item.name for item in block])
    schema: pa.Schema | None = None
    for item in block:
        try:
            start = time.perf_counter()
            content = read(item)
            image = decode(content, item.name, keep_alpha=job.has_points)
            if job.stretch:
                image = stretch_contrast(image, name=item.name)
            with warnings_of(item.name):
                mask = None
                if job.masks is not None:
                    mask = read_mask(Path(job.masks), item.name, orientation_of(content))
                found = features(item.name, image, orientation_of(content), mask)
            if isinstance(found, np.ndarray):
                with store.writing(f"{MAP_FOLDER}/{item.name}.png") as path:
                    path.write_bytes(encode_png(found))
            batch = feature_rows(item.name, image.shape, found)
            if batch.num_rows:
                schema = schema or batch.schema
                check_schema(batch, schema, item.name)
        except (SaccadeError, MemoryError) as error:
            failed[item.name] = str(error) or "not enough memory"
            continue
        except Exception as error:  # one image must not end the work on a million
            failed[item.name] = f"{type(error).__name__}: {error}"
            continue
        record = ImageRecord(
            image=item.name,
            content=content_hash(content),
            stamp=item.stamp,
            width=image.shape[1],
            height=image.shape[0],
            rows=batch.num_rows,
            seconds=time.perf_counter() - start,
            job=job.fingerprint,
            version=saccade.__version__,
            orientation=orientation_of(content),
        )
        records.append(asdict(record))
        if batch.num_rows:
            yield batch


def check_schema(batch: pa.RecordBatch, schema: pa.Schema, name: str) -> None:
    """Raises `KeypointsError` if the rows of an image have other columns than those before."""
    for field in schema:
        found = batch.schema.field(field.name).type if field.name in batch.schema.names else "none"
        if found != field.type:
            raise KeypointsError(
                f"{name}: {field.name}: expected {field.type} as for the images before, "
                f"found {found}"
            )


def make_features(
    job: Job, names: Collection[str]
) -> Callable[[str, Image, int, BoolArray | None], Any]:
    """A function from the name, image, EXIF orientation and mask of an image to its features.

    Args:
        job: the features.
        names: of the images.

    Raises:
        ConfigError: a file of features is missing.
        KeypointsError: it has another format.
    """
    if job.what != FROM_FILE:
        analyze = make_analyzer(job)
        return lambda name, image, orientation, mask: analyze(image, mask)
    if job.file is None:
        raise ConfigError(f"{FROM_FILE}: expected a file of features, found none")
    return partial(stored_points, read_stored(Path(job.file), names))


def make_analyzer(job: Job) -> Callable[[Image, BoolArray | None], Any]:
    """A function from an image and its mask to its features, which keeps a detector's memory.

    The features are `Keypoints`, `Regions`, a `Scanpath`, or a map (h, w) in [0, 1].
    """
    if job.what in DETECTORS:
        return make_detector(str(job.what), job.settings, threads=1)
    if job.is_own:
        return partial(own_features, own_function(job.what), name_of(job.what))
    from saccade.attention import scanpath
    from saccade.attention.models import AttentionModel

    model = AttentionModel(job.settings)
    if job.what in MAPS:
        return lambda image, mask: model.maps(image).saliency
    return lambda image, mask: scanpath(model.maps(image), job.network, fixations=job.fixations)


def own_features(
    function: Callable[..., Any], name: str, image: Image, mask: BoolArray | None
) -> Any:
    """The features that a user's function finds in an image, validated.

    Raises:
        ConfigError: the function fails, or returns neither points nor a map in [0, 1].
    """
    found = call(function, opaque_part(image)[0], name)
    if not isinstance(found, np.ndarray):
        return own_detections(lambda _: found, image, name, mask)
    if found.ndim != 2 or found.size == 0 or not ((found >= 0) & (found <= 1)).all():
        raise ConfigError(f"{name}: expected a map (h, w) in [0, 1], found shape {found.shape}")
    return found.astype(np.float32)


def _prepare(store: Store, job: Job) -> None:
    """Writes the manifest; rejects a data set with different settings and names the first."""
    manifest, requested = read_manifest(store), json.loads(json.dumps(job.describe(), default=str))
    if manifest is not None:
        made, now = ({**each, **each["settings"]} for each in (manifest, requested))
        for name in now:
            if name != "settings" and made.get(name) != now[name]:
                raise ConfigError(
                    f"{store.location}: made with {name} = {made.get(name)!r}, now {now[name]!r}; "
                    "use another --out, or remove this data set"
                )
    header = {"format": FORMATS["extraction"], "version": saccade.__version__}
    with store.writing(MANIFEST) as path:
        path.write_text(json.dumps(header | requested, indent=2) + "\n", encoding="utf-8")


SUMMARY_SCHEMA = pa.schema(
    [
        *((name, pa.string()) for name in ("image", "content", "version", "error")),
        *((name, pa.int64()) for name in ("width", "height", "rows")),
        ("seconds", pa.float64()),
    ]
)
"""A row for every image: hash of its content, version of saccade, reason if it failed, size,
number of its rows in the table, and processing time."""


def _write_summary(store: Store, records: Sequence[ImageRecord], failed: Mapping[str, str]) -> None:
    rows = [asdict(record) for record in records]
    rows += [{"image": name, "error": reason} for name, reason in failed.items()]
    batch = rows_of(sorted(rows, key=itemgetter("image")), SUMMARY_SCHEMA)
    with store.writing(SUMMARY) as path:
        write_rows(path, [batch], SUMMARY_SCHEMA)
