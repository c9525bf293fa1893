"""Small photographs, what is extracted of them, and processes that are killed at it."""

import itertools
import json
import os
import random
import shutil
import signal
import sys
import time
from functools import cache
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq

from saccade import Sift, SiftConfig
from saccade.batch import Job, extract, open_source
from saccade.batch.sources import content_hash
from saccade.io.image import decode_image

SIFT = Job("sift", SiftConfig())


def photographs(folder, count):
    """So many pieces of the hallway, each of another place; gives their paths."""
    hallway = cv2.imread(str(files("saccade") / "data" / "hallway_1.jpg"))
    folder.mkdir(exist_ok=True)
    paths = []
    for number in range(count):
        y, x = 37 * number % 320, 53 * number % 416
        paths.append(folder / f"{number:03d}.png")
        cv2.imwrite(str(paths[-1]), hallway[y : y + 64, x : x + 96])
    return paths


def extract_here(source, out, job=SIFT, size=3, **options):
    """`extract` in this process."""
    return extract(open_source(str(source)), job, str(out), block_size=size, **options)


def records_of(path):
    """The records in the metadata of a file."""
    return json.loads(pq.read_metadata(path).metadata[b"saccade"])["images"]


def check_whole(out, table="sift"):
    """Every image is in one file, with all its rows; gives the rows by image."""
    rows = {}
    for path in sorted((out / table).glob("[!.]*.parquet")):
        found = pq.ParquetFile(path).read().to_pandas()
        records = records_of(path)
        ends = np.cumsum([0, *(row["rows"] for row in records)])
        for row, first, end in zip(records, ends, ends[1:], strict=False):
            assert row["image"] not in rows, "twice"
            rows[row["image"]] = found.iloc[first:end]
        assert list(found.image) == [row["image"] for row in records for _ in range(row["rows"])]
    return rows


def check_complete(source, out, gone=()):
    """Every image of a folder is there once, with the points that it has and no others.

    Args:
        source: the folder.
        out: what was made of it.
        gone: names of images that it held before.
    """
    rows = check_whole(out)
    summary = pq.read_table(out / "images.parquet").to_pandas().set_index("image")
    paths = {path.name: path for path in source.iterdir()}
    assert set(rows) == set(summary.index) == {*paths, *gone}
    assert not list(out.rglob(".*"))
    for name, path in paths.items():
        content = path.read_bytes()
        points = points_of(content)
        assert len(rows[name]) == summary.rows[name] == len(points)
        np.testing.assert_allclose(rows[name][["x", "y"]], points.xy, atol=0.5 / 256)
        described = np.frombuffer(b"".join(rows[name].descriptor), np.uint8).reshape(-1, 128)
        assert np.abs(described.astype(int) - points.descriptors).max(initial=0) <= 1
        assert summary.content[name] == content_hash(content)


@cache
def points_of(content):
    """What is in an image, by the detector itself."""
    return Sift(threads=1)(decode_image(content, ""))


def die_at_call(limit):
    """kill -9 this process at its call of this number."""
    calls = itertools.count(1)

    def count(_frame, event, _argument):
        if event.endswith("call") and next(calls) == limit:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.setprofile(count)


def count_calls(work):
    """How many calls this makes."""
    calls = itertools.count()
    sys.setprofile(lambda _frame, event, _argument: event.endswith("call") and next(calls))
    work()
    sys.setprofile(None)
    return next(calls)


def kill_many(source, out, kills, before=None):
    """Begin as often as said, each time in a folder of its own, and kill -9 at a random moment.

    Half of the moments are calls of the work, which are the same however fast the machine is;
    the other half are times, which come anywhere, in the midst of writing too.

    Args:
        source: the images.
        out: folder of the folders.
        kills: how often.
        before: folder of earlier results, of which each begins with a copy.
    """
    for name in ("loaded", "timed", "counted", *map(str, range(1, kills + 1))):
        if before is not None:
            shutil.copytree(before, out / name)
    extract_here(source, out / "loaded")  # the children have all of it loaded
    start = time.perf_counter()
    extract_here(source, out / "timed")
    took = time.perf_counter() - start
    calls = count_calls(lambda: extract_here(source, out / "counted"))
    moments = random.Random(kills)
    for number in range(1, kills + 1):
        moment = moments.random()
        child = os.fork()
        if child == 0:
            if number % 2:
                die_at_call(int(moment * calls) + 1)
            extract_here(source, out / str(number))
            os._exit(0)
        if number % 2 == 0:
            time.sleep(moment * took)
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


if __name__ == "__main__":
    source, out, kills, changed, changed_out, before = sys.argv[1:]
    kill_many(Path(source), Path(out), int(kills))
    kill_many(Path(changed), Path(changed_out), int(kills), Path(before))
