"""Our reader of MATLAB files against SciPy's, and on broken files that bring SciPy's down."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy.io import loadmat, savemat

from saccade.datasets.matlab import read_variables
from saccade.errors import LogError
from support.error_checks import result_or_refusal

DTYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
numeric = st.sampled_from(DTYPES).flatmap(
    lambda kind: arrays(
        kind,
        array_shapes(min_dims=2, max_dims=3, min_side=0, max_side=5),
        elements=None if kind[0] != "f" else st.floats(-1e6, 1e6, width=32),
    )
)


@given(numeric, st.lists(numeric, min_size=1, max_size=4), st.booleans())
def test_values_are_those_that_scipy_reads(tmp_path_factory, values, cells, packed):
    path = tmp_path_factory.mktemp("mat") / "a.mat"
    cell = np.empty((len(cells), 1), object)
    cell[:, 0] = cells
    savemat(path, {"other": "words", "x": values, "c": cell}, do_compression=packed)
    ours, theirs = read_variables(path), loadmat(path)
    np.testing.assert_array_equal(ours["x"], theirs["x"].astype(float))
    assert len(ours["c"]) == len(cells)
    for one, two in zip(ours["c"], theirs["c"].ravel(order="F"), strict=True):
        np.testing.assert_array_equal(one, two.astype(float))


def _file(tmp_path, data):
    path = tmp_path / "broken.mat"
    path.write_bytes(data)
    return path


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "packed"])
def whole(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("mat") / "whole.mat"
    cell = np.empty((2, 1), object)
    cell[:, 0] = [np.arange(6.0).reshape(3, 2), np.empty((3, 0))]
    savemat(path, {"x": np.arange(20.0), "c": cell}, do_compression=request.param)
    return path.read_bytes()


@given(st.data())
def test_a_broken_file_is_one_line_and_no_crash(whole, tmp_path_factory, data):
    broken = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 6))):
        broken[data.draw(st.integers(100, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(whole)))
    path = _file(tmp_path_factory.mktemp("mat"), bytes(broken[:cut]))
    held, refusal = result_or_refusal(lambda: read_variables(path))
    assert refusal.startswith(str(path)) if held is None else held["x"].dtype == np.float64


def _matrix(kind, shape, content, size=None):
    dims = struct.pack(f"<II{len(shape)}i", 5, 4 * len(shape), *shape).ljust(16, b"\0")
    body = struct.pack("<IIII", 6, 8, kind, 0) + dims + struct.pack("<HHI", 1, 1, ord("x"))
    body += content
    return struct.pack("<II", 14, len(body) if size is None else size) + body


HEAD = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "version 5"),
        (b"\x89HDF\r\n".ljust(600, b"\0"), "version 7.3"),
        (HEAD + _matrix(6, (1, 1), b"", size=1 << 31), "longer than its container"),
        (HEAD + _matrix(6, (2, -3), b""), "negative size"),
        (HEAD + _matrix(6, (1 << 30, 1 << 30), struct.pack("<IId", 9, 8, 1.0)), "broken one"),
        (HEAD + _matrix(1, (1 << 30, 1), b""), "does not have the cells of its shape"),
        (HEAD + _matrix(6, (1, 1), struct.pack("<IId", 77, 8, 1.0)), "holds no numbers"),
        (HEAD + struct.pack("<II", 15, 4) + b"none", "broken one"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path, data, message):
    with pytest.raises(LogError, match=message) as caught:
        read_variables(_file(tmp_path, data))
    assert "\n" not in str(caught.value)


def test_cells_in_cells_have_an_end(tmp_path):
    content = _matrix(6, (1, 1), struct.pack("<IId", 9, 8, 1.0))
    for _ in range(2000):
        content = _matrix(1, (1, 1), content)
    with pytest.raises(LogError, match="x"):
        read_variables(_file(tmp_path, HEAD + content))
