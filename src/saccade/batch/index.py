"""Image retrieval: descriptors in a faiss index, candidates verified by epipolar geometry.

An index is a folder of the data set:

    index/vectors.faiss      the descriptors as bytes, in the cells of a coarse quantizer
    index/places.npy         their positions (x, y), image by image
    index/images.json        what made it, and the images with their first row
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.batch.dataset import (
    MANIFEST,
    ImageKeypoints,
    point_shards,
    read_point_manifest,
    read_record,
    record_files,
)
from saccade.batch.job import POINTS
from saccade.batch.sources import Store
from saccade.batch.tables import DESCRIPTOR_SIZE
from saccade.errors import ConfigError, KeypointsError, OutputError, require
from saccade.extras import import_optional
from saccade.io.files import (
    FORMATS,
    atomic_write,
    check_file,
    check_format,
    one_line,
    read_text,
    results_in,
    text_path,
)
from saccade.io.npz import map_array
from saccade.keypoints.matching import match
from saccade.keypoints.verification import verify
from saccade.types import Float32Array, IntArray, Keypoints

FOLDER = "index"
VECTOR_FILE, POSITION_FILE, IMAGE_FILE = "vectors.faiss", "places.npy", "images.json"
MIN_PER_CELL = 200
"""Mean number of descriptors in a cell."""
TRAINING_PER_CELL = 64
"""Descriptors from which a cell is trained, at most; faiss asks for 39 or more."""
EXHAUSTIVE_BELOW = 20_000
"""Descriptors that are searched exhaustively: faster than to train cells."""
NEIGHBORS = 10
"""Nearest descriptors of a query point; the last is taken for a chance distance."""
PROBES = 16
"""Cells that are searched."""


class Found(NamedTuple):
    """A candidate for a query image."""

    image: str
    inliers: int | None
    """Matches that agree on one geometry of the two views; None if fewer than `min_inliers`."""
    similarity: float
    """Sum of the votes of the query points, each at most 1; knows nothing of geometry."""


class Index:
    """The index of a data set, for image retrieval.

    Args:
        folder: of the data set.

    Raises:
        ConfigError: it has no index or one of another state of it, or faiss is not installed.
    """

    def __init__(self, folder: str | Path) -> None:
        faiss = import_optional("faiss", "find")
        path = Path(folder) / FOLDER
        try:
            header = json.loads(read_text(path / IMAGE_FILE))
            check_file(path / VECTOR_FILE)
            with text_path(path / VECTOR_FILE) as name:
                self._vectors = faiss.read_index(name, faiss.IO_FLAG_MMAP)
            self._positions = map_array(path / POSITION_FILE)
            version = header.get("format")
        except (OSError, ValueError, RuntimeError, AttributeError) as error:
            raise ConfigError(
                f"{folder}: expected an index; make one: saccade find --in {folder}"
            ) from error
        check_format("index", version, path / IMAGE_FILE, ConfigError)
        _check_index(path, header, self._positions, self._vectors)
        _check_data_set(folder, header)
        self.what: str = header["what"]
        """Detector of the points."""
        self.settings: dict[str, Any] = header["settings"]
        """Configuration of the detector, for query images too."""
        self.max_points: int = header["most"]
        """Points of an image, at most."""
        self.images: list[str] = header["images"]
        """Names."""
        if hasattr(self._vectors, "make_direct_map"):  # for `reconstruct_n`
            self._vectors.make_direct_map()
        self._first_rows: IntArray = np.array([*header["first"], len(self._positions)], np.int64)

    def __len__(self) -> int:
        return len(self.images)

    def find(
        self,
        points: Keypoints,
        *,
        candidates: int = 30,
        ratio: float = 0.8,
        min_inliers: int = 15,
        exclude: str | None = None,
    ) -> list[Found]:
        """The images that show the same as a query image.

        Args:
            points: of the query, detected as those of the data set were.
            candidates: number of images, those with the most similar points, that are verified.
            ratio: of the ratio test between nearest and second nearest descriptor, in (0, 1].
            min_inliers: that confirm a candidate, 8 or more; different rooms have up to 18.
            exclude: name of an image to leave out, such as the query itself.

        Returns:
            The candidates, the most inliers first, then by similarity.

        Raises:
            ConfigError: a parameter outside its range.
        """
        require(candidates >= 1, "candidates", "1 or more", candidates)
        require(0 < ratio <= 1, "ratio", "over 0, at most 1", ratio)
        require(min_inliers >= 8, "min_inliers", "8 or more", min_inliers)
        points = points[: self.max_points]
        similarity = self._similarity(points)
        if exclude in self.images:
            similarity[self.images.index(exclude)] = 0
        best = np.argsort(-similarity, kind="stable")[:candidates]
        found = [
            Found(
                self.images[number],
                self._verify(points, number, ratio, min_inliers),
                similarity[number],
            )
            for number in best.tolist()
            if similarity[number] > 0
        ]
        return sorted(found, key=lambda image: (-(image.inliers or 0), -image.similarity))

    def points_of(self, number: int) -> Keypoints:
        """The points of an image: position and descriptor, without scale.

        Raises:
            KeypointsError: the index is broken there.
        """
        first, end = self._first_rows[number : number + 2].tolist()
        descriptors = self._vectors.reconstruct_n(first, end - first)
        if not ((descriptors >= 0) & (descriptors <= 255)).all():
            raise KeypointsError(
                f"{self.images[number]}: expected bytes in the index, found others"
            )
        points = Keypoints.at(self._positions[first:end], 1.0)
        return replace(points, descriptors=descriptors.astype(np.uint8))

    def _similarity(self, points: Keypoints) -> Float32Array:
        """(images,) sum of votes.

        A point votes for the image of its nearest descriptors, once for each: by how much nearer
        it is than the last neighbor, which is near by chance.
        """
        total = np.zeros(len(self), np.float32)
        if points.descriptors is None or not len(points) or not len(self._positions):
            return total
        query = points.descriptors.astype(np.float32)
        squares, rows = self._vectors.search(query, min(NEIGHBORS, len(self._positions)))
        distance = np.sqrt(np.maximum(squares, 0))
        votes = np.where(rows >= 0, 1 - distance / np.maximum(distance[:, -1:], 1), 0)
        image = np.searchsorted(self._first_rows, rows, side="right") - 1
        voter = np.repeat(np.arange(len(points)), rows.shape[1])
        pairs, pair = np.unique(voter * len(self) + image.ravel(), return_inverse=True)
        strongest = np.zeros(len(pairs), np.float32)
        np.maximum.at(strongest, pair.ravel(), votes.ravel().astype(np.float32))
        np.add.at(total, pairs % len(self), strongest)
        return total

    def _verify(self, points: Keypoints, number: int, ratio: float, min_inliers: int) -> int | None:
        """Number of inliers of an image; None if they are too few."""
        candidate = self.points_of(number)
        pairs = match(points, candidate, ratio=ratio)
        if len(pairs) < min_inliers:
            return None
        inliers = verify(points, candidate, pairs, min_inliers=min_inliers).inliers
        return int(inliers.sum()) or None


def build_index(folder: str | Path, max_points: int = 1000) -> dict[str, int]:
    """Index the points of a data set; replaces an old index.

    Args:
        folder: of the data set; on this machine.
        max_points: of each image, the strongest.

    Returns:
        Number of `images` and `points` in the index.

    Raises:
        ConfigError: the folder holds no points, or faiss is not installed.
        OutputError: it cannot be written.
    """
    faiss = import_optional("faiss", "find")
    require(max_points >= 1, "points", "1 or more", max_points)
    store = Store(str(folder))
    manifest = read_point_manifest(store)
    what, path = manifest["what"], Path(folder) / FOLDER
    vectors = _trained_index(faiss, store, what, max_points)
    images: list[str] = []
    first_rows: list[int] = []
    positions = [np.zeros((0, 2), np.float32)]
    count = 0
    with (
        results_in(path),
        atomic_write(path / POSITION_FILE) as position_path,
        atomic_write(path / VECTOR_FILE) as vector_path,
        atomic_write(path / IMAGE_FILE) as image_path,
    ):
        for shard in _strongest_points(store, what, max_points):
            for image, _, points in shard:
                images.append(image)
                first_rows.append(count)
                positions.append(points.xy)
                count += len(points)
            vectors.add(_descriptors(shard).astype(np.float32))
        np.save(position_path, np.concatenate(positions))
        try:
            with text_path(vector_path) as name:
                faiss.write_index(vectors, name)
        except RuntimeError as error:
            message = f"{path / VECTOR_FILE}: cannot be written: {one_line(error)}"
            raise OutputError(message) from error
        header = {
            "format": FORMATS["index"],
            "what": what,
            "settings": manifest["configuration"].get("settings", {}),
            "data_set": _state(manifest),
            "most": max_points,
            "images": images,
            "first": first_rows,
        }
        image_path.write_text(json.dumps(header), encoding="utf-8")
    return {"images": len(images), "points": count}


def count_cells(count: int) -> int:
    """Number of cells for `count` descriptors."""
    return int(min(4 * count**0.5, count / MIN_PER_CELL))


def train_cells(faiss: Any, cells: int, sample: Float32Array) -> Any:
    """An empty inverted-file index whose cells are trained on some descriptors, (n, 128)."""
    quantizer = faiss.IndexFlatL2(DESCRIPTOR_SIZE)
    index = faiss.IndexIVFScalarQuantizer(
        *(quantizer, DESCRIPTOR_SIZE, cells),
        *(faiss.ScalarQuantizer.QT_8bit_direct, faiss.METRIC_L2, False),
    )
    index.nprobe = PROBES
    index.own_fields = bool(quantizer.this.disown() is None)
    index.train(sample)
    return index


def _trained_index(faiss: Any, store: Store, what: str, max_points: int) -> Any:
    """An empty index for the points of a data set, trained on a sample of them."""
    records = (read_record(store, file, ["rows"])["rows"] for file in record_files(store))
    count = sum(min(rows, max_points) for record in records for rows in record.to_pylist())
    if count < EXHAUSTIVE_BELOW:
        return faiss.IndexFlatL2(DESCRIPTOR_SIZE)
    cells = count_cells(count)
    fraction = min(TRAINING_PER_CELL * cells / count, 1.0)
    rng = np.random.default_rng(0)
    descriptors = map(_descriptors, _strongest_points(store, what, max_points))
    sample = [rows[rng.random(len(rows)) < fraction] for rows in descriptors]
    return train_cells(faiss, cells, np.concatenate(sample).astype(np.float32))


def _strongest_points(store: Store, what: str, max_points: int) -> Iterator[list[ImageKeypoints]]:
    """Shard by shard, the strongest points of every image that has any."""
    for shard in point_shards(store, what):
        yield [image._replace(points=image.points[:max_points]) for image in shard if image.points]


def _descriptors(shard: list[ImageKeypoints]) -> npt.NDArray[np.uint8]:
    """(n, 128) of all images of a shard."""
    rows = [image.points.descriptors for image in shard]
    return np.concatenate([np.zeros((0, DESCRIPTOR_SIZE), np.uint8), *rows])


def _state(manifest: dict[str, Any]) -> dict[str, Any]:
    """Part of a manifest in which an index and its data set must agree."""
    return {name: manifest.get(name) for name in ("fingerprint", "images", "rows")}


def _check_data_set(folder: str | Path, header: dict[str, Any]) -> None:
    """Refuse an index of a data set that has changed since; a folder may hold the index alone."""
    if "data_set" not in header or not (Path(folder) / MANIFEST).exists():
        return
    indexed, present = header["data_set"], _state(read_point_manifest(Store(str(folder))))
    if indexed != present:
        raise ConfigError(
            f"{folder}: expected an index of its {present['images']} images, found one of another "
            f"state of the data set; make it again: saccade find --in {folder}"
        )


def _check_index(
    path: Path, header: dict[str, Any], positions: npt.NDArray[Any], vectors: Any
) -> None:
    """Refuse an index whose files do not belong together."""
    kinds = {"what": str, "settings": dict, "most": int, "images": list, "first": list}
    for name, kind in kinds.items():
        if not isinstance(header.get(name), kind):
            found = repr(header[name])[:80] if name in header else "none"
            raise ConfigError(f"{path / IMAGE_FILE}: expected {name!r} in it, found {found}")
    images, first_rows = header["images"], header["first"]
    valid = (
        all(isinstance(image, str) for image in images)
        and all(type(row) is int and 0 <= row <= len(positions) for row in first_rows)
        and len(images) == len(first_rows)
        and first_rows == sorted(first_rows)
    )
    if not valid or header["what"] not in POINTS or header["most"] < 1:
        raise ConfigError(f"{path / IMAGE_FILE}: expected the images of the index")
    expected = (vectors.ntotal, 2)
    if positions.shape != expected or positions.dtype != np.float32 or vectors.d != DESCRIPTOR_SIZE:
        raise ConfigError(
            f"{path}: expected a position for each of {vectors.ntotal} descriptors, "
            f"found {positions.dtype} of shape {positions.shape}"
        )
