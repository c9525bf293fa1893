"""Which images are matched: lists, sequences and GPS positions."""

import cv2
import numpy as np
import pytest
from PIL import Image

from saccade import ConfigError, ImageWarning
from saccade.batch import open_source
from saccade.batch.pairs import gps_of, images_and_pairs, read_pairs

PLACES = ((52.0, 4.0), (52.001, 4.0), (52.0, 4.0012), (-33.0, -70.5), (-33.0, -70.501))
"""Latitudes and longitudes; 1 m apart in pairs of three and of two."""


def degrees_minutes_seconds(value):
    minutes, seconds = divmod(abs(value) * 3600, 60)
    degrees, minutes = divmod(minutes, 60)
    return degrees, minutes, seconds


def photograph(path, place=None):
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.new("RGB", (32, 24))
    exif = image.getexif()
    if place is not None:
        latitude, longitude = map(degrees_minutes_seconds, place)
        south, west = place[0] < 0, place[1] < 0
        exif[0x8825] = {1: "NS"[south], 2: latitude, 3: "EW"[west], 4: longitude}
    image.save(path, exif=exif)


@pytest.fixture
def folder(tmp_path):
    for number, place in enumerate(PLACES):
        photograph(tmp_path / "photos" / f"{number}.jpg", place)
    return tmp_path / "photos"


def test_gps_positions_come_back(folder):
    for number, place in enumerate(PLACES):
        found = gps_of((folder / f"{number}.jpg").read_bytes())
        assert found == pytest.approx(place, abs=1e-7)
    assert gps_of(b"no image") is None


def test_nearest_images_are_paired(folder):
    _, pairs = images_and_pairs(str(folder), "gps:1")
    # East-west degrees are cos(52 deg) as long: 2 is 82 m from 0, and 1 is 111 m.
    assert pairs == [("0.jpg", "1.jpg"), ("0.jpg", "2.jpg"), ("3.jpg", "4.jpg")]
    _, every = images_and_pairs(str(folder), "gps:9")
    assert len(every) == 10
    photograph(folder / "nowhere.jpg")
    with pytest.warns(ImageWarning, match="1 of 6 images have no GPS position"):
        assert images_and_pairs(str(folder), "gps:1")[1] == pairs


def test_no_positions_are_reported(tmp_path):
    for name in ("a.jpg", "b.jpg"):
        photograph(tmp_path / name)
    with pytest.raises(ConfigError, match=r"GPS positions for gps:N, found 0 of 2"):
        images_and_pairs(str(tmp_path), "gps:2")


@pytest.mark.parametrize("count", [1, 3, 9])
def test_a_sequence_has_the_pairs_of_colmap(folder, tmp_path, count):
    pycolmap = pytest.importorskip("pycolmap")
    path = tmp_path / "x.db"
    with pycolmap.Database.open(path):
        pass
    pycolmap.import_images(path, folder)
    options = pycolmap.SequentialPairingOptions(overlap=count, quadratic_overlap=False)
    with pycolmap.Database.open(path) as database:
        name_of = {each.image_id: each.name for each in database.read_all_images()}
        theirs = pycolmap.SequentialPairGenerator(options, database).all_pairs()
    expected = {frozenset(map(name_of.get, pair)) for pair in theirs}
    _, pairs = images_and_pairs(str(folder), f"sequential:{count}")
    assert len(pairs) == len(set(map(frozenset, pairs)))
    assert set(map(frozenset, pairs)) == expected


@pytest.mark.parametrize("wanted", ["sequential:", "sequential:0", "gps:-1", "gps:many"])
def test_a_number_of_neighbors_is_required(folder, wanted):
    with pytest.raises(ConfigError, match="N of neighbors"):
        images_and_pairs(str(folder), wanted)


def test_scores_and_missing_names_are_left_out(folder, tmp_path):
    listed = tmp_path / "pairs.txt"
    listed.write_text("0.jpg 1.jpg 0.83\n1.jpg gone.jpg 1e-3\n2.jpg 3.jpg\n")
    assert len(read_pairs(listed)) == 3
    with pytest.warns(ImageWarning, match=r"'gone.jpg', which is not there; 1 of 3 pairs"):
        images, pairs = images_and_pairs(str(folder), str(listed))
    assert pairs == [("0.jpg", "1.jpg"), ("2.jpg", "3.jpg")]
    assert [image.name for image in images] == ["0.jpg", "1.jpg", "2.jpg", "3.jpg"]


def test_lists_have_a_root_and_cameras(folder, tmp_path):
    listed = tmp_path / "lists" / "queries.txt"
    listed.parent.mkdir()
    listed.write_text(
        "0.jpg PINHOLE 32 24 30.5 30.5 16 12\n1.jpg SIMPLE_RADIAL 32 24 3e1 16 12 -.1\n"
    )
    found = open_source(str(listed), root=str(folder))
    assert [(each.name, each.location) for each in found] == [
        (name, f"{folder}/{name}") for name in ("0.jpg", "1.jpg")
    ]
    with pytest.raises(ConfigError, match="root"):
        open_source(str(folder), root=str(folder))


def test_folders_are_read_with_their_subfolders_but_hidden_ones(folder):
    for name in ("deep/5.jpg", ".thumbnails/6.jpg", "out/maps/7.jpg"):
        photograph(folder / name)
    found = open_source(str(folder), without=str(folder / "out"))
    assert [each.name for each in found] == [*(f"{n}.jpg" for n in range(5)), "deep/5.jpg"]
    assert cv2.imread(found[-1].location).shape == (24, 32, 3)
    assert np.unique([each.name for each in found]).size == len(found)
