"""Fixations as laboratories and eye trackers write them are read alike, or refused with a cure."""

from dataclasses import fields

import cv2
import numpy as np
import pytest

from saccade.cli.fixation_tables import fixation_format
from saccade.datasets.fixations import read_fixations
from saccade.errors import ConfigError, LogError
from support.fixation_variants import VARIANTS, canonical, with_times

NAMES = [f"{number}.png" for number in range(1001, 1004)]


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    for name in NAMES:
        cv2.imwrite(str(folder / name), np.zeros((600, 800), np.uint8))
    return folder


@pytest.fixture(scope="module")
def seen():
    """Eleven people who look at the middle of three images, and then about."""
    rng = np.random.default_rng(0)
    rows = []
    for image in NAMES:
        for subject in range(11):
            places = np.vstack([(400, 300), rng.uniform((5, 5), (795, 595), (4, 2))]).round(1)
            spans = rng.integers(80, 400, 5)
            rows += [
                (image, subject, index, *place, float(span))
                for index, (place, span) in enumerate(zip(places, spans, strict=True))
            ]
    return with_times(rows)


def read(path, options, photos):
    """The fixations as the commands read them, and the remarks."""
    given = dict(zip(options[::2], options[1::2], strict=True))
    form = fixation_format(*(given.get(name) for name in ("--columns", "--xy", "--offset")))
    remarks = []
    return read_fixations(path, photos, form, say=remarks.append), " ".join(remarks)


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda each: each.__name__)
def test_every_way_to_write_fixations_reads_alike(variant, seen, photos, tmp_path):
    found, remarks = read(*variant(seen, tmp_path), photos)
    image, subject, index, x, y, milliseconds, _ = zip(*sorted(seen), strict=True)
    expected = image, subject, index, np.array([x, y]).T, np.array(milliseconds) / 1000
    for field, values in zip(fields(found), expected, strict=True):
        np.testing.assert_array_equal(getattr(found, field.name), values)
    if variant.__name__ == "fixation_report":
        assert "15 rows with an empty cell" in remarks
        assert "24 rows that repeat another" in remarks


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x, y: (x / 800, y / 600), "--xy normalized"),
        (lambda x, y: (x / 8, y / 6), r"--xy WIDTH,HEIGHT.*100,100"),
        (lambda x, y: (x + 240, y + 212), r"--offset X,Y.*about 2[34]\d,2[01]\d"),
        (lambda x, y: (x - 400, y - 300), r"--offset X,Y.*about -(39|40)\d,-(29|30)\d"),
        (lambda x, y: (1.8 * x, 1.8 * y), "--xy WIDTH,HEIGHT"),
    ],
    ids=["normalized", "percent", "screen", "centered", "enlarged"],
)
def test_positions_elsewhere_are_refused_with_the_cure(change, words, seen, photos, tmp_path):
    moved = [s._replace(x=change(s.x, s.y)[0], y=change(s.x, s.y)[1]) for s in seen]
    path, _ = canonical(moved, tmp_path)
    with pytest.raises(LogError, match=f"800 x 600.*{words}"):
        read(path, [], photos)
    found, _ = read(path, ["--xy", "pixels"], photos)
    assert len(found) == len(seen)


@pytest.mark.parametrize(
    ("text", "index", "remark"),
    [
        ("subject,image,x,y,index\n" + "".join(f"{v},a,9,9,{k}\n" for v in "12" for k in (1, 2)),
         [0, 1, 0, 1], "counts from 1"),
        ("subject,image,x,y,index\n1,a,9,9,0\n1,a,8,9,1\n2,a,9,9,1\n2,a,9,8,2\n",
         [0, 1, 1, 2], ""),  # the first one is missing
        ("subject,image,x,y,index\n1,a,9,9,7\n1,a,8,9,8\n2,a,9,9,31\n2,a,9,8,30\n",
         [0, 1, 0, 1], ""),
        ("subject,image,x,y\n1,a,9,9\n1,a,8,9\n1,a,8,9\n", [0, 1], "order is that of the rows"),
        ("subject,image,x,y,t\n1,a,9,9,5\n1,a,,9,6\n1,a,9,NA,7\n1,a,9,9,8\n", [0, 1], ": 2 rows"),
        ("subject,image,x,y,index\n1,a,9,9,0\n1,a,7,9,0\n", [0, 0], "1 fixations have the image"),
    ],
    ids=["from-one", "first-missing", "running", "no-order", "blinks", "both-eyes"],
)  # fmt: skip
def test_the_first_fixation_of_a_scanpath_is_number_0(tmp_path, text, index, remark):
    (tmp_path / "a.csv").write_text(text)
    remarks = []
    assert read_fixations(tmp_path / "a.csv", say=remarks.append).index.tolist() == index
    assert remark in " ".join(remarks)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((None, "wide", None), "--xy: expected"),
        ((None, None, "1"), "--offset: expected"),
        (("who", None, None), "--columns: expected"),
    ],
)
def test_a_wrong_option_is_named(given, words):
    with pytest.raises(ConfigError, match=words):
        fixation_format(*given)
