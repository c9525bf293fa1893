"""Points go out to the formats of others and come back."""

import dataclasses

import cv2
import h5py
import numpy as np
import pandas
import pytest

import saccade
from saccade import exchange
from saccade.errors import KeypointsError
from saccade.types import Keypoints
from support.keypoint_files import FIELDS, HALLWAY, assert_same, random_points


def written(kind, path, points, name="photo.jpg"):
    """The points of one image after a way there and back."""
    write, read = (getattr(exchange, f"{verb}_{kind}") for verb in ("write", "read"))
    if kind == "npz":
        write(path, points)
        return read(path)
    write(path, {name: points})
    (found,) = read(path).items()
    assert found[0] == name
    return found[1]


@pytest.mark.parametrize("kind", ["npz", "hdf5"])
@pytest.mark.parametrize("count", [0, 1, 40])
@pytest.mark.parametrize("described", [True, False])
def test_points_come_back_as_they_were(rng, tmp_path, kind, count, described):
    points = random_points(rng, count, described)
    found = written(kind, tmp_path / "points", points)
    assert_same(found, points, FIELDS[:-1] if count == 0 else FIELDS)
    assert [path.name for path in tmp_path.iterdir()] == ["points"]


def test_many_images_keep_their_names(rng, tmp_path):
    images = {
        "b/photo.jpg": random_points(rng, 5),
        "a/photo.jpg": random_points(rng, 3),
        "a/deep/photo.jpg": random_points(rng, 0),
        "äöü photo.png": random_points(rng, 2, described=False),
    }
    exchange.write_hdf5(tmp_path / "points.h5", images)
    found = exchange.read_hdf5(tmp_path / "points.h5")
    exchange.write_hdf5(tmp_path / "none", {})
    assert exchange.read_hdf5(tmp_path / "none") == {}
    assert found.keys() == images.keys()
    for name, points in images.items():
        assert_same(found[name], points, FIELDS[: 6 if len(points) else 5])


def test_a_table_has_every_digit(rng, tmp_path):
    points = random_points(rng, 40)
    exchange.write_csv(tmp_path / "a.csv", points)
    table = pandas.read_csv(tmp_path / "a.csv")
    np.testing.assert_array_equal(table[["x", "y"]].to_numpy(np.float32), points.xy)
    for name in ("size", "angle", "response", "octave"):
        np.testing.assert_array_equal(table[name].astype(np.float32), getattr(points, name))


@pytest.fixture(scope="module")
def detected():
    gray = cv2.imread(HALLWAY[0], cv2.IMREAD_GRAYSCALE)
    return gray, saccade.Sift(saccade.SiftConfig.opencv())(gray)


def test_opencv_describes_our_points_as_we_do(detected):
    gray, ours = detected
    points, descriptors = exchange.to_opencv(ours)
    assert descriptors.dtype == np.float32
    kept, theirs = cv2.SIFT_create().compute(gray, points)
    assert len(kept) == len(ours)
    cosine = (theirs * descriptors).sum(axis=1)
    cosine /= np.linalg.norm(theirs, axis=1) * np.linalg.norm(descriptors, axis=1)
    assert np.median(cosine) > 0.999
    assert np.percentile(cosine, 5) > 0.99


@pytest.mark.parametrize("kind", ["sift", "must", "any"])
def test_octaves_are_unpacked_by_opencvs_own_formula(detected, rng, kind):
    """`unpackOctave` and the size of a point in `sift.simd.hpp`: 1.6 * 2^(layer / 3) per octave."""
    gray, ours = detected
    if kind == "any":
        ours = random_points(rng, 200)
    elif kind == "must":
        ours = saccade.Must()(gray)
    points, _ = exchange.to_opencv(ours)
    for point in points:
        octave, layer, rest = (point.octave >> shift & 255 for shift in (0, 8, 16))
        octave = octave if octave < 128 else octave - 256
        assert octave >= -1
        assert 1 <= layer <= 3
        size = 2 * 1.6 * 2 ** ((layer + rest / 255 - 0.5) / 3 + octave)
        if point.size > 1.8:  # the smallest layer
            assert point.size == pytest.approx(size, rel=2e-3)
    np.testing.assert_array_equal(exchange.from_opencv(points).octave, ours.octave)


def test_opencvs_own_points_come_in(detected):
    gray, _ = detected
    theirs, descriptors = cv2.SIFT_create().detectAndCompute(gray, None)
    found = exchange.from_opencv(theirs, descriptors)
    assert len(found) == len(theirs) > 100
    np.testing.assert_array_equal(found.xy, [point.pt for point in theirs])
    np.testing.assert_array_equal(found.descriptors, descriptors)
    for k, point in enumerate(theirs):
        assert found.size[k] == np.float32(point.size)
        assert found.response[k] == np.float32(point.response)
        turn = np.degrees(found.angle[k]) - point.angle
        assert abs((turn + 180) % 360 - 180) < 1e-4
        # Its octaves are those between whose halves and doubles the sizes lie.
        assert 1 < point.size / 2 / 1.6 / 2.0 ** found.octave[k] < 2.5
    back, floats = exchange.to_opencv(found)
    np.testing.assert_array_equal(floats, descriptors)
    for ours, point in zip(back, theirs, strict=True):
        assert ours.pt == point.pt
        assert ours.octave & 0xFFFF == point.octave & 0xFFFF
        assert ours.angle == pytest.approx(point.angle, abs=1e-4)


@pytest.mark.parametrize("kind", ["signed bytes", "unit vectors"])
def test_descriptors_that_are_no_bytes_match(rng, kind):
    points = [cv2.KeyPoint(float(k), 10, 4.0) for k in range(40)]
    rows = rng.integers(-128, 128, (40, 64)).astype(np.int8)
    if kind == "unit vectors":  # as OpenCV's SIFT with square roots
        rows = np.sqrt(rng.dirichlet(np.ones(128), 40)).astype(np.float32)
    order = rng.permutation(40)
    first, second = exchange.from_opencv(points, rows), exchange.from_opencv(points, rows[order])
    np.testing.assert_array_equal(first.descriptors, rows)
    pairs = saccade.match(first, second)
    assert len(pairs) == 40
    np.testing.assert_array_equal(order[pairs[:, 1]], pairs[:, 0])


def test_points_without_angle_and_descriptors_come_in():
    points = [cv2.KeyPoint(3.5, 4.25, 7.0), cv2.KeyPoint(1, 2, 31.0, 270.0, 0.5, 2)]
    found = exchange.from_opencv(points)
    np.testing.assert_allclose(found.angle, [0, -np.pi / 2], rtol=1e-6)
    np.testing.assert_array_equal(found.octave, [0, 2])
    assert found.descriptors is None
    assert len(exchange.from_opencv([])) == 0
    assert exchange.to_opencv(found)[1] is None


def test_hloc_reads_the_features(rng, tmp_path):
    """The arrays that hloc asks for, in the shapes and units in which it wants them."""
    first, second = random_points(rng, 30), random_points(rng, 50)
    second = dataclasses.replace(second, descriptors=rng.permutation(second.descriptors))
    second.descriptors[:20] = first.descriptors[:20]
    path = tmp_path / "feats-saccade.h5"
    exchange.write_hdf5(
        path,
        {"db/1.jpg": first, "query/2.jpg": second},
        {"db/1.jpg": (480, 640, 3), "query/2.jpg": (1000, 2000)},
    )
    with h5py.File(path, "r") as file:
        groups = [file["db/1.jpg"], file["query/2.jpg"]]
        a, b = ({name: data[()] for name, data in group.items()} for group in groups)
    assert all(np.asarray(values).dtype.kind in "fi" for values in a.values())
    np.testing.assert_array_equal(a["keypoints"], first.xy)
    np.testing.assert_array_equal(a["scores"], first.response)
    np.testing.assert_array_equal(a["image_size"], [640, 480])
    np.testing.assert_allclose(a["scales"], first.size / 2)
    np.testing.assert_allclose(np.radians(a["oris"]), first.angle, rtol=1e-6)
    assert a["descriptors"].shape == (128, 30)
    np.testing.assert_allclose(np.linalg.norm(a["descriptors"], axis=0), 1, rtol=1e-5)
    similarity = a["descriptors"].T @ b["descriptors"]  # its nearest-neighbor matcher
    np.testing.assert_array_equal(similarity.argmax(axis=1)[:20], np.arange(20))


def test_hlocs_own_features_come_in(rng, tmp_path):
    """Half precision, unit descriptors, no octaves."""
    counts = rng.integers(0, 60, (9, 128))
    units = (counts / 512).astype(np.float16)
    with h5py.File(tmp_path / "feats.h5", "w") as file:
        group = file.create_group("db/photo.jpg")
        group["keypoints"] = (rng.random((9, 2)) * 100).astype(np.float16)
        group["descriptors"] = units.T
        group["scores"] = rng.random(9).astype(np.float16)
        group["image_size"] = np.array([640, 480])
        expected = group["keypoints"][()].astype(np.float32)
    (found,) = exchange.read_hdf5(tmp_path / "feats.h5").values()
    np.testing.assert_array_equal(found.xy, expected)
    np.testing.assert_array_equal(found.descriptors, counts)
    np.testing.assert_array_equal(found.size, 2)


@pytest.mark.parametrize("kind", ["npz", "hdf5", "colmap"])
@pytest.mark.parametrize("what", ["missing", "empty", "garbage", "cut"])
def test_what_is_no_file_of_points_is_named(rng, tmp_path, kind, what):
    path = tmp_path / "file"
    if what == "garbage":
        path.write_bytes(bytes(rng.integers(128, 256, 999).astype(np.uint8)))
    elif what == "empty":
        path.touch()
    elif what == "cut":
        if kind == "colmap":
            path.write_text("x,y,size\n1,2,3\n")
        else:
            written(kind, path, random_points(rng, 500))
            path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(KeypointsError, match=f"^{path}") as caught:
        getattr(exchange, f"read_{kind}")(path)
    assert "\n" not in str(caught.value)
    assert [each.name for each in tmp_path.iterdir()] == ["file"] * (what != "missing")


def with_field(points, **fields):
    return dataclasses.replace(points, **fields)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"xy": np.zeros((3, 3), np.float32)}, r"xy: expected shape \(n, 2\), found \(3, 3\)"),
        ({"xy": np.full((3, 2), np.nan)}, "xy: expected float32, found nan"),
        ({"xy": np.full((3, 2), 1e300)}, r"xy: expected float32, found 1e\+300"),
        ({"size": np.ones(2)}, r"size: expected shape \(3,\), found \(2,\)"),
        ({"angle": np.array(["a"] * 3)}, "angle: expected numbers, found <U1"),
        ({"octave": np.array([1, 1.5, 2])}, "octave: expected int32, found 1.5"),
        ({"descriptors": np.zeros((2, 128))}, r"descriptors: expected shape \(3, 128\)"),
        ({"descriptors": np.full((3, 128), np.nan)}, "descriptors: expected float32, found nan"),
    ],
)
@pytest.mark.parametrize("kind", ["npz", "hdf5"])
def test_points_that_do_not_fit_are_named_and_not_written(rng, tmp_path, kind, fields, words):
    points = with_field(random_points(rng, 3), **fields)
    with pytest.raises(KeypointsError, match=words):
        written(kind, tmp_path / "file", points)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", "/absolute.jpg", "folder/"])
def test_names_that_no_format_can_hold(rng, tmp_path, name):
    with pytest.raises(KeypointsError, match="image: expected a name"):
        exchange.write_hdf5(tmp_path / "x", {name: random_points(rng, 1)})


def test_descriptors_of_other_lengths(rng, tmp_path):
    short = with_field(random_points(rng, 3), descriptors=np.ones((3, 64), np.uint8))
    assert_same(written("hdf5", tmp_path / "file", short), short)


def test_learned_descriptors_are_read_as_they_are(rng, tmp_path):
    descriptors = rng.normal(size=(256, 2)).astype(np.float32)
    with h5py.File(tmp_path / "superpoint.h5", "w") as file:
        file["a/keypoints"] = np.zeros((2, 2))
        file["a/descriptors"] = descriptors
    found = exchange.read_hdf5(tmp_path / "superpoint.h5")["a"]
    np.testing.assert_array_equal(found.descriptors, descriptors.T)
    exchange.write_hdf5(tmp_path / "again.h5", {"a": found})
    again = exchange.read_hdf5(tmp_path / "again.h5")["a"]
    np.testing.assert_allclose(again.descriptors, descriptors.T, atol=1e-6)


def test_points_from_anywhere():
    points = Keypoints.at([[1, 2], [3, 4]], size=[5, 6], angle=0.5)
    assert_same(points, Keypoints.at(points.xy.tolist(), points.size, [0.5, 0.5]))
    assert len(Keypoints.at([], 3)) == 0
    for xy, size, words in (
        (np.zeros((2, 3)), 3, r"xy: expected shape \(n, 2\), found \(2, 3\)"),
        (np.zeros(4), 3, r"xy: expected shape \(n, 2\), found \(4,\)"),
        (np.zeros((3, 2)), [1, 2], r"size: expected shape \(3,\), found \(2,\)"),
    ):
        with pytest.raises(KeypointsError, match=words):
            Keypoints.at(xy, size)
