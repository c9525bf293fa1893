"""Matches pairs of many images, into the files of hloc and COLMAP.

The folder that it writes:

    features/      the data set of keypoints, as `saccade.batch.extract` writes it
    matches/       a row for every pair of images; a pair is matched again if an image has changed
    pairs.txt      the pairs
    pairs.csv      their numbers of matches and inliers
    features.h5, matches.h5    in hloc's layout; database.db for COLMAP
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

from saccade.batch.dataset import read_record, record_files
from saccade.batch.engines import Engine, InProcess
from saccade.batch.extraction import Extraction, extract
from saccade.batch.job import POINTS, Job
from saccade.batch.match_files import Format, require_libraries, write_files
from saccade.batch.match_shards import (
    Key,
    MatchConfig,
    MatchedPair,
    MatchShard,
    PairItem,
    match_shard,
    read_keys,
    read_matches,
)
from saccade.batch.pairs import Pair, images_and_pairs
from saccade.batch.shards import ShardReport
from saccade.batch.sources import Source
from saccade.batch.store import Store, open_store
from saccade.errors import OutputError, require
from saccade.keypoints.sift_config import SiftConfig

FEATURES = "features"
"""Folder of the data set of keypoints."""
MIN_IMAGES, MAX_IMAGES, SHARDS = 4, 32, 32
"""Images in a shard of features, of which a worker has two in memory; shards of a small job."""
MAX_PAIRS = 256
"""Pairs in a shard of matches."""


@dataclass(frozen=True)
class MatchRun:
    """Results of a run."""

    extraction: Extraction
    """Of the features."""
    pairs: int
    """Pairs that were asked for."""
    done: int
    """Pairs matched now."""
    unchanged: int
    """Pairs matched before, of images that have not changed since."""
    matched: Sequence[MatchedPair]
    """The matches of all pairs but those with an image that failed; empty if it was stopped."""
    complete: bool
    """False if the run was stopped; then no files are written."""
    files: Mapping[str, Path]
    """By name: pairs, table, and features, matches or database."""


def match_images(
    source: str,
    out: str | Path,
    *,
    pairs: str | Path | None = None,
    job: Job | None = None,
    config: MatchConfig | None = None,
    formats: Sequence[Format] = ("hdf5",),
    engine: Callable[[Source], Engine] = lambda images: InProcess(),
    redo: bool = False,
    should_stop: Callable[[], bool] = lambda: False,
    on_report: Callable[[str, int, ShardReport], None] = lambda stage, total, report: None,
) -> MatchRun:
    """Detect, match and verify many images; the same call resumes an interrupted one.

    Args:
        source: images, as for `open_source`; with `pairs` also a folder with what these name.
        out: folder to write.
        pairs: list of pairs, two names to a line; None for all pairs.
        job: the features, of points; None for those of SIFT, exactly.
        config: of matching and verification; None for the default.
        formats: hdf5 for hloc, colmap for a database.
        engine: makes what runs the work, for the images.
        redo: whether features of other settings are replaced, and all pairs matched again.
        should_stop: called before every shard; true ends the run after those that have begun.
        on_report: called with "images" or "pairs", their number, and each report.

    Raises:
        ImageError: the source does not exist, or holds no image.
        ConfigError: an invalid list of pairs, features of other settings in the folder, or a
            library that is not installed.
        OutputError: a file cannot be written.
    """
    config, job = config or MatchConfig(), job or Job("sift", SiftConfig(), exact=True)
    require(len(formats) > 0, "formats", "hdf5 or colmap", formats)
    require(job.what in POINTS, "job", f"one of {', '.join(POINTS)}", job.what)
    require_libraries(formats)
    images, wanted = images_and_pairs(source, None if pairs is None else Path(pairs))
    run_on, out = engine(images), Path(out)
    features = str(out / FEATURES)
    extraction = extract(
        images,
        job,
        features,
        run_on,
        source_name=source,
        shard_size=min(max(len(images) // SHARDS, MIN_IMAGES), MAX_IMAGES),
        redo=redo,
        should_stop=should_stop,
        on_report=partial(on_report, "images", len(images)),
    )
    if extraction.error is not None:
        raise OutputError(extraction.error)
    if not extraction.complete:
        return MatchRun(extraction, len(wanted), 0, 0, (), False, {})
    fingerprint, store = config.fingerprint(job), open_store(str(out))
    with store.locked():
        items, file_of = _items(open_store(features), wanted)
        keys: set[Key] = {(*item.pair, *item.contents, fingerprint) for item in items}
        present = set() if redo else keys & {key for _, row in read_keys(store) for key in row}
        todo = [i for i in items if (*i.pair, *i.contents, fingerprint) not in present]
        work = partial(match_shard, config, job, features, str(out))
        done = 0
        for report in run_on.run(work, _until(should_stop, _shards(todo, file_of))):
            if report.lost:
                raise OutputError(report.lost[0][1])
            done += report.done
            on_report("pairs", len(todo), report)
        complete = done == len(todo)
        found = _current(store, keys) if complete else {}
        matched = [found[pair] for pair in wanted if pair in found]
        files = write_files(out, features, matched, formats) if complete else {}
    return MatchRun(extraction, len(wanted), done, len(present), matched, complete, files)


def _items(features: Store, wanted: Sequence[Pair]) -> tuple[list[PairItem], dict[str, str]]:
    """The pairs of images that have features, and the record of each image."""
    content_of: dict[str, str] = {}
    file_of: dict[str, str] = {}
    for file in record_files(features):
        for row in read_record(features, file, ("image", "content", "error")).to_pylist():
            if row["error"] is None:
                content_of[row["image"]], file_of[row["image"]] = row["content"], file
    items = [
        PairItem(pair, (content_of[pair[0]], content_of[pair[1]]))
        for pair in wanted
        if all(name in content_of for name in pair)
    ]
    return items, file_of


def _shards(items: Sequence[PairItem], file_of: Mapping[str, str]) -> Iterator[MatchShard]:
    """Blocks of the pairs whose features are in the same two files."""
    blocks: dict[tuple[str, str], list[PairItem]] = {}
    for item in items:
        first, second = (file_of[name] for name in item.pair)
        blocks.setdefault((first, second), []).append(item)
    for files, block in blocks.items():
        rest = iter(block)
        while part := list(islice(rest, MAX_PAIRS)):
            yield MatchShard(part, files)


def _until(should_stop: Callable[[], bool], shards: Iterator[MatchShard]) -> Iterator[MatchShard]:
    for shard in shards:
        if should_stop():
            return
        yield shard


def _current(store: Store, keys: set[Key]) -> dict[Pair, MatchedPair]:
    """The matches of these keys."""
    return {
        found.pair: found
        for file, held in read_keys(store)
        if held & keys
        for key, found in read_matches(store, file)
        if key in keys
    }
