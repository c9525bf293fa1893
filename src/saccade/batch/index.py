"""Which images show the same thing: descriptors in faiss, what it finds checked by geometry.

An index is a folder beside the table:

    index/vectors.faiss      the descriptors, byte by byte, in cells about learnt centers
    index/places.npy         their (x, y), image by image
    index/images.json        what made it, and the images with their first row
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.batch.job import POINTS
from saccade.batch.manifest import read_manifest, record_files
from saccade.batch.shards import read_record, read_rows
from saccade.batch.store import Folder
from saccade.batch.tables import ENTRIES, point_schema
from saccade.errors import ConfigError, KeypointsError, OutputError, require
from saccade.extras import import_optional
from saccade.files import atomic_write, check_file, one_line, read_text, text_path
from saccade.formats import FORMATS, check_format
from saccade.keypoints.matching import match
from saccade.keypoints.verification import verify
from saccade.npz import map_array
from saccade.types import Float32Array, IntArray, Keypoints

FOLDER = "index"
TO_A_CELL = 200
"""Descriptors to a cell, at least."""
LEARNT_FROM = 64
"""Descriptors that a cell is learnt from, at most; faiss asks for 39 or more."""
SMALL = 20_000
"""Descriptors that are compared one by one: they take less time than to learn cells."""
NEIGHBORS = 10
"""Of a point of the image that is looked for; the last says how far chance is away."""
PROBES = 16
"""Cells that are looked into."""


@dataclass(frozen=True)
class FindConfig:
    """How images are looked up."""

    candidates: int = 30
    """Images, those with the most similar points, whose geometry is checked."""
    ratio: float = 0.8
    """A match is made if its distance is under this share of the distance to the next."""
    agreeing: int = 15
    """Matches that must agree on one geometry; different rooms of a house have up to 18."""

    def __post_init__(self) -> None:
        require(self.candidates >= 1, "candidates", "1 or more", self.candidates)
        require(0 < self.ratio <= 1, "ratio", "over 0, at most 1", self.ratio)
        require(self.agreeing >= 8, "agreeing", "8 or more", self.agreeing)


class Found(NamedTuple):
    """An image that shows what was looked for."""

    image: str
    agreeing: int
    """Matches that agree on one geometry of the two views; 0 where too few do."""
    similarity: float
    """What its points are like those looked for, of which geometry knows nothing."""


class Index:
    """The points of a data set, to look images up in.

    Args:
        folder: of the data set, with an index in it.

    Raises:
        ConfigError: it has none, or faiss is not installed.
    """

    def __init__(self, folder: str | Path) -> None:
        self._faiss = import_optional("faiss", "find")
        place = Path(folder) / FOLDER
        try:
            told = json.loads(read_text(place / "images.json"))
            check_file(place / "vectors.faiss")
            with text_path(place / "vectors.faiss") as name:
                self._vectors = self._faiss.read_index(name, self._faiss.IO_FLAG_MMAP)
            self._places = map_array(place / "places.npy")
            version = told.get("format")
        except (OSError, ValueError, RuntimeError, AttributeError) as error:
            raise ConfigError(f"{folder}: expected an index; make one: saccade index") from error
        check_format("index", version, place / "images.json", ConfigError)
        _check(place, told, self._places, self._vectors)
        self.what: str = told["what"]
        """What made the points."""
        self.settings: dict[str, Any] = told["settings"]
        """Its configuration: of the points that are looked for, too."""
        self.most: int = told["most"]
        """Points of an image, at most."""
        self.images: list[str] = told["images"]
        """Names."""
        if hasattr(self._vectors, "make_direct_map"):  # to read the points of an image
            self._vectors.make_direct_map()
        self._first: IntArray = np.array([*told["first"], len(self._places)], np.int64)

    def __len__(self) -> int:
        return len(self.images)

    def find(
        self, points: Keypoints, config: FindConfig | None = None, without: str | None = None
    ) -> list[Found]:
        """The images that show the same thing, the surest first.

        Args:
            points: of the image, as the points of the data set were made.
            config: how to look.
            without: an image to leave out.

        Returns:
            At most as many as there are candidates; first those whose geometry agrees.
        """
        config = config or FindConfig()
        points = points[: self.most]
        similarity = self._similarity(points)
        if without in self.images:
            similarity[self.images.index(without)] = 0
        best = np.argsort(-similarity, kind="stable")[: config.candidates]
        found = [
            Found(self.images[number], self._agreeing(points, number, config), similarity[number])
            for number in best.tolist()
            if similarity[number] > 0
        ]
        return sorted(found, key=lambda each: (-each.agreeing, -each.similarity))

    def points_of(self, number: int) -> Keypoints:
        """The points of an image that are in the index.

        Raises:
            KeypointsError: the index is broken there.
        """
        first, end = self._first[number : number + 2].tolist()
        rows = self._vectors.reconstruct_n(first, end - first)
        if not ((rows >= 0) & (rows <= 255)).all():
            raise KeypointsError(
                f"{self.images[number]}: expected bytes in the index, found others"
            )
        points = Keypoints.at(self._places[first:end], 1.0)
        return replace(points, descriptors=rows.astype(np.uint8))

    def _similarity(self, points: Keypoints) -> Float32Array:
        """(images,) how many points are like those of each, a near one counting up to 1.

        A point has a vote for the nearest of an image: how much nearer it is than the last
        neighbor, which is near by chance.
        """
        total = np.zeros(len(self), np.float32)
        if points.descriptors is None or not len(points) or not len(self._places):
            return total
        wanted = points.descriptors.astype(np.float32)
        squares, rows = self._vectors.search(wanted, min(NEIGHBORS, len(self._places)))
        distance = np.sqrt(np.maximum(squares, 0))
        votes = np.where(rows >= 0, 1 - distance / np.maximum(distance[:, -1:], 1), 0)
        image = np.searchsorted(self._first, rows, side="right") - 1
        voter = np.repeat(np.arange(len(points)), rows.shape[1])
        cells, cell = np.unique(voter * len(self) + image.ravel(), return_inverse=True)
        strongest = np.zeros(len(cells), np.float32)
        np.maximum.at(strongest, cell.ravel(), votes.ravel().astype(np.float32))
        np.add.at(total, cells % len(self), strongest)
        return total

    def _agreeing(self, points: Keypoints, number: int, config: FindConfig) -> int:
        there = self.points_of(number)
        pairs = match(points, there, ratio=config.ratio)
        if len(pairs) < config.agreeing:
            return 0
        return int(verify(points, there, pairs, min_inliers=config.agreeing).inliers.sum())


def _check(place: Path, told: dict[str, Any], places: npt.NDArray[Any], vectors: Any) -> None:
    """Refuse an index whose files do not belong together."""
    kinds = {"what": str, "settings": dict, "most": int, "images": list, "first": list}
    for name, kind in kinds.items():
        if not isinstance(told.get(name), kind):
            found = repr(told[name])[:80] if name in told else "none"
            raise ConfigError(f"{place / 'images.json'}: expected {name!r} in it, found {found}")
    images, first = told["images"], told["first"]
    named = all(isinstance(each, str) for each in images)
    numbered = all(type(each) is int and 0 <= each <= len(places) for each in first)
    whole = named and numbered and len(images) == len(first) and first == sorted(first)
    if not whole or told["what"] not in POINTS or told["most"] < 1:
        raise ConfigError(f"{place / 'images.json'}: expected the images of the index")
    if places.shape != (vectors.ntotal, 2) or places.dtype != np.float32 or vectors.d != ENTRIES:
        raise ConfigError(
            f"{place}: expected a place for each of {vectors.ntotal} descriptors, "
            f"found {places.dtype} of shape {places.shape}"
        )


def build_index(folder: str | Path, most: int = 1000) -> dict[str, int]:
    """Make an index of the points of a data set; replaces an old one.

    Args:
        folder: of the data set; on this machine.
        most: points of each image, the strongest.

    Returns:
        How many `images` and `points` are in it.

    Raises:
        ConfigError: the folder holds no points, or faiss is not installed.
        OutputError: it cannot be written.
    """
    faiss = import_optional("faiss", "find")
    require(most >= 1, "points", "1 or more", most)
    store = Folder(str(folder))
    manifest = read_manifest(store)
    if manifest is None or manifest["what"] not in POINTS:
        found = "no manifest.json" if manifest is None else manifest["what"]
        raise ConfigError(f"{folder}: expected extracted points, found {found}")
    what, place = manifest["what"], Path(folder) / FOLDER
    images, first, count = _layout(store, most)
    vectors = _empty(faiss, store, what, most, count)
    with (
        atomic_write(place / "places.npy") as places_path,
        atomic_write(place / "vectors.faiss") as vectors_path,
        atomic_write(place / "images.json") as images_path,
    ):
        places = []
        for xy, descriptors in _kept(store, what, most):
            places.append(xy)
            vectors.add(descriptors.astype(np.float32))
        np.save(places_path, np.concatenate([np.zeros((0, 2), np.float32), *places]))
        try:
            with text_path(vectors_path) as name:
                faiss.write_index(vectors, name)
        except RuntimeError as error:
            message = f"{place / 'vectors.faiss'}: cannot be written: {one_line(error)}"
            raise OutputError(message) from error
        told = {
            "format": FORMATS["index"],
            "what": what,
            "settings": manifest["configuration"].get("settings", {}),
            "most": most,
            "images": images,
            "first": first,
        }
        images_path.write_text(json.dumps(told), encoding="utf-8")
    return {"images": len(images), "points": count}


def _layout(store: Folder, most: int) -> tuple[list[str], list[int], int]:
    """The images that have points, the first row of each in the index, and how many rows."""
    images, first, count = [], [], 0
    for file in record_files(store):
        for row in read_record(store, file, ["image", "rows"]).to_pylist():
            if row["rows"]:
                images.append(row["image"])
                first.append(count)
                count += min(row["rows"], most)
    return images, first, count


def _kept(
    store: Folder, what: str, most: int
) -> Iterator[tuple[Float32Array, npt.NDArray[np.uint8]]]:
    """Places and descriptors of the strongest points of every image, shard by shard."""
    schema = point_schema(boxes=False)
    for file in record_files(store):
        counts = read_record(store, file, ["rows"])["rows"].to_numpy()
        starts = np.cumsum(counts) - counts
        table = read_rows(store, f"{what}/{file}", schema, ["x", "y", "descriptor"])
        if len(table) != counts.sum():
            raise KeypointsError(f"{what}/{file}: expected {counts.sum()} rows, found {len(table)}")
        rank = np.arange(len(table)) - np.repeat(starts, counts)
        xy = np.stack([table["x"].to_numpy(), table["y"].to_numpy()], axis=1)
        packed = table["descriptor"].combine_chunks()
        described = np.frombuffer(packed.buffers()[1], np.uint8).reshape(-1, ENTRIES)[: len(table)]
        yield xy[rank < most], described[rank < most]


def _empty(faiss: Any, store: Folder, what: str, most: int, count: int) -> Any:
    """An index of faiss's for `count` descriptors, which has learnt its cells from some."""
    if count < SMALL:
        return faiss.IndexFlatL2(ENTRIES)
    cells = cells_for(count)
    share = min(LEARNT_FROM * cells / count, 1.0)
    chance = np.random.default_rng(0)
    some = [each[chance.random(len(each)) < share] for _, each in _kept(store, what, most)]
    return empty_cells(faiss, cells, np.concatenate(some).astype(np.float32))


def cells_for(count: int) -> int:
    """How many cells `count` descriptors are sorted into."""
    return int(min(4 * count**0.5, count / TO_A_CELL))


def empty_cells(faiss: Any, cells: int, some: Float32Array) -> Any:
    """An index of faiss's that has learnt its cells from some descriptors, (n, 128)."""
    centers = faiss.IndexFlatL2(ENTRIES)
    index = faiss.IndexIVFScalarQuantizer(
        centers, ENTRIES, cells, faiss.ScalarQuantizer.QT_8bit_direct, faiss.METRIC_L2, False
    )
    index.nprobe = PROBES
    index.own_fields = bool(centers.this.disown() is None)
    index.train(some)
    return index
