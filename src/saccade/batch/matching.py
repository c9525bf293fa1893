"""Matches pairs of many images, into the files of hloc and COLMAP.

The folder that it writes:

    features/      the data set of keypoints, as `saccade.batch.extract` writes it
    matches/       blocks of matches, named by the hash of all they depend on
    pairs.txt      the pairs
    pairs.csv      their numbers of matches and inliers
    features.h5, matches.h5    in hloc's layout; database.db for COLMAP
"""

import csv
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from saccade.batch.dataset import (
    block_files,
    read_block,
    read_block_points,
    read_points,
)
from saccade.batch.extraction import MIN_BLOCKS, Extraction, extract
from saccade.batch.job import MAPS, SCANPATH, Job
from saccade.batch.pairs import Pair, images_and_pairs, write_pairs
from saccade.batch.sources import is_local_file
from saccade.batch.storage import Store
from saccade.batch.stored import check_stored
from saccade.errors import KeypointsError, OutputError, Settings, require, setting
from saccade.exchange import write_colmap, write_hdf5, write_hloc_matches
from saccade.exchange.colmap import CameraMode, check_cameras
from saccade.exchange.colmap_cameras import Cameras
from saccade.extras import import_optional
from saccade.io.files import atomic_write, locked, reading
from saccade.io.npz import read_arrays, save_arrays
from saccade.keypoints.detectors import DETECTORS
from saccade.keypoints.guided import verified_again
from saccade.keypoints.matching import Metric, match
from saccade.keypoints.sift_config import SiftConfig
from saccade.keypoints.two_view_fit import Geometry
from saccade.keypoints.verification import MIN_INLIERS, Verification, verify
from saccade.types import Float32Array, IntArray, Keypoints
from saccade.workers import DIED, count_workers, run_blocks

Format: TypeAlias = Literal["hdf5", "colmap"]
FOLDER = "matches"
FEATURES = "features"
"""Folder of the data set of keypoints."""
IMAGES_PER_BLOCK = 32
"""Images in a block of features: a worker has two such blocks in memory."""
STORED = ("matrix", "model", "homography")
"""Fields of a verification that are stored with its inliers."""
PAIRS_PER_BLOCK = 256
"""Pairs in a block of matches."""


@dataclass(frozen=True)
class MatchConfig(Settings):
    """Settings of the matching of two images and of the verification of the matches."""

    ratio: float | None = setting(0.8, above=0, maximum=1)
    """See `saccade.match`."""
    mutual: bool = True
    """See `saccade.match`."""
    geometry: Geometry | None = "fundamental"
    """See `saccade.verify`; None for no verification."""
    tolerance: float = setting(2.0, above=0)
    """Inlier threshold in pixels."""
    min_inliers: int = setting(MIN_INLIERS, 1)
    """Smallest number of distinct inliers of an accepted geometry."""
    metric: Metric | None = None
    """See `saccade.match`."""
    guided: bool = False
    """Whether verified pairs are matched again along their geometry, with a ratio halfway between
    `ratio` and 1; see `saccade.match_guided`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        verified = self.geometry is not None or not self.guided
        require(verified, "guided", "a geometry for guided matching", self.geometry)


class PairBlock(NamedTuple):
    """Pairs of images whose matches share a file."""

    pairs: Sequence[Pair]
    features: Sequence[str]
    """Files with the keypoints of their images."""
    file: str
    """File of the matches, named by the hash of all they depend on."""


class MatchedPair(NamedTuple):
    """The matches of two images."""

    pair: Pair
    indices: IntArray
    """(m, 2) indices of keypoints, as `saccade.match` returns them."""
    similarity: Float32Array
    """(m,) cosine of the angle between the two descriptors, moved from [-1, 1] to [0, 1]."""
    verification: Verification | None
    """None where it was not asked for."""


@dataclass(frozen=True)
class MatchRun:
    """Results of a run."""

    extraction: Extraction
    """Results of the extraction of the features."""
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
    """Paths by name: pairs, table, and features, matches or database."""


def match_images(
    source: str,
    out: str | Path,
    *,
    pairs: str | Path | None = None,
    root: str | None = None,
    job: Job | None = None,
    config: MatchConfig | None = None,
    formats: Sequence[Format] = ("hdf5",),
    cameras: Cameras = None,
    camera_mode: CameraMode | None = None,
    workers: int | None = 1,
    should_stop: Callable[[], bool] = lambda: False,
    on_progress: Callable[[str, int, int, int], None] = lambda stage, done, failed, total: None,
) -> MatchRun:
    """Detects, matches and verifies many images; the same call resumes an interrupted one.

    Args:
        source: images, as for `open_source`.
        out: folder to write.
        pairs: file with two names to a line; "sequential:N" for each image with the next N,
            "gps:N" for each with the N nearest by the GPS positions of EXIF data; None for all.
        root: folder of the images of a list; None for that of the list.
        job: the features, of points; None for SIFT points, of `SiftConfig.mapping` for colmap.
        config: settings of matching and verification; None for the default.
        formats: hdf5 for hloc, colmap for a database.
        cameras: of the database; see `write_colmap`.
        camera_mode: images that share a camera; see `write_colmap`.
        workers: see `extract`; None for as many as cores and memory allow.
        should_stop: see `extract`.
        on_progress: see `extract`; its first argument is "images" or "pairs".

    Raises:
        ImageError: the source does not exist, or holds no image.
        ConfigError: an invalid list of pairs, features of other settings in the folder, or a
            library that is not installed.
        OutputError: a file cannot be written.
    """
    preset = SiftConfig.mapping() if "colmap" in formats else SiftConfig()
    config, job = config or MatchConfig(), job or Job("sift", preset)
    require(len(formats) > 0, "formats", "hdf5 or colmap", formats)
    points = job.what not in (*MAPS, SCANPATH)
    require(points, "job", f"one of {', '.join(DETECTORS)} or a function", job.what)
    if "colmap" in formats:  # to fail before any work is done
        check_cameras(cameras)
    if "hdf5" in formats:
        import_optional("h5py", "hdf5")
    images, wanted = images_and_pairs(source, pairs, root=root, out=str(out))
    if job.file is not None:
        check_stored(Path(job.file), [image.name for image in images])
    workers, out = workers or count_workers(len(images)), Path(out)
    features = str(out / FEATURES)
    extraction = extract(
        images,
        job,
        features,
        workers=workers,
        block_size=IMAGES_PER_BLOCK if len(images) > MIN_BLOCKS * IMAGES_PER_BLOCK else None,
        should_stop=should_stop,
        on_progress=partial(on_progress, "images"),
    )
    if not extraction.complete:
        return MatchRun(extraction, len(wanted), 0, 0, (), False, {})
    with locked(out):
        blocks = plan_pairs(Store(features), wanted, config, job)
        todo = [block for block in blocks if not (out / block.file).exists()]
        total, done = sum(len(block.pairs) for block in todo), 0
        work = partial(match_block, config, features, str(out))
        for block, matched_now in run_blocks(work, todo, workers=workers, should_stop=should_stop):
            if matched_now is None:
                raise OutputError(f"{out / block.file}: {DIED}")
            done += matched_now
            on_progress("pairs", done, 0, total)
        unchanged = sum(len(block.pairs) for block in blocks) - total
        if done < total:
            return MatchRun(extraction, len(wanted), done, unchanged, (), False, {})
        found = {each.pair: each for block in blocks for each in read_matches(out, block, config)}
        matched = [found[pair] for pair in wanted if pair in found]
        local = {item.name: Path(item.location) for item in images if is_local_file(item)}
        files = write_files(out, features, matched, formats, cameras, camera_mode, local)
    return MatchRun(extraction, len(wanted), done, unchanged, matched, True, files)


def plan_pairs(
    features: Store, wanted: Sequence[Pair], config: MatchConfig, job: Job
) -> list[PairBlock]:
    """Blocks of the pairs that are wanted, without images that failed."""
    file_of: dict[str, str] = {}
    content_of: dict[str, str] = {}
    for file in block_files(features, job.folder):
        for record in read_block(features, file)[0]:
            file_of[record.image], content_of[record.image] = file, record.content
    possible = [pair for pair in wanted if file_of.keys() >= {*pair}]
    blocks = []
    for start in range(0, len(possible), PAIRS_PER_BLOCK):
        pairs = possible[start : start + PAIRS_PER_BLOCK]
        names = sorted({name for pair in pairs for name in pair})
        contents = [content_of[name] for name in names]
        text = json.dumps([asdict(config), job.fingerprint, pairs, contents])
        digest = hashlib.blake2b(text.encode(), digest_size=12).hexdigest()
        files = sorted({file_of[name] for name in names})
        blocks.append(PairBlock(pairs, files, f"{FOLDER}/{digest}.npz"))
    return blocks


def match_block(config: MatchConfig, features: str, out: str, block: PairBlock) -> int:
    """Matches the pairs of a block and writes them to a file; runs in any process."""
    store, names = Store(features), {name for pair in block.pairs for name in pair}
    points = {
        image.image: image.points
        for file in block.features
        for image in read_block_points(store, file)
        if image.image in names
    }
    arrays: dict[str, npt.ArrayLike] = {}
    for number, (first, second) in enumerate(block.pairs):
        both = points[first], points[second]
        indices = match(*both, config.ratio, config.mutual, config.metric)
        if config.geometry is not None:
            verified = verify(
                *(*both, indices, config.geometry, config.tolerance, config.min_inliers),
                mirrored=False,
            )
            if config.guided:
                indices, verified = verified_again(
                    *(*both, indices, verified, config.ratio),
                    mutual=config.mutual,
                    metric=config.metric,
                    tolerance=config.tolerance,
                )
            arrays[f"{number} inliers"] = verified.inliers
            for field in STORED:
                if getattr(verified, field) is not None:
                    arrays[f"{number} {field}"] = getattr(verified, field)
        arrays[f"{number} indices"] = indices
        arrays[f"{number} similarity"] = _similarity(*both, indices)
    with atomic_write(Path(out, block.file)) as path:
        save_arrays(path, arrays, compressed=False)
    return len(block.pairs)


def read_matches(out: Path, block: PairBlock, config: MatchConfig) -> list[MatchedPair]:
    """The matches of a block.

    Raises:
        KeypointsError: their file is broken.
    """
    found, path = [], out / block.file
    with reading(path, KeypointsError, "matches; remove it", ValueError, KeyError):
        arrays = read_arrays(path)
        for number, pair in enumerate(block.pairs):
            verified = None
            if config.geometry is not None:
                fields = {field: arrays.get(f"{number} {field}") for field in STORED}
                if fields["model"] is not None:
                    fields["model"] = fields["model"].item()
                inliers, stored = arrays[f"{number} inliers"], cast("dict[str, Any]", fields)
                required = config.min_inliers
                verified = Verification(
                    config.geometry, inliers=inliers, min_inliers=required, **stored
                )
            indices, similarity = arrays[f"{number} indices"], arrays[f"{number} similarity"]
            found.append(MatchedPair(pair, indices, similarity, verified))
    return found


def _similarity(first: Keypoints, second: Keypoints, indices: IntArray) -> Float32Array:
    """(m,) cosine of the angle between matched descriptors, moved from [-1, 1] to [0, 1]."""
    units = []
    for points, rows in zip((first, second), indices.T, strict=True):
        vectors = np.asarray(points.descriptors, np.float32)[rows]
        units.append(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)[:, None])
    similarity: Float32Array = ((1 + np.einsum("ij,ij->i", *units)) / 2).astype(np.float32)
    return similarity


def write_files(
    out: Path,
    features: str,
    matched: Sequence[MatchedPair],
    formats: Sequence[Format],
    cameras: Cameras = None,
    camera_mode: CameraMode | None = None,
    local: Mapping[str, Path] | None = None,
) -> dict[str, Path]:
    """Writes pairs.txt, pairs.csv and the files of the formats; returns them by name."""
    names = {name for each in matched for name in each.pair}
    images = {image.image: image for image in read_points(features) if image.image in names}
    points = {name: image.points for name, image in images.items()}
    shapes = {name: image.shape for name, image in images.items()}
    turned = {name: image.orientation for name, image in images.items()}
    matches = {each.pair: each.indices for each in matched}
    files = {"pairs": out / "pairs.txt", "table": out / "pairs.csv"}
    write_pairs(files["pairs"], list(matches))
    _write_table(files["table"], matched)
    if "hdf5" in formats:
        files |= {"features": out / "features.h5", "matches": out / "matches.h5"}
        write_hdf5(files["features"], points, shapes, turned)
        counts = {name: len(each) for name, each in points.items()}
        similarities = {each.pair: each.similarity for each in matched}
        write_hloc_matches(files["matches"], matches, counts, similarities)
    if "colmap" in formats:
        files["database"] = out / "database.db"
        verified = {each.pair: each.verification for each in matched}
        geometries = {pair: each for pair, each in verified.items() if each is not None}
        write_colmap(
            *(files["database"], points, shapes, matches, geometries, turned, cameras),
            camera_mode=camera_mode,
            files=local,
        )
    return files


def _write_table(path: Path, matched: Sequence[MatchedPair]) -> None:
    """Writes the numbers of matches and inliers and the model of each pair."""
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["first", "second", "matches", "inliers", "model"])
        for each in matched:
            verified = each.verification
            inliers = "" if verified is None else int(verified.inliers.sum())
            model = "" if verified is None else verified.model or ""
            writer.writerow([*each.pair, len(each.indices), inliers, model])
