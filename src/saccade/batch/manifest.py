"""The manifest of a data set: configuration, totals, and the list of failed images."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from saccade.batch.dataset import MANIFEST, read_manifest, read_records
from saccade.batch.job import Job
from saccade.batch.store import Store
from saccade.batch.tables import ERROR_SCHEMA, parquet_options, record_batch
from saccade.errors import ConfigError
from saccade.formats import FORMATS

ERROR_FILE = "errors.parquet"


@dataclass(frozen=True)
class Totals:
    """What a data set holds."""

    images: int = 0
    """Images in the table, including those without a row."""
    rows: int = 0
    """Rows of the table."""
    errors: int = 0
    """Images that failed."""
    shards: int = 0
    """Files of the table."""
    by_other_versions: int = 0
    """Images that another version of this package did."""


def check_manifest(store: Store, job: Job) -> None:
    """Check that a data set was made with the configuration of a job.

    Raises:
        ConfigError: it was not; says what differs.
    """
    manifest = read_manifest(store)
    if manifest is None:
        return
    requested = _flatten(json.loads(json.dumps(job.describe())))
    recorded = _flatten(manifest["configuration"])
    for name in dict.fromkeys([*recorded, *requested]):
        if requested.get(name) != recorded.get(name):
            raise ConfigError(
                f"{store.location}: made with {name} {recorded.get(name)!r}, found "
                f"{requested.get(name)!r} asked for; take another --out, or --redo to do all anew"
            )


def last_totals(store: Store) -> Totals:
    """Totals of the last run that was completed."""
    manifest = read_manifest(store) or {}
    return Totals(*(manifest.get(field.name, 0) for field in fields(Totals)))


def write_manifest(
    store: Store, job: Job, source: str | None, totals: Totals, *, complete: bool
) -> None:
    """Write the manifest, which describes the job, its source and its progress."""
    manifest = {
        "format": FORMATS["extraction"],
        "saccade": job.version,
        "what": job.what,
        "configuration": job.describe(),
        "fingerprint": job.fingerprint,
        "source": source,
        "complete": complete,
        **asdict(totals),
    }
    with store.writing(MANIFEST) as path:
        path.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")


def write_errors(store: Store, job: Job, lost: Sequence[tuple[str, str]]) -> Totals:
    """Collect the failed images in one file, if there are any, and count all images.

    Args:
        store: with the records of every shard.
        job: whose version is this one.
        lost: images whose results could not be written, and why.
    """
    images = rows = errors = shards = others = 0
    unrecorded = [{"image": name, "error": reason} for name, reason in lost]
    batches = [pa.Table.from_batches([record_batch(unrecorded, ERROR_SCHEMA)])]
    for record in read_records(store):
        failed = record.filter(record["error"].is_valid()).select(ERROR_SCHEMA.names)
        if len(failed):
            batches.append(failed)
        shards += 1
        errors += len(failed)
        images += len(record) - len(failed)
        rows += sum(record["rows"].to_pylist())
        others += sum(version != job.version for version in record["version"].to_pylist())
    table = pa.concat_tables(batches)
    if len(table):
        with store.writing(ERROR_FILE) as path, path.open("wb") as file:
            pq.write_table(table, file, **parquet_options(ERROR_SCHEMA))
    else:
        store.remove(ERROR_FILE)
    return Totals(images, rows, errors + len(lost), shards, others)


def _flatten(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by their dotted names."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, dict):
            flat |= _flatten(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat
