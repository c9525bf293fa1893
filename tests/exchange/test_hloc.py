"""Features and matches, written for hloc and read by its own functions."""

import h5py
import numpy as np
import pytest

import saccade
from saccade import exchange
from saccade.errors import KeypointsError
from saccade.exchange.hdf5 import group_of
from support.hloc import import_hloc
from support.keypoint_files import HALLWAY

NAMES = ("query/one.jpg", "db/deep/two.jpg")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Points, matches and scores of two photographs, and the folder with their files."""
    folder = tmp_path_factory.mktemp("hloc")
    images = [saccade.read_image(path) for path in HALLWAY]
    points = dict(zip(NAMES, map(saccade.Sift(), images), strict=True))
    shapes = {name: image.shape for name, image in zip(NAMES, images, strict=True)}
    pairs = saccade.match(*points.values())
    scores = np.linspace(0.5, 1, len(pairs)).astype(np.float32)
    exchange.write_hdf5(folder / "features.h5", points, shapes)
    counts = {name: len(each) for name, each in points.items()}
    exchange.write_hloc_matches(folder / "matches.h5", {NAMES: pairs}, counts, {NAMES: scores})
    return folder, points, pairs, scores


@pytest.mark.peer
def test_hloc_reads_what_we_match(written):
    folder, points, pairs, scores = written
    io = import_hloc("utils.io")
    for name, each in points.items():
        np.testing.assert_array_equal(io.get_keypoints(folder / "features.h5", name), each.xy)
    assert sorted(io.list_h5_names(folder / "features.h5")) == sorted(NAMES)
    found, told = io.get_matches(folder / "matches.h5", *NAMES)
    np.testing.assert_array_equal(found, pairs)
    np.testing.assert_allclose(told, scores, atol=5e-4)  # half floats
    turned, _ = io.get_matches(folder / "matches.h5", *NAMES[::-1])
    np.testing.assert_array_equal(turned, pairs[:, ::-1])
    with pytest.raises(ValueError, match="Could not find pair"):
        io.get_matches(folder / "matches.h5", "a.jpg", "b.jpg")


def test_the_layout_is_as_hloc_documents_it(written):
    """Read from its description alone, where hloc is not installed."""
    folder, points, pairs, _ = written
    with h5py.File(folder / "matches.h5", "r") as file:
        group = file[NAMES[0].replace("/", "-")][NAMES[1].replace("/", "-")]
        partners, scores = group["matches0"][()], group["matching_scores0"][()]
    assert partners.shape == scores.shape == (len(points[NAMES[0]]),)
    index = np.flatnonzero(partners != -1)
    np.testing.assert_array_equal(np.stack([index, partners[index]], axis=1), pairs)
    assert (scores[partners == -1] == 0).all()
    ((name, (indices, _)),) = exchange.read_hloc_matches(folder / "matches.h5").items()
    assert name == group_of(*NAMES)
    np.testing.assert_array_equal(indices, pairs)


def test_more_keypoints_than_hloc_itself_can_number(tmp_path):
    """Its 16 bits end at 32767."""
    pairs = {("a", "b"): np.array([[0, 40_000], [39_999, 3]])}
    exchange.write_hloc_matches(tmp_path / "x.h5", pairs, {"a": 40_000, "b": 40_001})
    found, scores = exchange.read_hloc_matches(tmp_path / "x.h5")["a/b"]
    np.testing.assert_array_equal(found, pairs["a", "b"])
    np.testing.assert_array_equal(scores, [1, 1])


@pytest.mark.parametrize(
    ("matches", "words"),
    [
        ({("a", "c"): [[0, 0]]}, "c: expected a number of keypoints"),
        ({("a", "b"): [[0, 3]]}, "matches of a and b: expected indices below 2 and 3"),
        ({("a/x", "b"): [[0, 0]], ("a-x", "b"): [[0, 0]]}, "expected one pair named a-x/b"),
    ],
)
def test_matches_that_do_not_fit_are_named_and_not_written(tmp_path, matches, words):
    arrays = {pair: np.array(indices) for pair, indices in matches.items()}
    with pytest.raises(KeypointsError, match=words):
        exchange.write_hloc_matches(tmp_path / "x.h5", arrays, {"a": 2, "b": 3, "a/x": 1, "a-x": 1})
    assert not list(tmp_path.iterdir())
