"""Fixations as laboratories and eye trackers write them are read alike, or refused with a cure."""

from dataclasses import fields, replace
from itertools import product

import cv2
import numpy as np
import pytest

from saccade.cli.fixation_tables import fixation_format
from saccade.datasets.fixations import FixationFormat, read_fixations, write_fixations
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
    assert found.trial is None
    for field, values in zip(fields(found), expected, strict=False):
        np.testing.assert_array_equal(getattr(found, field.name), values)
    if variant.__name__ == "fixation_report":
        assert "15 fixations with an empty cell" in remarks
        assert "24 rows that repeat another" in remarks


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x, y: (x / 800, y / 600), "--xy normalized"),
        (lambda x, y: (x / 8, y / 6), r"--xy WIDTH,HEIGHT.*100,100"),
        (lambda x, y: (x + 240, y + 212), r"--offset X,Y.*about 2[34]\d,2[01]\d"),
        (lambda x, y: (x - 400, y - 300), r"--offset X,Y.*about -(39|40)\d,-(29|30)\d"),
        (lambda x, y: (1.8 * x, 1.8 * y), "--xy WIDTH,HEIGHT"),
        (lambda x, y: (1.25 * x, 1.25 * y), r"--xy WIDTH,HEIGHT.*about (9|10)\d\d,7[0-6]\d"),
        (lambda x, y: (y, x), "--axes=y,x"),
        (lambda x, y: (x, -y), "--axes=x,-y"),
        (lambda x, y: (-x, y), "--axes=-x,y"),
        (lambda x, y: (x - 400, 300 - y), r"--offset X,Y.*--axes=x,-y if y points up"),
    ],
    ids=[
        *("normalized", "percent", "screen", "centered", "enlarged", "a-little-enlarged"),
        *("exchanged", "upwards", "leftwards", "centered-upwards"),
    ],
)
def test_positions_elsewhere_are_refused_with_the_cure(change, words, seen, photos, tmp_path):
    moved = [s._replace(x=change(s.x, s.y)[0], y=change(s.x, s.y)[1]) for s in seen]
    path, _ = canonical(moved, tmp_path)
    with pytest.raises(LogError, match=f"800 x 600.*{words}"):
        read(path, [], photos)
    found, _ = read(path, ["--xy", "pixels"], photos)
    assert len(found) == len(seen)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x, y: (y, x), ["--axes", "y,x"]),
        (lambda x, y: (x, -y), ["--axes", "x,-y"]),
        (lambda x, y: (x - 400, 300 - y), ["--axes", "x,-y", "--offset", "-400,-300"]),
    ],
    ids=["exchanged", "upwards", "centered-upwards"],
)
def test_the_cure_reads_what_was_exchanged_or_mirrored(change, words, seen, photos, tmp_path):
    moved = [s._replace(x=change(s.x, s.y)[0], y=change(s.x, s.y)[1]) for s in seen]
    given = dict(zip(words[::2], words[1::2], strict=True))
    form = replace(fixation_format(None, None, given.get("--offset")), axes=given["--axes"])
    found = read_fixations(canonical(moved, tmp_path)[0], photos, form)
    np.testing.assert_allclose(found.xy, [(s.x, s.y) for s in sorted(seen)], atol=1e-6)


def test_central_fixations_with_exchanged_axes_are_refused(photos, tmp_path):
    """A fifth of them or fewer are outside, as the middle of an image is in it in any case."""
    rng = np.random.default_rng(1)
    xy = rng.normal((400, 300), (160, 90), (300, 2)).clip((5, 5), (795, 595))
    rows = [(NAMES[k % 3], k % 7, k // 21, y, x) for k, (x, y) in enumerate(xy.tolist())]
    path = tmp_path / "a.csv"
    path.write_text(_trials("image,subject,index,x,y", rows))
    with pytest.raises(LogError, match=r"found \d\d of 300 fixations outside.*--axes=y,x"):
        read_fixations(path, photos, say=str)


@pytest.mark.parametrize("magnified", [0.5, 1, 2, 2.4])
def test_every_pixel_of_a_magnified_image_is_in_it(photos, tmp_path, magnified):
    """The first and the last pixel on the screen, and the edges of normalized positions."""
    width, height = 800 * magnified, 600 * magnified
    for shown, last in (((width, height), (width - 1, height - 1)), ((1, 1), (1, 1))):
        path = tmp_path / "a.csv"
        corners = [(x, y) for x in (0, last[0]) for y in (0, last[1])]
        rows = [(NAMES[0], k, j, *xy) for k in range(5) for j, xy in enumerate(corners)]
        path.write_text(_trials("image,subject,index,x,y", rows))
        found = read_fixations(path, photos, FixationFormat(shown=shown), say=pytest.fail)
        offset = 0.5 / magnified - 0.5 if last[0] > 1 else -0.5
        np.testing.assert_allclose(found.xy[0], offset, atol=1e-5)
        np.testing.assert_allclose(found.xy[3], np.array([799, 599]) - offset, atol=1e-5)


def test_fixations_outside_are_left_out_with_a_remark(photos, seen, tmp_path):
    beside = [seen[0]._replace(x=900.0, index=7), seen[9]._replace(y=-20.0, index=7)]
    remarks = []
    path, _ = canonical([*seen, *beside], tmp_path)
    assert len(read_fixations(path, photos, say=remarks.append)) == len(seen)
    assert "2 fixations outside their images are left out" in " ".join(remarks)


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
        ("subject,image,x,y,t\n1,a,9,9,5\n1,a,,9,6\n1,a,9,NA,7\n1,a,9,9,8\n",
         [0, 1], ": 2 fixations"),
        ("subject,image,x,y,index\n1,a,9,9,0\n1,a,7,9,0\n1,a,8,9,1\n1,a,6,9,1\n",
         [0, 0, 1, 1], "2 fixations have the image"),
    ],
    ids=["from-one", "first-missing", "running", "no-order", "blinks", "both-eyes"],
)  # fmt: skip
def test_the_first_fixation_of_a_scanpath_is_number_0(tmp_path, text, index, remark):
    (tmp_path / "a.csv").write_text(text)
    remarks = []
    assert read_fixations(tmp_path / "a.csv", say=remarks.append).index.tolist() == index
    assert remark in " ".join(remarks)


def _trials(columns, rows):
    return "\n".join([columns, *(",".join(map(str, row)) for row in rows)]) + "\n"


THERE, BACK = [30, 78, 126, 174], [174, 126, 78, 30]
TWICE = {
    "trial": _trials(
        "subject,image,trial,index,x,y",
        [(1, "a", t, k, x, 9) for t, xs in ((3, THERE), (8, BACK)) for k, x in enumerate(xs)],
    ),
    "session": _trials(
        "subject,image,session,t,x,y",
        [(1, "a", s, k, x, 9) for k in range(4) for s, x in ((1, THERE[k]), (2, BACK[k]))],
    ),
    "index": _trials(
        "subject,image,index,x,y",
        [(1, "a", k, x, 9) for xs in (THERE, BACK) for k, x in enumerate(xs, 1)],
    ),
    "lengths": _trials(
        "subject,image,index,x,y",
        [(1, "a", k, x, 9) for xs in (THERE, [*BACK, -18, -66]) for k, x in enumerate(xs)],
    ),
    "time": _trials(
        "subject,image,t,x,y",
        [(1, "a", 300 * k + s, xs[k], 9) for s, xs in enumerate((THERE, BACK)) for k in range(4)],
    ),
    "return": _trials(
        "subject,image,t,x,y",
        [(1, name, 300 * k + start, x, 9) for name, start, xs in
         (("a", 0, THERE), ("b", 3000, THERE), ("a", 6000, BACK)) for k, x in enumerate(xs)],
    ),
    "rows": _trials(
        "subject,image,x,y",
        [(1, name, x, 9) for name, xs in (("a", THERE), ("b", THERE), ("a", BACK)) for x in xs],
    ),
}  # fmt: skip
"""A subject sees the image a twice, from left to right and back: what the file tells of it."""


@pytest.mark.parametrize("name", TWICE)
def test_trials_of_a_subject_on_an_image_are_not_mixed(tmp_path, name):
    path = tmp_path / "a.csv"
    path.write_text(TWICE[name])
    with pytest.raises(LogError, match=r"a\.csv: .*several of 1 on a; --trials separate"):
        read_fixations(path, say=str)
    found = read_fixations(path, form=FixationFormat(trials="separate"), say=str)
    on_a = found[found.image == "a"]
    for number, start in enumerate((30, 174)):
        path_of_trial = on_a[on_a.trial == number]
        assert path_of_trial.xy[0, 0] == start
        assert path_of_trial.index.tolist() == [*range(len(path_of_trial))]
        assert set(np.abs(np.diff(path_of_trial.xy[:, 0]))) == {48}
    write_fixations(tmp_path / "again.csv", found)
    back = read_fixations(tmp_path / "again.csv", form=FixationFormat(trials="separate"), say=str)
    np.testing.assert_array_equal(back.xy, found.xy)
    np.testing.assert_array_equal(back.trial, found.trial)
    first = read_fixations(path, form=FixationFormat(trials="first"), say=str)
    assert first.xy[first.image == "a", 0].tolist() == THERE
    joined = read_fixations(path, form=FixationFormat(trials="joined"), say=str)
    assert joined.trial is None
    assert name == "rows" or len(joined) == len(found)  # without numbers, equal rows are one


def test_files_of_one_subject_are_trials_unless_they_repeat_each_other(tmp_path):
    for name, xs in (("1.csv", THERE), ("2.csv", BACK), ("copy.csv", BACK)):
        rows = [("s1", "a", k, x, 9) for k, x in enumerate(xs)]
        (tmp_path / name).write_text(_trials("subject,image,index,x,y", rows))
    found = read_fixations(tmp_path, form=FixationFormat(trials="separate"), say=str)
    assert found.xy[:, 0].tolist() == THERE + BACK
    assert found.scanpath.tolist() == [0] * 4 + [1] * 4


@pytest.mark.parametrize("shown", ["TRIALID", "IMGLOAD"])
def test_trials_of_eyelink_are_not_joined(tmp_path, shown):
    """Of one image in two trials, and of one that returns after another in a trial."""
    lines = ["MSG 1 TRIALID 1"]
    for start, image, xs in ((1000, "a", THERE), (3000, "b", THERE), (5000, "a", BACK)):
        lines += [f"MSG {start} TRIALID {start}"] * (shown == "TRIALID")
        lines.append(f"MSG {start + 1} !V IMGLOAD TOP_LEFT {image}.png 0 0")
        lines += [
            f"EFIX R {start + 9 + 300 * k} {start + 249 + 300 * k} 240 {x} 9 1000"
            for k, x in enumerate(xs)
        ]
    (tmp_path / "s1.asc").write_text("\n".join(lines) + "\n")
    with pytest.raises(LogError, match=r"several of s1 on a\.png"):
        read_fixations(tmp_path / "s1.asc", say=str)
    form = FixationFormat(trials="separate")
    found = read_fixations(tmp_path / "s1.asc", form=form, say=str)
    assert found.xy[found.image == "a.png", 0].tolist() == THERE + BACK
    assert found.index.tolist() == [*range(4)] * 3


def _eyelink_blocks(path, plan, start_lines):
    """Four fixations on an image in each block: of the left eye at y = 40, of the right at 50."""
    lines = []
    for number, eyes in enumerate(plan):
        t = 4000 * number
        lines += [f"MSG {t + 1} TRIALID {number}", f"MSG {t + 2} !V IMGLOAD FILL {number}.png"]
        lines += [f"START {t + 3} {eyes}"] * start_lines
        for k, eye in product(range(4), eyes):
            start, y = t + 9 + 300 * k, 40 + 10 * (eye == "R")
            lines.append(f"EFIX {eye} {start} {start + 240} 240 {50 + k} {y} 9")
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("start_lines", [True, False])
@pytest.mark.parametrize(
    ("plan", "eye", "y"),
    [
        (["R", "L", "R"], None, [50, 40, 50]),
        (["LR", "L", "R"], None, [45, 40, 50]),
        (["LR", "L", "R"], "right", [50, 40, 50]),
        (["R", "LR", "LR"], None, [50, 45, 45]),
        (["R", "LR", "LR"], "left", [50, 40, 40]),
    ],
)
def test_each_block_is_read_by_an_eye_that_it_has(tmp_path, plan, eye, y, start_lines):
    _eyelink_blocks(tmp_path / "s1.asc", plan, start_lines)
    found = read_fixations(tmp_path / "s1.asc", form=FixationFormat(eye=eye), say=str)
    assert found.image.tolist() == [f"{k // 4}.png" for k in range(12)]
    assert found.xy[:, 1].tolist() == np.repeat(y, 4).tolist()
    rows = [
        ("s1", number, side, k, 50 + k, 40 + 10 * (side == "Right"))
        for number, eyes in enumerate(plan)
        for side in ("Left", "Right")
        if side[0] in eyes
        for k in range(4)
    ]
    (tmp_path / "a.csv").write_text(_trials("subject,image,EYE_USED,index,x,y", rows))
    table = read_fixations(tmp_path / "a.csv", form=FixationFormat(eye=eye), say=str)
    np.testing.assert_array_equal(table.xy, found.xy)


def test_both_eyes_are_averaged_where_they_fixate_at_the_same_time(tmp_path):
    """The right eye loses a fixation, and begins each of the others 7 ms later."""
    _eyelink_blocks(tmp_path / "s1.asc", ["LR"], True)
    lines = (tmp_path / "s1.asc").read_text().splitlines()
    rights = [n for n, line in enumerate(lines) if line.startswith("EFIX R")]
    for n in rights:
        words = lines[n].split()
        lines[n] = " ".join([*words[:2], str(int(words[2]) + 7), *words[3:5], "60", "70", "9"])
    del lines[rights[1]]
    (tmp_path / "s1.asc").write_text("\n".join(lines) + "\n")
    remarks = []
    found = read_fixations(tmp_path / "s1.asc", say=remarks.append)
    assert found.xy.tolist() == [[55, 55], [51, 40], [56, 55], [56.5, 55]]
    assert "3 fixations are the mean of both eyes" in " ".join(remarks)


def test_eyes_with_other_numbers_of_fixations_are_not_averaged_by_index(tmp_path):
    """The second fixation of the left eye is none of the right: later indices are shifted."""
    xs = {"L": [10, 20, 30, 40], "R": [12, 32, 42]}
    rows = [("s1", "a", eye, k, x, 9) for eye, each in xs.items() for k, x in enumerate(each)]
    (tmp_path / "a.csv").write_text(_trials("subject,image,eye,index,x,y", rows))
    found = read_fixations(tmp_path / "a.csv", say=str)
    assert found.xy[:, 0].tolist() == xs["L"]


def test_an_eye_that_is_hardly_tracked_in_a_block_is_not_read_there(tmp_path):
    _eyelink_blocks(tmp_path / "s1.asc", ["L", "LR"], True)
    lines = (tmp_path / "s1.asc").read_text().splitlines()
    left = [n for n, line in enumerate(lines) if line.startswith("EFIX L 4")]
    kept = [line for n, line in enumerate(lines) if n not in left[1:]]
    (tmp_path / "s1.asc").write_text("\n".join(kept) + "\n")
    assert read_fixations(tmp_path / "s1.asc", say=str).xy[:, 1].tolist() == [40] * 4 + [50] * 4


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
