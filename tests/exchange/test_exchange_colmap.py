"""COLMAP's database, written for pycolmap and read from what it writes."""

import sqlite3
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

import saccade
from saccade import exchange
from saccade.errors import ConfigError, KeypointsError
from saccade.exchange.colmap import import_pycolmap
from saccade.exchange.colmap_cameras import LENS_PARAMETERS
from support.keypoint_files import HALLWAY, assert_same, random_points

EXACT = ("size", "angle", "descriptors")

pytestmark = pytest.mark.peer


@pytest.fixture
def pycolmap():
    try:
        return import_pycolmap()
    except ConfigError as error:
        pytest.skip(str(error))


def test_colmap_finds_the_geometry_of_our_matches(pycolmap, tmp_path):
    """Its own verification takes our keypoints and matches, and keeps most."""
    images = [saccade.read_image(path) for path in HALLWAY]
    first, second = (saccade.Sift()(image) for image in images)
    pairs = saccade.match(first, second)
    path = tmp_path / "database.db"
    exchange.write_colmap(
        path,
        {"1.jpg": first, "deep/2.jpg": second},
        {"1.jpg": images[0].shape, "deep/2.jpg": images[1].shape},
        {("1.jpg", "deep/2.jpg"): pairs},
    )
    assert [each.name for each in tmp_path.iterdir()] == ["database.db"]
    pycolmap.geometric_verification(path)
    database = pycolmap.Database.open(path)
    here, there = (database.read_image_with_name(name) for name in ("1.jpg", "deep/2.jpg"))
    np.testing.assert_allclose(
        database.read_keypoints(here.image_id),
        np.c_[first.xy + 0.5, first.size / 2, first.angle],
        atol=1e-4,
    )
    stored = database.read_descriptors(there.image_id)
    assert stored.type == pycolmap.FeatureExtractorType.SIFT
    np.testing.assert_array_equal(stored.data, second.descriptors)
    np.testing.assert_array_equal(database.read_matches(here.image_id, there.image_id), pairs)
    camera = database.read_camera(here.camera_id)
    assert (camera.height, camera.width) == images[0].shape[:2]
    assert database.num_rigs() == database.num_frames() == 2
    geometry = database.read_two_view_geometry(here.image_id, there.image_id)
    database.close()
    assert len(geometry.inlier_matches) > 0.6 * len(pairs) > 20


def test_what_colmap_extracts_comes_in(pycolmap, tmp_path):
    """Its points, placed as we place ours, with descriptors that match ours."""
    gray = cv2.imread(HALLWAY[0], cv2.IMREAD_GRAYSCALE)
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "photo.png"), gray)
    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.num_threads = 1
    pycolmap.extract_features(
        tmp_path / "database.db", tmp_path / "images", extraction_options=options
    )
    features = exchange.read_colmap(tmp_path / "database.db")
    assert features.shapes == {"photo.png": gray.shape}
    (theirs,) = features.keypoints.values()
    ours = saccade.Sift(saccade.SiftConfig.colmap())(gray)

    def places(points):
        turn = np.stack([np.cos(points.angle), np.sin(points.angle)], axis=1)
        return np.c_[points.xy, 10 * np.log(points.size), 5 * turn]

    distance, index = cKDTree(places(ours)).query(places(theirs))
    same = distance < 1
    assert same.mean() > 0.8
    np.testing.assert_allclose(
        np.median(theirs.xy[same] - ours.xy[index[same]], axis=0), 0, atol=0.01
    )
    a, b = theirs.descriptors[same].astype(float), ours.descriptors[index[same]].astype(float)
    cosine = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    assert np.median(cosine) > 0.999


def test_points_come_back_as_they_were(pycolmap, rng, tmp_path):
    points = {
        "b.jpg": random_points(rng, 20),
        "a.jpg": random_points(rng, 30),
        "none.jpg": random_points(rng, 0),
        "bare.jpg": random_points(rng, 5, described=False),
    }
    shapes = {name: (400 + len(each), 640) for name, each in points.items()}
    pairs = {("b.jpg", "a.jpg"): np.array([[3, 29], [0, 2]])}
    exchange.write_colmap(tmp_path / "x.db", points, shapes, pairs)
    found = exchange.read_colmap(tmp_path / "x.db")
    assert list(found.keypoints) == sorted(points)
    assert found.shapes == shapes
    for name, each in points.items():
        fields = EXACT if name in ("a.jpg", "b.jpg") else EXACT[:2]
        assert_same(found.keypoints[name], each, fields)
        np.testing.assert_allclose(found.keypoints[name].xy, each.xy, atol=3e-4)  # half float32's
    assert found.keypoints["bare.jpg"].descriptors is None
    # COLMAP numbers images in the order of their names, and orders pairs by these numbers.
    assert list(found.matches) == [("a.jpg", "b.jpg")]
    np.testing.assert_array_equal(found.matches["a.jpg", "b.jpg"][:, ::-1], pairs["b.jpg", "a.jpg"])
    assert repr(found) == "ColmapFeatures(4 images, 1 matched pairs)"
    some = exchange.read_colmap(tmp_path / "x.db", ["b.jpg", "bare.jpg", "unknown.jpg"])
    assert list(some.keypoints) == ["b.jpg", "bare.jpg"]
    assert (some.matches, some.shapes) == ({}, shapes)
    both = exchange.read_colmap(tmp_path / "x.db", ["b.jpg", "a.jpg"])
    np.testing.assert_array_equal(both.matches["a.jpg", "b.jpg"], found.matches["a.jpg", "b.jpg"])


@pytest.mark.parametrize("columns", [2, 6])
def test_other_shapes_of_keypoints_come_in(pycolmap, rng, tmp_path, columns):
    """Places alone, and affine shapes, whose scale and angle pycolmap computes too."""
    points, name = random_points(rng, 20), "photo.jpg"
    exchange.write_colmap(tmp_path / "x.db", {name: points}, {name: (480, 640)})
    database = pycolmap.Database.open(tmp_path / "x.db")
    rows = rng.uniform(1, 5, (20, columns)).astype(np.float32)
    database.update_keypoints(1, rows)
    database.close()
    found = exchange.read_colmap(tmp_path / "x.db").keypoints[name]
    np.testing.assert_allclose(found.xy, rows[:, :2] - 0.5, rtol=1e-6)
    for k, row in enumerate(rows):
        size, angle = 2, 0
        if columns == 6:
            x, y, a11, a12, a21, a22 = row.tolist()
            theirs = pycolmap.FeatureKeypoint(x=x, y=y, a11=a11, a12=a12, a21=a21, a22=a22)
            size, angle = 2 * theirs.compute_scale(), theirs.compute_orientation()
        assert found.size[k] == pytest.approx(size, rel=1e-5)
        assert found.angle[k] == pytest.approx(angle, rel=1e-5)


@pytest.mark.parametrize(
    ("shapes", "matches", "words"),
    [
        (["a"], {}, "b: expected a shape for this image"),
        (["a", "b"], {("a", "c"): [[0, 0]]}, "matches of a and c: expected keypoints of c"),
        (["a", "b"], {("a", "a"): [[0, 0]]}, "expected two images, found one"),
        (["a", "b"], {("a", "b"): [[0, 3]]}, "expected indices below 2 and 3, found 0 to 3"),
        (["a", "b"], {("a", "b"): [[-1, 0]]}, "expected indices below 2 and 3, found -1"),
        (["a", "b"], {("a", "b"): [[0, 0, 0]]}, r"expected whole numbers of shape \(m, 2\)"),
        (["a", "b"], {("a", "b"): [[0.5, 0]]}, "expected whole numbers.*found float64"),
        (
            ["a", "b"],
            {("a", "b"): [[0, 0]], ("b", "a"): [[0, 0]]},
            "one order of the pair, found both",
        ),
    ],
)
def test_what_does_not_fit_is_named_and_not_written(
    pycolmap, rng, tmp_path, shapes, matches, words
):
    points = {"a": random_points(rng, 2), "b": random_points(rng, 3)}
    arrays = {pair: np.array(indices) for pair, indices in matches.items()}
    with pytest.raises(KeypointsError, match=words):
        exchange.write_colmap(tmp_path / "x", points, dict.fromkeys(shapes, (9, 9)), arrays)
    assert not list(tmp_path.iterdir())


def test_reading_changes_nothing(tmp_path):
    """Neither a database of another program nor one of an old version."""
    path = tmp_path / "x.db"
    rows = np.array([[10.5, 20.5, 2, 0.25]], "<f4")
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER,"
        " height INTEGER, params BLOB);"
        "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);"
        "CREATE TABLE keypoints (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
        "CREATE TABLE descriptors (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
        "CREATE TABLE matches (pair_id INTEGER, rows INTEGER, cols INTEGER, data BLOB);"
        "INSERT INTO cameras VALUES (1, 0, 640, 480, NULL);"
        "INSERT INTO images VALUES (7, 'old.jpg', 1);"
    )
    database.execute("INSERT INTO keypoints VALUES (7, 1, 4, ?)", (rows.tobytes(),))
    database.commit()
    before = path.read_bytes()
    (found,) = exchange.read_colmap(path).keypoints.values()
    np.testing.assert_array_equal([*found.xy[0], *found.size, *found.angle], [10, 20, 4, 0.25])
    assert found.descriptors is None
    assert path.read_bytes() == before
    database.execute("UPDATE keypoints SET rows = 2")
    database.commit()
    with pytest.raises(KeypointsError, match=r"x\.db: expected a COLMAP database: keypoints of 7"):
        exchange.read_colmap(path)
    assert not exchange.read_colmap(path, ["other.jpg"]).keypoints
    database.close()


def test_a_message_of_sqlite_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "x.db"
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE images_of_a_camera (image_id INTEGER)")
        database.commit()
    broken = path.read_bytes().replace(b"images_of_a", b"images_of_\xfe")
    path.write_bytes(broken.replace(b"CREATE TABLE", b"CREATE TABLX"))
    with pytest.raises(KeypointsError, match=r"x\.db: expected a COLMAP database: .*utf-8"):
        exchange.read_colmap(path)


def _cameras_of(pycolmap, path):
    """Model, parameters and whether the focal length is known, of the camera of each image."""
    database = pycolmap.Database.open(path)
    found = {}
    for image in database.read_all_images():
        camera = database.read_camera(image.camera_id)
        known = camera.has_prior_focal_length
        found[image.name] = (image.camera_id, camera.model.name, camera.params.tolist(), known)
    rigs = database.num_rigs()
    database.close()
    return found, rigs


def test_a_camera_is_shared_or_given_for_each_image(pycolmap, rng, tmp_path):
    points = {name: random_points(rng, 5) for name in ("a", "b")}
    shapes = dict.fromkeys(points, (480, 640))
    shared = exchange.ColmapCamera("PINHOLE", (500, 510, 320, 240))
    exchange.write_colmap(tmp_path / "x.db", points, shapes, cameras=shared)
    found, rigs = _cameras_of(pycolmap, tmp_path / "x.db")
    assert len({each[0] for each in found.values()}) == rigs == 1
    assert found["b"][1:] == ("PINHOLE", [500, 510, 320, 240], True)
    guess = exchange.ColmapCamera.parse("simple_radial")
    exchange.write_colmap(tmp_path / "x.db", points, shapes, cameras=guess, camera_mode="single")
    found, rigs = _cameras_of(pycolmap, tmp_path / "x.db")
    assert found["a"] == found["b"] == (1, "SIMPLE_RADIAL", [768, 320, 240, 0], False)
    each = {"a": shared, "b": exchange.ColmapCamera("OPENCV", (9, 9, 8, 8, 0.1, 0, 0, 0))}
    exchange.write_colmap(tmp_path / "x.db", points, shapes, cameras=each)
    found, rigs = _cameras_of(pycolmap, tmp_path / "x.db")
    assert [found[name][1] for name in "ab"] == ["PINHOLE", "OPENCV"]
    assert rigs == 2


def test_cameras_of_a_database_project_as_colmaps(pycolmap, rng, tmp_path):
    """The record that drives have and `verify` takes, for each lens model that OpenCV has too."""
    small = (500.0, 510.0, 330.0, 250.0, -0.1, 0.02, 1e-3, -2e-3, 1e-3, 1e-2, 1e-3, 1e-4)
    cameras = {}
    for model, (_, names) in LENS_PARAMETERS.items():
        count = len(names.split())
        params = small[:count] if names.startswith("fx") else (500.0, *small[2 : count + 1])
        cameras[model] = exchange.ColmapCamera(model, params, (640, 480))
    points = {name: random_points(rng, 3) for name in cameras}
    exchange.write_colmap(
        tmp_path / "x.db", points, dict.fromkeys(points, (480, 640)), cameras=cameras
    )
    read = exchange.read_colmap(tmp_path / "x.db").cameras
    xyz = np.c_[rng.uniform(-0.5, 0.5, (20, 2)), np.ones(20)]
    for model, camera in cameras.items():
        assert read[model] == camera
        theirs = pycolmap.Camera(model=model, width=640, height=480, params=camera.params)
        expected = theirs.img_from_cam(xyz) - 0.5
        np.testing.assert_allclose(read[model].to_camera().project(xyz), expected, atol=1e-6)
    with pytest.raises(ConfigError, match=r"camera: expected one of .*PINHOLE.*found 'FOV'"):
        exchange.ColmapCamera("FOV", (1, 1, 1, 1, 1), (9, 9)).to_camera()


@pytest.mark.parametrize(
    ("cameras", "error", "words"),
    [
        ("PINHOLES,1,2", ConfigError, "camera: expected one of .*PINHOLE, .*found 'PINHOLES'"),
        ("PINHOLE,1,2,3", ConfigError, "camera: expected PINHOLE,fx, fy, cx, cy"),
        ("PINHOLE,1,2,3,x", ConfigError, "camera: expected MODEL,fx"),
        ({"a": exchange.ColmapCamera("PINHOLE")}, KeypointsError, "b: expected a camera"),
        ("SIMPLE_PINHOLE,9,8,8", KeypointsError, "b: COLMAP did not import it; expected the size"),
        (
            {"a": exchange.ColmapCamera("PINHOLE", size=(9, 9))},
            KeypointsError,
            r"a: expected the size of its camera \(9, 9\), found 640 x 480",
        ),
    ],
)
def test_a_camera_that_does_not_fit_is_named(pycolmap, rng, tmp_path, cameras, error, words):
    points = {name: random_points(rng, 5) for name in ("a", "b")}
    shapes = {"a": (480, 640), "b": (480, 641)}

    def write():
        given = exchange.ColmapCamera.parse(cameras) if isinstance(cameras, str) else cameras
        exchange.write_colmap(tmp_path / "x.db", points, shapes, cameras=given)

    with pytest.raises(error, match=words):
        write()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "config"),
    [
        ([], saccade.SiftConfig.mapping()),
        (["--preset", "default"], saccade.SiftConfig()),
    ],
)
def test_matches_for_colmap_are_of_points_for_mapping(pycolmap, run, tmp_path, options, config):
    images = str(Path(HALLWAY[0]).parent / "hallway_*.jpg")
    words = ["match", images, "--format", "colmap", "--out", tmp_path, *options]
    assert run(*words)[0] == 0
    stored = exchange.read_colmap(tmp_path / "database.db").keypoints["hallway_1.jpg"]
    sift = saccade.Sift(config)
    expected = sift(saccade.read_image(HALLWAY[0]))
    np.testing.assert_allclose(stored.xy, expected.xy, atol=1e-3)


@pytest.mark.parametrize("command", ["match", "detect"])
def test_the_command_takes_a_camera_or_a_list_of_them(pycolmap, run, tmp_path, command):
    words = [command, str(Path(HALLWAY[0]).parent / "hallway_*.jpg"), "--format", "colmap"]
    height, width = saccade.read_image(HALLWAY[0]).shape[:2]
    camera = f"PINHOLE,400,400,{width / 2},{height / 2}"
    assert run(*words, "--out", tmp_path / "o", "--camera", camera)[0] == 0
    found, rigs = _cameras_of(pycolmap, tmp_path / "o" / "database.db")
    assert rigs == 1
    lines = [f"hallway_{n}.jpg SIMPLE_PINHOLE {width} {height} {n}00 9 9" for n in (1, 2)]
    (tmp_path / "cameras.txt").write_text("# as of hloc\n" + "\n".join(lines) + "\n")
    assert run(*words, "--out", tmp_path / "o", "--camera", tmp_path / "cameras.txt")[0] == 0
    found, _ = _cameras_of(pycolmap, tmp_path / "o" / "database.db")
    assert [found[f"hallway_{n}.jpg"][2][0] for n in (1, 2)] == [100, 200]
    (tmp_path / "cameras.txt").write_text("hallway_1.jpg PINHOLE many\n")
    code, _, err = run(*words, "--out", tmp_path / "o", "--camera", tmp_path / "cameras.txt")
    assert code == 2
    assert "cameras.txt, line 1: expected NAME MODEL WIDTH HEIGHT" in err
    code, _, err = run(*words, "--out", tmp_path / "q", "--camera", "PINHOLE,1,2")
    assert code == 2
    assert "camera: expected PINHOLE,fx, fy, cx, cy" in err
    assert not (tmp_path / "q").exists()
    code, _, err = run(*words[:2], "--out", tmp_path / "p", "--camera", camera)
    assert code == 2
    assert "camera: expected --format colmap" in err


TABLES = (
    "SELECT image_id, name, camera_id FROM images ORDER BY image_id",
    "SELECT camera_id, model, width, height, params, prior_focal_length FROM cameras",
    "SELECT position, coordinate_system FROM pose_priors",
)
"""What COLMAP's own import writes of its images."""


@pytest.mark.parametrize("mode", ["auto", "folder", "image"])
def test_images_are_imported_as_by_colmap(pycolmap, rng, tmp_path, mode):
    """Two cameras in two folders, EXIF focal lengths and GPS positions, one image turned."""
    from PIL import Image

    folder, files, points, shapes = tmp_path / "images", {}, {}, {}
    for number, (name, size) in enumerate(
        {"b/1.jpg": (64, 48), "a/2.jpg": (80, 60), "b/3.jpg": (64, 48), "a/4.png": (80, 60)}.items()
    ):
        files[name] = folder / name
        files[name].parent.mkdir(parents=True, exist_ok=True)
        image = Image.new("RGB", size)
        exif = image.getexif()
        exif[0x010F], exif[0x0110], exif[0x0112] = "Maker", "Model", 6 if number == 2 else 1
        exif[0x8769] = {0xA405: 28 + number}
        place = {1: "N", 2: (35.0, 5.0, float(number)), 3: "E", 4: (138.0, 51.0, 0.0)}
        exif[0x8825] = {**place, 5: b"\0", 6: 100.0}
        image.save(files[name], exif=exif)
        points[name] = random_points(rng, 5)
        shapes[name] = size[::-1] if number != 2 else size
    turned = {name: 6 if name == "b/3.jpg" else 1 for name in files}
    exchange.write_colmap(
        tmp_path / "ours.db", points, shapes, orientations=turned, camera_mode=mode, files=files
    )
    with pycolmap.Database.open(tmp_path / "theirs.db"):
        pass
    modes = {"auto": "AUTO", "folder": "PER_FOLDER", "image": "PER_IMAGE"}
    pycolmap.import_images(
        tmp_path / "theirs.db", folder, pycolmap.CameraMode.__members__[modes[mode]]
    )
    for query in TABLES:
        ours, theirs = (
            sqlite3.connect(tmp_path / name).execute(query).fetchall()
            for name in ("ours.db", "theirs.db")
        )
        assert ours == theirs, query
        assert ours
