"""Fixations in MATLAB files of any layout are read alike, or refused with what was found."""

from itertools import count

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from saccade.datasets.fixations import read_fixations
from saccade.errors import LogError

NAMES = ["1.png", "2.png", "3.png"]
LENGTHS = [(4, 5), (2, 3), (6, 2)]
"""Fixations of two subjects on each image."""
SEEN = [
    [
        np.array([(100 * image + 10 * subject + k, 7 * k + subject) for k in range(count)], float)
        for subject, count in enumerate(counts)
    ]
    for image, counts in enumerate(LENGTHS)
]


def cells(values, *shape):
    result = np.empty(shape or (1, len(values)), object)
    for place, each in zip(np.ndindex(*result.shape), values, strict=True):
        result[place] = each
    return result


def flat(field):
    """A column over all fixations."""
    return [
        field(image, subject, k)
        for image, counts in enumerate(LENGTHS)
        for subject, count in enumerate(counts)
        for k in range(count)
    ]


XY = np.array(flat(lambda i, s, k: SEEN[i][s][k]))
IMAGE, SUBJECT = flat(lambda i, s, k: NAMES[i]), np.array(flat(lambda i, s, k: s))
EVERY = [each for subjects in SEEN for each in subjects]
STRUCTS = [
    {"stimulus": NAMES[i], "subject_code": float(s), "x": SEEN[i][s][:, 0], "y": SEEN[i][s][:, 1]}
    for i in range(3)
    for s in range(2)
]
LAYOUTS = {
    "nested-cells": {"fixations": cells([cells(each) for each in SEEN]), "names": cells(NAMES)},
    "cell-matrix": {"fix": cells(EVERY, 3, 2), "img": cells(NAMES)},
    "subjects-by-images": {"fix": cells([SEEN[i][s] for s in range(2) for i in range(3)], 2, 3),
                           "files": cells(NAMES)},
    "without-names": {"data": cells([cells(each) for each in SEEN])},
    "transposed": {"fix": cells([each.T for each in EVERY], 3, 2), "names": cells(NAMES)},
    "struct-array": {"data": cells(STRUCTS)},
    "struct-of-columns": {"data": {"x": XY[:, 0], "y": XY[:, 1], "participant": SUBJECT + 0.0,
                                   "stimulus": cells(IMAGE)}},
    "variables": {"FIX_X": XY[:, 0], "FIX_Y": XY[:, 1], "observer": SUBJECT, "image": cells(IMAGE)},
    "matrix-with-heads": {
        "data": np.c_[SUBJECT, [NAMES.index(name) + 1 for name in IMAGE], XY],
        "columns": cells(["participant", "image", "x", "y"])},
    "struct-with-cells": {"d": {"stimuli": cells(NAMES), "fixations": cells(EVERY, 3, 2)}},
    "one-struct-a-fixation": {"data": cells([
        {"img": name, "sid": float(s), "x": x, "y": y}
        for name, s, (x, y) in zip(IMAGE, SUBJECT, XY, strict=True)])},
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("version", ["5", "7.3"])
def test_every_layout_reads_alike(tmp_path, name, version):
    path = tmp_path / "fixations.mat"
    if version == "5":
        savemat(path, LAYOUTS[name], oned_as="column")
    else:
        save_hdf5(path, LAYOUTS[name])
    found = read_fixations(path, say=str)
    named = name not in ("without-names", "matrix-with-heads")
    assert found.image.tolist() == (IMAGE if named else [each[0] for each in IMAGE])
    np.testing.assert_array_equal(found.subject, SUBJECT)
    np.testing.assert_array_equal(found.xy, XY)
    np.testing.assert_array_equal(found.index, flat(lambda i, s, k: k))


COUNT = count()
"""Numbers of the hidden variables of files."""


def save_hdf5(path, variables):
    """As MATLAB writes version 7.3: a header, transposed arrays, cells and structs by reference."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            _save(file, file, name, value)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _save(file, group, name, value):
    if isinstance(value, dict):
        node = group.create_group(name)
        for field, each in value.items():
            _save(file, node, field, each)
        kind = "struct"
    elif isinstance(value, np.ndarray) and value.dtype == object:
        refs = np.empty(value.shape, h5py.ref_dtype)
        hidden = file.require_group("#refs#")
        for place in np.ndindex(*value.shape):
            refs[place] = _save(file, hidden, f"r{next(COUNT)}", value[place]).ref
        node, kind = group.create_dataset(name, data=refs.T, dtype=h5py.ref_dtype), "cell"
    elif isinstance(value, str):
        codes = np.array([[ord(letter)] for letter in value], np.uint16)
        node, kind = group.create_dataset(name, data=codes), "char"
    else:
        array = np.asarray(value, float)
        array = array[:, None] if array.ndim == 1 else np.atleast_2d(array)
        node, kind = group.create_dataset(name, data=array.T), "double"
    node.attrs["MATLAB_class"] = np.bytes_(kind)
    return node


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        (
            {"map": np.zeros((30, 40)), "s": {"a": 1.0}},
            r"found map \(30 x 40\), s \(struct with a\)",
        ),
        (
            {"data": np.zeros((30, 4))},
            r"expected structs .* matrices \(n, 2\), found data \(30 x 4\)",
        ),
        ({"x": np.zeros(3), "y": np.zeros(3), "subject": 1.0}, "found no image of the fixations"),
        (
            {"x": np.zeros(3), "y": np.zeros(2), "subject": 1, "image": "a"},
            "y has 2 values, and x 3",
        ),
    ],
)
def test_what_is_found_in_another_file_is_named(tmp_path, variables, words):
    savemat(tmp_path / "a.mat", variables)
    with pytest.raises(LogError, match=rf"a\.mat: .*{words}"):
        read_fixations(tmp_path / "a.mat", say=str)
