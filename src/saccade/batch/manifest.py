"""What a folder of results says about itself."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from saccade.batch.job import Job
from saccade.batch.shards import PREFIX, RECORDS, SUFFIX, read_record
from saccade.batch.store import Store
from saccade.batch.tables import ERRORS, batch_of, parquet_options
from saccade.errors import ConfigError
from saccade.files import LARGEST_TEXT, reason_of
from saccade.formats import FORMATS, check_format

MANIFEST = "manifest.json"
ERROR_FILE = "errors.parquet"


@dataclass(frozen=True)
class Totals:
    """What a folder of results holds."""

    images: int = 0
    """That are in the table, those without a row among them."""
    rows: int = 0
    """Of the table."""
    errors: int = 0
    """Images that have none."""
    shards: int = 0
    """Files of the table."""
    by_other_versions: int = 0
    """Images that another version of this package did."""


def read_manifest(store: Store) -> dict[str, Any] | None:
    """What is in the manifest; None where there is none."""
    try:
        with store.open(MANIFEST) as file:
            told = dict(json.loads(file.read(LARGEST_TEXT)))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise ConfigError(
            f"{store.place}/{MANIFEST}: cannot be read: {reason_of(error)}"
        ) from error
    check_format("extraction", told.get("format"), f"{store.place}/{MANIFEST}", ConfigError)
    if not isinstance(told.get("configuration"), dict) or "what" not in told:
        expected = "expected what `saccade extract` writes, found other names"
        raise ConfigError(f"{store.place}/{MANIFEST}: {expected}")
    return told


def check_manifest(store: Store, job: Job, *, redo: bool) -> None:
    """Refuse to mix what different configurations make.

    Raises:
        ConfigError: the folder holds something else; says what differs.
    """
    found = read_manifest(store)
    if found is None or redo:
        return
    asked, held = _flat(json.loads(json.dumps(job.described()))), _flat(found["configuration"])
    for name in dict.fromkeys([*held, *asked]):
        if asked.get(name) != held.get(name):
            raise ConfigError(
                f"{store.place}: made with {name} {held.get(name)!r}, "
                f"found {asked.get(name)!r} asked for; take another --out, or --redo to do all anew"
            )


def last_totals(store: Store) -> Totals:
    """What the manifest says of the last run that came to its end."""
    found = read_manifest(store) or {}
    return Totals(*(found.get(field.name, 0) for field in fields(Totals)))


def write_manifest(store: Store, job: Job, source: str, totals: Totals, *, complete: bool) -> None:
    """Say what made the folder, of what, and how far it is."""
    told = {
        "format": FORMATS["extraction"],
        "saccade": job.version,
        "what": job.what,
        "configuration": job.described(),
        "fingerprint": job.fingerprint,
        "source": source,
        "complete": complete,
        **asdict(totals),
    }
    with store.writing(MANIFEST) as path:
        path.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def write_errors(store: Store, job: Job, lost: Sequence[tuple[str, str]]) -> Totals:
    """Gather the images with an error in one file, if there are any; and count all.

    Args:
        store: with the records of every shard.
        job: whose version counts as this one.
        lost: images whose results could not be written, and why.
    """
    images = rows = errors = shards = others = 0
    unwritten = [{"image": name, "error": why} for name, why in lost]
    batches = [pa.Table.from_batches([batch_of(unwritten, ERRORS)])]
    for record in records(store):
        wrong = record.filter(record["error"].is_valid()).select(ERRORS.names)
        if len(wrong):
            batches.append(wrong)
        shards += 1
        errors += len(wrong)
        images += len(record) - len(wrong)
        rows += sum(record["rows"].to_pylist())
        others += sum(version != job.version for version in record["version"].to_pylist())
    found = pa.concat_tables(batches)
    if len(found):
        with store.writing(ERROR_FILE) as path, path.open("wb") as file:
            pq.write_table(found, file, **parquet_options(ERRORS))
    else:
        store.remove(ERROR_FILE)
    return Totals(images, rows, errors + len(lost), shards, others)


def records(store: Store) -> Iterator[pa.Table]:
    """The record of every shard, one after the other."""
    for file in record_files(store):
        yield read_record(store, file)


def record_files(store: Store) -> list[str]:
    """What the records are called: of every shard that of its youngest generation."""
    youngest: dict[str, int] = {}
    for file in store.names(RECORDS):
        if file.endswith(SUFFIX):
            shard, generation = generation_of(file)
            youngest[shard] = max(generation, youngest.get(shard, 0))
    return sorted(f"{PREFIX}{name_of(*each)}{SUFFIX}" for each in youngest.items())


def generation_of(file: str) -> tuple[str, int]:
    """What the generations of a shard share in their names, and the number of this one."""
    first, *others = file.removeprefix(PREFIX).removesuffix(SUFFIX).split("-")
    return "-".join([first, *others[:1]]), int(others[1]) if others[1:] else 0


def name_of(shard: str, generation: int) -> str:
    """The name of a generation of a shard."""
    return f"{shard}-{generation}" if generation else shard


def _flat(values: dict[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{before}{name}.")
        else:
            flat[f"{before}{name}"] = value
    return flat
