"""Why `saccade extract` packs, rounds and looks up as it does.

`uv run --with hnswlib --with usearch benchmarks/extract_choices.py --pairs DIR`, where DIR holds
sequences of photographs with their homographies, as the affine covariant regions set has them.

- packing: bytes of a point and time of an image, by how descriptors are held
- rounding: matches and right matches, with all bits and rounded
- neighbors: time, memory and hits of vector libraries on descriptors of these photographs
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import faiss
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from saccade import Keypoints, Sift, match, read_image
from saccade.batch import index
from saccade.batch.tables import (
    DESCRIPTOR_SIZE,
    parquet_options,
    point_rows,
    quantize_descriptors,
)
from saccade.datasets.homography_pairs import homography_pairs
from saccade.keypoints.two_view_fit import project

RIGHT = 3.0
"""Pixels within which a match is right."""
EFFORTS = (16, 64)
"""Candidates that the graphs keep while they search."""


def packing(points: dict[str, Keypoints], runs: int) -> None:
    """The table in one file, descriptors as bytes or as a list; with and without rounding."""
    count = sum(map(len, points.values()))
    for exact in (False, True):
        batches = [point_rows(name, each, exact=exact) for name, each in points.items()]
        bytewise = pa.Table.from_batches(batches)
        listed = as_lists(bytewise)
        for name, table in (("binary(128)", bytewise), ("list<uint8>[128]", listed)):
            options = parquet_options(table.schema)
            options["column_encoding"]["descriptor.list.element"] = "BYTE_STREAM_SPLIT"
            if table is bytewise:
                del options["column_encoding"]["descriptor.list.element"]
            times = []
            for _ in range(runs):
                start, file = time.process_time(), BytesIO()
                pq.write_table(table, file, **options)
                times.append(time.process_time() - start)
            bits = "all bits" if exact else "rounded"
            print(
                f"packing: {name}, {bits}: {len(file.getvalue()) / count:.1f} bytes a point, "
                f"{1e3 * np.median(times) / len(points):.2f} ms an image to write"
            )


def as_lists(table: pa.Table) -> pa.Table:
    """Descriptors as lists of 128 numbers."""
    kind = pa.list_(pa.field("element", pa.uint8(), nullable=False), DESCRIPTOR_SIZE)
    flat = np.concatenate(
        [np.frombuffer(each.buffers()[1], np.uint8) for each in table["descriptor"].chunks]
    )
    lists = pa.FixedSizeListArray.from_arrays(pa.array(flat), type=kind)
    place = table.schema.get_field_index("descriptor")
    return table.set_column(place, pa.field("descriptor", kind), lists)


def rounding(folder: Path) -> None:
    """Over all pairs: how many matches there are, and how many hold by the homography."""
    sift = Sift()
    found = {False: np.zeros(2, int), True: np.zeros(2, int)}
    points = {}
    for pair in homography_pairs(folder):
        for path in (pair.first, pair.second):
            points.setdefault(path, sift(read_image(path)))
        for rounded, total in found.items():
            first, second = (
                in_steps(points[path]) if rounded else points[path]
                for path in (pair.first, pair.second)
            )
            pairs = match(first, second)
            there = project(pair.homography, first.xy[pairs[:, 0]].astype(float))
            off = np.hypot(*(there - second.xy[pairs[:, 1]]).T)
            total += [len(pairs), int((off < RIGHT).sum())]
    for rounded, (matches, right) in found.items():
        bits = "rounded" if rounded else "all bits"
        print(f"rounding: {bits}: {matches} matches, {right} right within {RIGHT:g} px")


def in_steps(points: Keypoints) -> Keypoints:
    """With descriptors as a data set holds them."""
    assert points.descriptors is not None
    return replace(points, descriptors=quantize_descriptors(points.descriptors))


def neighbors(points: dict[str, Keypoints], count: int, queries: int) -> None:
    """Descriptors of all photographs but the last of each sequence; those of the last ask."""
    asking = {name: each for name, each in points.items() if name.endswith("6.png")}
    held = descriptors_of({name: points[name] for name in points.keys() - asking.keys()}, count)
    asked = descriptors_of(asking, queries)
    nearest = faiss.IndexFlatL2(DESCRIPTOR_SIZE)
    nearest.add(held)
    distance = nearest.search(asked, 1)[0][:, 0]
    print(f"neighbors: {len(held)} descriptors held, {len(asked)} asked for, one thread")
    for name, build in (
        ("faiss, cells as shipped", cells),
        ("faiss, graph", faiss_graph),
        ("hnswlib", hnsw),
        ("usearch", usearch_graph),
    ):
        try:
            start = time.process_time()
            size, searches = build(held)
        except ImportError:
            print(f"neighbors: {name}: not installed")
            continue
        built = time.process_time() - start
        for effort, search in searches:
            start = time.process_time()
            rows = search(asked)
            took = time.process_time() - start
            off = np.square(held[rows] - asked).sum(axis=1)
            print(
                f"neighbors: {name} ({effort}): built in {built:.1f} s, {size / len(held):.0f} "
                f"bytes each, {1e6 * took / len(asked):.0f} us a search, "
                f"nearest found {100 * (off <= distance + 0.5).mean():.1f} %",
                flush=True,
            )


Searches = tuple[float, list[tuple[str, Callable[[Any], Any]]]]


def descriptors_of(points: dict[str, Keypoints], count: int) -> Any:
    """Some of the descriptors, the same whenever asked."""
    every = np.concatenate([points[name].descriptors for name in sorted(points)])
    some = np.random.default_rng(0).permutation(len(every))[:count]
    return quantize_descriptors(every[some]).astype(np.float32)


def size_of(vectors: Any) -> float:
    return float(faiss.serialize_index(vectors).nbytes)


def cells(held: Any) -> Searches:
    number = index.count_cells(len(held))
    some = held[: index.TRAINING_PER_CELL * number]
    vectors = index.train_cells(faiss, number, some)
    vectors.add(held)
    return size_of(vectors), [
        (f"{index.PROBES} cells", lambda asked: vectors.search(asked, 1)[1][:, 0])
    ]


def faiss_graph(held: Any) -> Searches:
    vectors = faiss.IndexHNSWSQ(DESCRIPTOR_SIZE, faiss.ScalarQuantizer.QT_8bit_direct, 16)
    vectors.train(held)
    vectors.add(held)

    def search(asked: Any, effort: int) -> Any:
        vectors.hnsw.efSearch = effort
        return vectors.search(asked, 1)[1][:, 0]

    return size_of(vectors), [
        (f"effort {effort}", lambda asked, e=effort: search(asked, e)) for effort in EFFORTS
    ]


def hnsw(held: Any) -> Searches:
    import hnswlib

    vectors = hnswlib.Index("l2", DESCRIPTOR_SIZE)
    vectors.init_index(len(held), M=16, ef_construction=100)
    vectors.add_items(held, num_threads=1)

    def search(asked: Any, effort: int) -> Any:
        vectors.set_ef(effort)
        return vectors.knn_query(asked, 1, num_threads=1)[0][:, 0].astype(np.int64)

    return vectors.index_file_size(), [
        (f"effort {effort}", lambda asked, e=effort: search(asked, e)) for effort in EFFORTS
    ]


def usearch_graph(held: Any) -> Searches:
    from usearch.index import Index

    vectors = Index(
        ndim=DESCRIPTOR_SIZE, metric="l2sq", dtype="f16", connectivity=16, expansion_add=100
    )
    vectors.add(np.arange(len(held)), held, threads=1)

    def search(asked: Any, effort: int) -> Any:
        vectors.expansion_search = effort
        return vectors.search(asked, 1, threads=1).keys[:, 0].astype(np.int64)

    return len(vectors.save()), [
        (f"effort {effort}", lambda asked, e=effort: search(asked, e)) for effort in EFFORTS
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=Path, required=True, help="folder of sequences")
    parser.add_argument("--only", choices=("packing", "rounding", "neighbors"))
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--held", type=int, default=40_000, help="descriptors to search in")
    parser.add_argument("--queries", type=int, default=2000)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    faiss.omp_set_num_threads(1)
    if options.only in (None, "rounding"):
        rounding(options.pairs)
    if options.only == "rounding":
        return
    sift = Sift(threads=1)
    paths = sorted(options.pairs.glob("*/*.png"))
    points = {f"{each.parent.name}/{each.name}": sift(read_image(each)) for each in paths}
    if options.only in (None, "packing"):
        packing(points, options.runs)
    if options.only in (None, "neighbors"):
        neighbors(points, options.held, options.queries)


if __name__ == "__main__":
    main()
