"""COLMAP's database: keypoints, descriptors and matches of many images.

COLMAP centers the first pixel at (0.5, 0.5), `Keypoints` at (0, 0). COLMAP's scale is half of
`size`; angles and the order of descriptor entries are equal.
"""

import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ConfigError, KeypointsError, OutputError, require
from saccade.exchange.orientation import (
    orientation_of,
    stored_keypoints,
    stored_shape,
    to_stored,
)
from saccade.extras import import_optional
from saccade.io.files import atomic_write, check_file, read_text, reading
from saccade.io.keypoint_fields import check_name, checked, keypoints_from
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints, check_pairs

PIXEL_CENTER = np.float32(0.5)
"""Center of the first pixel in COLMAP."""
CENTERED = np.array([[1, 0, PIXEL_CENTER], [0, 1, PIXEL_CENTER], [0, 0, 1]])
"""Homogeneous transform from our pixel coordinates to COLMAP's."""
TABLES = ("images", "cameras", "keypoints", "descriptors", "matches")
MAX_IMAGES = 2147483647
"""Factor with which COLMAP combines two image ids into a pair id."""
FOCAL_LENGTH = 1.2
"""COLMAP's default focal length, as a multiple of the longer side of the image."""


@dataclass(frozen=True, eq=False, repr=False)
class ColmapFeatures:
    """Interest points and matches of a COLMAP database."""

    keypoints: Mapping[str, Keypoints]
    """Points by image name. COLMAP stores no response and no octave; both are 0."""
    matches: Mapping[tuple[str, str], IntArray]
    """Matches by pair of image names: (m, 2) indices into their points."""
    shapes: Mapping[str, tuple[int, int]]
    """(H, W) of every image."""

    def __repr__(self) -> str:
        return f"ColmapFeatures({len(self.keypoints)} images, {len(self.matches)} matched pairs)"


class ColmapCamera(NamedTuple):
    """A COLMAP camera, in pixels with the first centered at (0.5, 0.5)."""

    model: str
    """Camera model, such as PINHOLE."""
    params: tuple[float, ...] = ()
    """Parameters, such as fx, fy, cx, cy; guessed if empty."""
    size: tuple[int, int] | None = None
    """Width and height of the images; None for any size."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parses MODEL or MODEL,PARAMETER,...; raises `ConfigError`."""
        model, *words = text.split(",")
        return cls(model.strip().upper(), _numbers("camera", "MODEL,fx,fy,cx,cy or alike", words))


Cameras: TypeAlias = ColmapCamera | Mapping[str, ColmapCamera] | None
"""A camera for all images, a camera per image, or None for a guessed camera per image."""


def read_cameras(path: Path) -> dict[str, ColmapCamera]:
    """Reads the cameras of images from a list in hloc's form.

    Each line has NAME MODEL WIDTH HEIGHT PARAMETER ...

    Raises:
        ConfigError: the list cannot be read, or a line is malformed.
    """
    with reading(path, ConfigError):
        lines = read_text(path).splitlines()
    cameras = {}
    for number, line in enumerate(lines, 1):
        name, *words = line.split() or ["#"]
        if not name.startswith("#"):
            where, expected = f"{path}, line {number}", "NAME MODEL WIDTH HEIGHT PARAMETER ..."
            require(len(words) > 2, where, expected, line[:80])
            width, height, *values = _numbers(where, expected, words[1:])
            size = int(width), int(height)
            cameras[name] = ColmapCamera(words[0].upper(), tuple(values), size)
    return cameras


def _numbers(name: str, expected: str, words: Sequence[str]) -> tuple[float, ...]:
    try:
        values = tuple(map(float, words))
    except ValueError:
        values = (np.nan,)
    require(bool(np.isfinite(values).all()), name, expected, " ".join(words)[:80])
    return values


def parse_cameras(text: str | None) -> Cameras:
    """Parses --camera: a camera for all images, or a file for `read_cameras`.

    Raises:
        ConfigError: the text is neither.
    """
    if text is None:
        return None
    return read_cameras(Path(text)) if Path(text).is_file() else ColmapCamera.parse(text)


def check_cameras(cameras: Cameras) -> None:
    """Raises `ConfigError` if a camera model is unknown to COLMAP, or pycolmap is missing."""
    pycolmap = import_pycolmap()
    for each in [cameras] if isinstance(cameras, ColmapCamera) else (cameras or {}).values():
        make_camera(pycolmap, each, 1, 1)


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


def write_colmap(
    path: str | Path,
    keypoints: Mapping[str, Keypoints],
    shapes: Mapping[str, tuple[int, ...]],
    matches: Mapping[tuple[str, str], IntArray] | None = None,
    geometries: Mapping[tuple[str, str], TwoViews] | None = None,
    orientations: Mapping[str, int] | None = None,
    cameras: Cameras = None,
) -> None:
    """Writes a new database with the installed version of pycolmap.

    Without `cameras` every image gets its own SIMPLE_RADIAL camera with a guessed focal length. A
    shared or known camera is a better start for COLMAP's mapper. Without `geometries`, verify the
    matches (`pycolmap.geometric_verification`) before mapping.

    Args:
        path: the file, written atomically; an existing file is replaced.
        keypoints: keypoints by image name, which is a path relative to COLMAP's image folder.
        shapes: (H, W, ...) of each image.
        matches: (m, 2) indices into the points of two images, by image names.
        geometries: results of `saccade.verify` for the matches, by image names.
        orientations: EXIF orientations of the files (`saccade.exchange.read_orientation`), which
            COLMAP ignores: keypoints, sizes and geometries are written in stored pixels.
        cameras: a camera for all images, or a camera per image.

    Raises:
        KeypointsError: an image without a shape, matches of unknown images or points,
            geometries without their matches, or inconsistent fields.
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
    with atomic_write(path) as temporary, _open_new(pycolmap, temporary, path) as database:
        ids, moved = dict[str, int](), dict[str, FloatArray]()
        rigs: dict[str, tuple[Any, int]] = {}
        for name, points in keypoints.items():
            turned = (shapes[name], orientation_of(name, orientations))
            shared = "" if isinstance(cameras, ColmapCamera) else name
            camera = _camera(pycolmap, name, cameras, stored_shape(*turned))
            if shared not in rigs:
                rigs[shared] = _add_camera(pycolmap, database, camera)
            found = f"{camera.width} x {camera.height}"
            size = f"{rigs[shared][0].width} x {rigs[shared][0].height}"
            if found != size:
                raise KeypointsError(
                    f"{name}: expected the size {size} of the camera, found {found}"
                )
            ids[name] = _add_image(pycolmap, database, check_name(name), *rigs[shared])
            stored = stored_keypoints(checked(name, points), *turned)
            _add_points(pycolmap, database, ids[name], stored)
            moved[name] = CENTERED @ to_stored(*turned)
        for (first, second), indices in matches.items():
            database.write_matches(ids[first], ids[second], indices.astype(np.uint32))
            if (first, second) in geometries:
                maps = moved[first], moved[second]
                views = _two_views(pycolmap, geometries[first, second], indices, maps)
                database.write_two_view_geometry(ids[first], ids[second], views)


def read_colmap(path: str | Path) -> ColmapFeatures:
    """Reads a database of any version, without pycolmap; it is opened read-only.

    Positions and shapes refer to the stored pixels, independent of EXIF orientations.

    Raises:
        KeypointsError: the file is missing, has another format, or its descriptors are not bytes.
    """
    path = Path(path)
    uri = f"{path.resolve().as_uri()}?mode=ro"
    with reading(path, KeypointsError, "a COLMAP database", sqlite3.Error), ExitStack() as stack:
        check_file(path)
        database = stack.enter_context(closing(sqlite3.connect(uri, uri=True)))
        _check_tables(database)
        images = {
            image_id: (name, (height, width))
            for image_id, name, height, width in database.execute(
                "SELECT image_id, name, height, width FROM images JOIN cameras USING (camera_id) "
                "ORDER BY image_id"
            )
        }
        rows = _blobs(database, "keypoints", "image_id", np.float32)
        descriptors = _blobs(database, "descriptors", "image_id", np.uint8)
        pairs = _blobs(database, "matches", "pair_id", np.uint32)
    keypoints = {
        name: _points(f"{path}: {name}", rows[image_id], descriptors.get(image_id))
        for image_id, (name, _) in images.items()
        if image_id in rows
    }
    matches = {}
    for pair_id, indices in pairs.items():
        ids = divmod(pair_id, MAX_IMAGES)
        if all(image_id in images and image_id in rows for image_id in ids):
            first, second = (images[image_id][0] for image_id in ids)
            matches[first, second] = indices.astype(np.int64)
    return ColmapFeatures(keypoints, matches, dict(images.values()))


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


def _camera(pycolmap: Any, name: str, cameras: Cameras, shape: tuple[int, int]) -> Any:
    """The camera of an image of stored pixels (H, W)."""
    chosen: ColmapCamera | None = ColmapCamera("SIMPLE_RADIAL")
    if cameras is not None:
        chosen = cameras if isinstance(cameras, ColmapCamera) else cameras.get(name)
    if chosen is None:
        raise KeypointsError(f"{name}: expected a camera for this image, found none")
    height, width = shape
    if chosen.size not in (None, (width, height)):
        found = f"{width} x {height}"
        raise KeypointsError(
            f"{name}: expected the size of its camera {chosen.size}, found {found}"
        )
    return make_camera(pycolmap, chosen, width, height)


def make_camera(pycolmap: Any, chosen: ColmapCamera, width: int, height: int) -> Any:
    """COLMAP's camera; raises `ConfigError` for an unknown model or wrong parameters."""
    models = pycolmap.CameraModelId.__members__
    known = [name for name in models if name != "INVALID"]
    require(chosen.model in known, "camera", f"one of {', '.join(known)}", chosen.model)
    focal_length = FOCAL_LENGTH * max(width, height)
    model = models[chosen.model]
    camera = pycolmap.Camera.create_from_model_id(0, model, focal_length, width, height)
    if chosen.params:
        valid = len(chosen.params) == len(camera.params)
        require(valid, "camera", f"{chosen.model},{camera.params_info}", chosen.params)
        camera.params, camera.has_prior_focal_length = chosen.params, True
    return camera


def _add_camera(pycolmap: Any, database: Any, camera: Any) -> tuple[Any, int]:
    """Add a camera with its rig; return the camera and the id of the rig."""
    camera.camera_id = database.write_camera(camera)
    rig = pycolmap.Rig()
    rig.add_ref_sensor(camera.sensor_id)
    return camera, int(database.write_rig(rig))


def _add_image(pycolmap: Any, database: Any, name: str, camera: Any, rig: int) -> int:
    """Add an image with its frame; return its id."""
    image = pycolmap.Image(name=name, camera_id=camera.camera_id)
    image.image_id = database.write_image(image)
    frame = pycolmap.Frame()
    frame.rig_id = rig
    frame.add_data_id(image.data_id)
    database.write_frame(frame)
    return int(image.image_id)


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
    if geometry.geometry == "homography":
        views.config, views.H = kinds.PLANAR_OR_PANORAMIC, maps[1] @ geometry.matrix @ back_first
    else:
        views.config, views.F = kinds.UNCALIBRATED, back_second.T @ geometry.matrix @ back_first
    return views


def _add_points(pycolmap: Any, database: Any, image_id: int, points: Keypoints) -> None:
    rows = np.c_[points.xy + PIXEL_CENTER, points.size / 2, points.angle]
    database.write_keypoints(image_id, rows.astype(np.float32))
    if points.descriptors is not None:
        sift = pycolmap.FeatureExtractorType.SIFT
        descriptors = pycolmap.FeatureDescriptors(sift, points.descriptors)
        database.write_descriptors(image_id, descriptors)


def _check_tables(database: sqlite3.Connection) -> None:
    """Reject views instead of tables, since a query of a view may never end."""
    for name, kind in database.execute("SELECT name, type FROM sqlite_master"):
        if str(name).lower() in TABLES and kind != "table":
            raise sqlite3.DataError(f"expected the table {name}, found a {kind}")


def _blobs(
    database: sqlite3.Connection, table: str, key: str, dtype: type[np.generic]
) -> dict[int, npt.NDArray[Any]]:
    """The (rows, cols) arrays of a table by key."""
    cursor = database.execute(f"SELECT {key}, rows, cols, data FROM {table} ORDER BY {key}")
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
