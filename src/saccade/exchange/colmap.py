"""COLMAP's database: keypoints, descriptors and matches of many images.

COLMAP centers the first pixel at (0.5, 0.5), `Keypoints` at (0, 0). COLMAP's scale is half of
`size`; angles and the order of descriptor entries are equal.
"""

import sqlite3
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from importlib import import_module
from itertools import chain, combinations, groupby
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError, OutputError, require
from saccade.exchange.colmap_cameras import (
    PIXEL_CENTER,
    Cameras,
    ColmapCamera,
    camera_of_row,
)
from saccade.exchange.orientation import (
    orientation_of,
    stored_keypoints,
    stored_shape,
    to_stored,
)
from saccade.extras import import_optional
from saccade.io.files import atomic_write, check_file, reading
from saccade.io.keypoint_fields import check_name, checked, keypoints_from
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints, check_pairs

CENTERED = np.array([[1, 0, PIXEL_CENTER], [0, 1, PIXEL_CENTER], [0, 0, 1]])
"""Homogeneous transform from our pixel coordinates to COLMAP's."""
TABLES = ("images", "cameras", "keypoints", "descriptors", "matches")
PAIR_ID_FACTOR = 2147483647
"""Factor with which COLMAP combines two image ids into a pair id."""
CameraMode: TypeAlias = Literal["auto", "folder", "single", "image"]
"""Images that share a camera: COLMAP's choice by EXIF data, those of a folder, all, or none."""
CAMERA_MODES = {"auto": "AUTO", "folder": "PER_FOLDER", "single": "SINGLE", "image": "PER_IMAGE"}
"""COLMAP's names of the modes."""
CONFIGURATIONS = {
    "planar": "PLANAR",
    "panoramic": "PANORAMIC",
    "still": "PANORAMIC",
    "watermark": "WATERMARK",
}
"""COLMAP's configurations of the models of two views that are not general."""


@dataclass(frozen=True, eq=False, repr=False)
class ColmapFeatures:
    """Interest points and matches of a COLMAP database."""

    keypoints: Mapping[str, Keypoints]
    """Points by image name. COLMAP stores no response and no octave; both are 0."""
    matches: Mapping[tuple[str, str], IntArray]
    """Matches by pair of image names: (m, 2) indices into their points."""
    shapes: Mapping[str, tuple[int, int]]
    """(H, W) of every image."""
    cameras: Mapping[str, ColmapCamera]
    """Camera of every image; equal ones are one object."""

    def __repr__(self) -> str:
        return f"ColmapFeatures({len(self.keypoints)} images, {len(self.matches)} matched pairs)"


def check_cameras(cameras: Cameras) -> None:
    """Raises `ConfigError` if a camera model is unknown to COLMAP, or pycolmap is missing."""
    pycolmap = import_pycolmap()
    models = pycolmap.CameraModelId.__members__
    known = [name for name in models if name != "INVALID"]
    for each in {cameras} if isinstance(cameras, ColmapCamera) else {*(cameras or {}).values()}:
        require(each.model in known, "camera", f"one of {', '.join(known)}", each.model)
        if each.params:
            camera = pycolmap.Camera.create_from_model_id(0, models[each.model], 1, 1, 1)
            valid = len(each.params) == len(camera.params)
            require(valid, "camera", f"{each.model},{camera.params_info}", each.params)


class TwoViews(Protocol):
    """Interface of `saccade.Verification`: a two-view geometry and its inliers."""

    @property
    def geometry(self) -> str:
        """Kind of geometry: fundamental or homography."""

    @property
    def matrix(self) -> FloatArray | None:
        """(3, 3), or None."""

    @property
    def inliers(self) -> BoolArray:
        """(m,) True for inliers."""

    @property
    def model(self) -> str | None:
        """Model that the matches support: general, or one of `CONFIGURATIONS`; None if unknown."""

    @property
    def homography(self) -> FloatArray | None:
        """(3, 3) homography of a model that is not general."""


def write_colmap(
    path: str | Path,
    keypoints: Mapping[str, Keypoints],
    shapes: Mapping[str, tuple[int, ...]],
    matches: Mapping[tuple[str, str], IntArray] | None = None,
    geometries: Mapping[tuple[str, str], TwoViews] | None = None,
    orientations: Mapping[str, int] | None = None,
    cameras: Cameras = None,
    *,
    camera_mode: CameraMode | None = None,
    files: Mapping[str, Path] | None = None,
) -> None:
    """Writes a new database with the installed version of pycolmap.

    COLMAP itself imports the images, with its cameras and GPS positions. A shared or known camera
    is a better start for its mapper. Without `geometries`, verify the matches
    (`pycolmap.geometric_verification`) before mapping.

    Args:
        path: the file, written atomically; an existing file is replaced.
        keypoints: keypoints by image name, which is a path relative to COLMAP's image folder.
        shapes: (H, W, ...) of each image.
        matches: (m, 2) indices into the points of two images, by image names.
        geometries: results of `saccade.verify` for the matches, by image names.
        orientations: EXIF orientations of the files (`saccade.exchange.read_orientation`), which
            COLMAP ignores: keypoints, sizes and geometries are written in stored pixels.
        cameras: a camera for all images, or a camera per image, of which equal ones are one; None
            for COLMAP's default.
        camera_mode: images that share a camera; None for "single" with the parameters of a camera
            for all images, else "auto".
        files: files of the images by name, from which COLMAP reads EXIF data; others have none.

    Raises:
        KeypointsError: an image without a shape, matches of unknown images or points,
            geometries without their matches, inconsistent fields, or images of different sizes
            that are to share a camera.
        ConfigError: pycolmap is not installed, or it does not support a camera model.
        OutputError: the file cannot be written.
    """
    pycolmap = import_pycolmap()
    matches, geometries = matches or {}, geometries or {}
    for name in keypoints:
        if name not in shapes:
            raise KeypointsError(f"{name}: expected a shape for this image, found none")
    for pair, indices in matches.items():
        _check_pair(pair, indices, keypoints)
        if pair in geometries and len(geometries[pair].inliers) != len(indices):
            found = f"{len(indices)} and {len(geometries[pair].inliers)}"
            raise KeypointsError(f"geometry of {' and '.join(pair)}: expected all matches: {found}")
        if pair[::-1] in matches:
            raise KeypointsError(
                f"matches of {' and '.join(pair)}: expected one order of the pair, found both"
            )
    check_cameras(cameras)
    sizes = {
        check_name(name): stored_shape(shapes[name], orientation_of(name, orientations))
        for name in keypoints
    }
    shared = isinstance(cameras, ColmapCamera) and len(cameras.params) > 0
    mode = camera_mode or ("single" if shared else "auto")
    with atomic_write(path) as temporary, ExitStack() as stack:
        with _open_new(pycolmap, temporary, path):
            pass
        _import_images(pycolmap, temporary, sizes, files or {}, cameras, mode)
        database = stack.enter_context(_open_new(pycolmap, temporary, path))
        ids = {image.name: image.image_id for image in database.read_all_images()}
        for name, size in sizes.items():
            if name not in ids:
                raise KeypointsError(
                    f"{name}: COLMAP did not import it; expected the size of its camera, found "
                    f"{size[1]} x {size[0]}, with --camera-mode {mode}"
                )
        moved = dict[str, FloatArray]()
        for name, points in keypoints.items():
            turned = (shapes[name], orientation_of(name, orientations))
            stored = stored_keypoints(checked(name, points), *turned)
            _add_points(pycolmap, database, ids[name], stored)
            moved[name] = CENTERED @ to_stored(*turned)
        for (first, second), indices in matches.items():
            database.write_matches(ids[first], ids[second], indices.astype(np.uint32))
            if (first, second) in geometries:
                maps = moved[first], moved[second]
                views = _two_views(pycolmap, geometries[first, second], indices, maps)
                database.write_two_view_geometry(ids[first], ids[second], views)


def read_colmap(path: str | Path, names: Collection[str] | None = None) -> ColmapFeatures:
    """Reads a database of any version, without pycolmap; it is opened read-only.

    Positions and shapes refer to the stored pixels, independent of EXIF orientations.

    Args:
        path: the database.
        names: images whose keypoints and matches are read; None for all. Shapes and cameras are
            those of all images.

    Raises:
        KeypointsError: the file is missing, has another format, or its descriptors are not bytes.
    """
    path = Path(path)
    uri = f"{path.resolve().as_uri()}?mode=ro"
    broken = (sqlite3.Error, TypeError, ValueError)
    with reading(path, KeypointsError, "a COLMAP database", *broken), ExitStack() as stack:
        check_file(path)
        database = stack.enter_context(closing(sqlite3.connect(uri, uri=True)))
        _check_tables(database)
        shape_of, cameras = {}, {}
        query = "SELECT camera_id, height, width, model, params FROM cameras"
        for camera_id, height, width, model, params in database.execute(query):
            shape_of[camera_id] = height, width
            cameras[camera_id] = camera_of_row(model, (width, height), params)
        images = {
            image_id: (name, camera_id)
            for image_id, name, camera_id in database.execute(
                "SELECT image_id, name, camera_id FROM images ORDER BY image_id"
            )
            if camera_id in cameras
        }
        one, two = (None, None) if names is None else _keys_of(images, names)
        rows = _blobs(database, "keypoints", "image_id", np.float32, one)
        descriptors = _blobs(database, "descriptors", "image_id", np.uint8, one)
        pairs = _blobs(database, "matches", "pair_id", np.uint32, two)
    keypoints = {
        name: _points(f"{path}: {name}", rows[image_id], descriptors.get(image_id))
        for image_id, (name, _) in images.items()
        if image_id in rows
    }
    matches = {}
    for pair_id, indices in pairs.items():
        ids = divmod(pair_id, PAIR_ID_FACTOR)
        if all(image_id in images and image_id in rows for image_id in ids):
            first, second = (images[image_id][0] for image_id in ids)
            matches[first, second] = indices.astype(np.int64)
    shapes = {name: shape_of[camera_id] for name, camera_id in images.values()}
    named = {name: cameras[camera_id] for name, camera_id in images.values()}
    return ColmapFeatures(keypoints, matches, shapes, named)


def import_pycolmap() -> Any:
    """Import pycolmap, with its log limited to warnings.

    Raises:
        ConfigError: it is not installed.
    """
    import_module("zlib")  # Python's zlib must precede the copy in pycolmap's wheel
    pycolmap = import_optional("pycolmap", "colmap")
    pycolmap.logging.minloglevel = pycolmap.logging.WARNING.value
    return pycolmap


@contextmanager
def _open_new(pycolmap: Any, temporary: Path, path: str | Path) -> Iterator[Any]:
    """A new database; errors name its final `path`."""
    database = None
    try:
        database = pycolmap.Database.open(temporary)
        yield database
    except RuntimeError as error:
        raise OutputError(f"{path}: cannot be written: {error}") from error
    finally:
        if database is not None:
            database.close()


def _check_pair(
    pair: tuple[str, str], indices: IntArray, keypoints: Mapping[str, Keypoints]
) -> None:
    name = " and ".join(pair)
    for image in pair:
        if image not in keypoints:
            raise KeypointsError(f"matches of {name}: expected keypoints of {image}, found none")
    if pair[0] == pair[1]:
        raise KeypointsError(f"matches of {name}: expected two images, found one")
    check_pairs(indices, (len(keypoints[pair[0]]), len(keypoints[pair[1]])), f"matches of {name}")


@contextmanager
def _image_folder(
    sizes: Mapping[str, tuple[int, int]], files: Mapping[str, Path]
) -> Iterator[Path]:
    """A folder with links to the files of images, and black images of the size of the others."""
    import cv2  # slow to import

    with tempfile.TemporaryDirectory(prefix="saccade-") as folder:
        for name, (height, width) in sizes.items():
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            if name in files:
                path.symlink_to(files[name].absolute())
            else:
                black = np.zeros((height, width), np.uint8)
                _, data = cv2.imencode(".png", black, [cv2.IMWRITE_PNG_BILEVEL, 1])
                path.write_bytes(data.tobytes())
        yield Path(folder)


def _import_images(
    pycolmap: Any,
    database: Path,
    sizes: Mapping[str, tuple[int, int]],
    files: Mapping[str, Path],
    cameras: Cameras,
    mode: CameraMode,
) -> None:
    """Lets COLMAP import images in the order of their names, those of one camera in a row at once.

    Raises:
        KeypointsError: an image without a camera, or of another size than its camera.
    """
    chosen = pycolmap.CameraMode.__members__[CAMERA_MODES[mode]]
    ids: dict[ColmapCamera | None, int] = {}
    listed = isinstance(cameras, Mapping)

    def camera_of(name: str) -> ColmapCamera | None:
        camera = cameras.get(name) if isinstance(cameras, Mapping) else cameras
        if camera is None and cameras is not None:
            raise KeypointsError(f"{name}: expected a camera for this image, found none")
        height, width = sizes[name]
        if camera is not None and camera.size not in (None, (width, height)):
            raise KeypointsError(
                f"{name}: expected the size of its camera {camera.size}, found {width} x {height}"
            )
        return camera

    level = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value  # an image left out is named here
    try:
        with _image_folder(sizes, files) as folder:
            for camera, group in groupby(sorted(sizes), camera_of):
                names, options = list(group), pycolmap.ImageReaderOptions()
                if camera is not None:
                    options.camera_model = camera.model
                    options.camera_params = ",".join(map(repr, camera.params))
                    options.existing_camera_id = ids.get(camera, -1)
                shares = listed and camera is not None
                sharing = pycolmap.CameraMode.SINGLE if shares else chosen
                pycolmap.import_images(database, folder, sharing, names, options)
                if shares and camera not in ids:
                    with closing(pycolmap.Database.open(database)) as opened:
                        ids[camera] = max(each.camera_id for each in opened.read_all_cameras())
    finally:
        pycolmap.logging.minloglevel = level


def _two_views(
    pycolmap: Any, geometry: TwoViews, indices: IntArray, maps: tuple[FloatArray, FloatArray]
) -> Any:
    """A verified pair in COLMAP's pixels; `maps` are (3, 3) transforms from the images' pixels."""
    kinds = pycolmap.TwoViewGeometryConfiguration
    views = pycolmap.TwoViewGeometry()
    views.inlier_matches = indices[geometry.inliers].astype(np.uint32)
    if geometry.matrix is None:
        views.config = kinds.DEGENERATE
        return views
    back_first, back_second = np.linalg.inv(maps)
    homography = geometry.matrix if geometry.geometry == "homography" else geometry.homography
    if homography is not None:
        views.config, views.H = kinds.PLANAR_OR_PANORAMIC, maps[1] @ homography @ back_first
    if geometry.geometry == "fundamental":
        views.config, views.F = kinds.UNCALIBRATED, back_second.T @ geometry.matrix @ back_first
    if geometry.model in CONFIGURATIONS:
        views.config = kinds.__members__[CONFIGURATIONS[geometry.model]]
    return views


def _add_points(pycolmap: Any, database: Any, image_id: int, points: Keypoints) -> None:
    rows = np.c_[points.xy + PIXEL_CENTER, points.size / 2, points.angle]
    database.write_keypoints(image_id, rows.astype(np.float32))
    if points.descriptors is not None and points.descriptors.dtype == np.uint8:
        sift = pycolmap.FeatureExtractorType.SIFT
        descriptors = pycolmap.FeatureDescriptors(sift, points.descriptors)
        database.write_descriptors(image_id, descriptors)


def _check_tables(database: sqlite3.Connection) -> None:
    """Reject views instead of tables, since a query of a view may never end."""
    for name, kind in database.execute("SELECT name, type FROM sqlite_master"):
        if str(name).lower() in TABLES and kind != "table":
            raise sqlite3.DataError(f"expected the table {name}, found a {kind}")


def _blobs(
    database: sqlite3.Connection,
    table: str,
    key: str,
    dtype: type[np.generic],
    chosen: Sequence[int] | None,
) -> dict[int, npt.NDArray[Any]]:
    """The (rows, cols) arrays of a table by key; those of chosen keys, or all."""
    query = f"SELECT {key}, rows, cols, data FROM {table}"
    if chosen is None:
        cursor: Iterable[Any] = database.execute(f"{query} ORDER BY {key}")
    else:
        one = f"{query} WHERE {key} = ?"
        cursor = chain.from_iterable(database.execute(one, (each,)) for each in chosen)
    little = np.dtype(dtype).newbyteorder("<")
    arrays = {}
    for identity, rows, columns, data in cursor:
        if not all(isinstance(each, int) for each in (identity, rows, columns)) or rows < 0:
            raise sqlite3.DataError(f"{table} of {identity}: {rows} x {columns}")
        if len(data or b"") != rows * columns * little.itemsize:
            raise sqlite3.DataError(
                f"{table} of {identity}: {rows} x {columns} {np.dtype(dtype)} in {len(data)} bytes"
            )
        arrays[identity] = np.frombuffer(data or b"", little).reshape(rows, columns)
    return arrays


def _keys_of(
    images: Mapping[int, tuple[str, int]], names: Collection[str]
) -> tuple[list[int], list[int]]:
    """The keys of images by their names, and of their pairs."""
    wanted = {*names}
    ids = sorted(image_id for image_id, (name, _) in images.items() if name in wanted)
    return ids, [first * PAIR_ID_FACTOR + second for first, second in combinations(ids, 2)]


def _points(source: str, rows: npt.NDArray[Any], descriptors: npt.NDArray[Any] | None) -> Keypoints:
    """Points from rows of x and y; of x, y, scale and angle; or of x, y and an affine shape."""
    size, angle = None, None
    if rows.shape[1] == 4:
        size, angle = 2 * rows[:, 2], rows[:, 3]
    elif rows.shape[1] == 6:
        shape: FloatArray = rows[:, 2:].reshape(-1, 2, 2).astype(np.float64)
        size = np.hypot(shape[:, 0], shape[:, 1]).sum(axis=1)  # twice the mean of the axes
        angle = np.arctan2(shape[:, 1, 0], shape[:, 0, 0])
    if descriptors is not None and not descriptors.shape[1]:
        descriptors = None
    return keypoints_from(source, rows[:, :2] - PIXEL_CENTER, descriptors, size=size, angle=angle)
