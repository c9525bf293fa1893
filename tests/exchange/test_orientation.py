"""Photographs with an EXIF orientation, in the stored pixels that COLMAP and hloc read."""

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow

import saccade
from saccade import exchange
from saccade.errors import ConfigError, KeypointsError
from saccade.exchange.colmap import import_pycolmap
from support.keypoint_files import HALLWAY, random_points

SIFT = saccade.SiftConfig(max_keypoints=300)


@pytest.fixture(params=range(1, 9))
def photo(request, tmp_path):
    """A photograph with each EXIF orientation, as a file that loses nothing."""
    pixels = cv2.imread(HALLWAY[0], cv2.IMREAD_GRAYSCALE)[:200, :300]
    exif = Pillow.Exif()
    exif[0x0112] = request.param
    Pillow.fromarray(pixels).save(tmp_path / "photo.png", exif=exif)
    return tmp_path / "photo.png", pixels


def test_exported_points_are_those_of_the_stored_pixels(photo, tmp_path):
    path, pixels = photo
    turned = {"photo.png": exchange.read_orientation(path)}
    image = saccade.read_image(path)
    points, shapes = {"photo.png": saccade.Sift(SIFT)(image)}, {"photo.png": image.shape}
    exchange.write_hdf5(tmp_path / "a.h5", points, shapes, turned)
    found = exchange.read_hdf5(tmp_path / "a.h5")["photo.png"]
    stored = saccade.Sift(SIFT)(pixels)
    offset = np.hypot(*(found.xy[:, None] - stored.xy[None]).transpose(2, 0, 1))
    nearest = offset.argmin(axis=1)
    here = np.abs(np.exp(1j * found.angle) - np.exp(1j * stored.angle[nearest])) < 0.05
    assert np.median(offset.min(axis=1)) < 0.01
    assert here.mean() > 0.7  # others have several angles at one position
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5") as file:
        assert tuple(file["photo.png/image_size"]) == pixels.shape[::-1]


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_sizes_are_those_that_colmap_reads(suffix, tmp_path):
    try:
        pycolmap = import_pycolmap()
    except ConfigError as error:
        pytest.skip(str(error))
    exif, path = Pillow.Exif(), tmp_path / f"photo{suffix}"
    exif[0x0112] = 6
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:10, :10] = 255
    Pillow.fromarray(pixels).save(path, exif=exif)
    theirs = pycolmap.Bitmap.read(path, True)
    image = saccade.read_image(path)
    assert image.shape == (60, 40, 3)
    assert image[5, 35].min() > 0.9
    points, turned = random_points(np.random.default_rng(0), 5), exchange.read_orientation(path)
    exchange.write_colmap(
        tmp_path / "a.db", {"a": points}, {"a": image.shape}, orientations={"a": turned}
    )
    found = exchange.read_colmap(tmp_path / "a.db")
    assert found.shapes["a"] == (theirs.height, theirs.width) == (40, 60)


def test_the_geometry_of_turned_images_holds_for_the_stored_points(tmp_path):
    """Stored points of one image of each pair fulfil the exported fundamental matrix."""
    try:
        pycolmap = import_pycolmap()
    except ConfigError as error:
        pytest.skip(str(error))
    images = [saccade.read_image(path) for path in HALLWAY]
    names, points = ("a", "b"), [saccade.Sift()(image) for image in images]
    pairs = saccade.match(*points)
    checked = saccade.verify(*points, pairs)
    turned = {"a": 6, "b": 8}
    exchange.write_colmap(
        tmp_path / "a.db",
        dict(zip(names, points, strict=True)),
        dict(zip(names, (image.shape for image in images), strict=True)),
        {names: pairs},
        {names: checked},
        turned,
    )
    database = pycolmap.Database.open(tmp_path / "a.db")
    fundamental = database.read_two_view_geometry(1, 2).F
    first, second = (database.read_keypoints(number)[:, :2] for number in (1, 2))
    database.close()
    inliers = pairs[checked.inliers]
    lines = np.c_[first[inliers[:, 0]], np.ones(len(inliers))] @ fundamental.T
    ends = np.c_[second[inliers[:, 1]], np.ones(len(inliers))]
    distance = np.abs((lines * ends).sum(1)) / np.hypot(lines[:, 0], lines[:, 1])
    assert np.median(distance) < 1


def test_a_turned_image_without_a_shape_is_named(tmp_path):
    points = random_points(np.random.default_rng(0), 3)
    with pytest.raises(KeypointsError, match="a: expected a shape"):
        exchange.write_hdf5(tmp_path / "a.h5", {"a": points}, orientations={"a": 6})
