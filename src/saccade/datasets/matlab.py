"""Reads numbers and text from MATLAB files of version 5, with every length checked.

SciPy reads more types, but a corrupt file can crash its compiled reader, and Python with it.
"""

import zlib
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from saccade.errors import LogError
from saccade.extras import import_optional
from saccade.io.files import open_file, read_bytes, reading
from saccade.io.npz import check_unpacked
from saccade.types import FloatArray

HEADER = 128
MAX_VARIABLE_SIZE = 1 << 30
"""Maximum size of an uncompressed variable, in bytes."""
MAX_DEPTH = 6
"""Maximum nesting depth of cells and structs."""
_MATRIX = 14
_COMPRESSED = 15
_CELL = 1
_STRUCT = 2
_CHAR = 4
_NUMERIC = range(6, 16)
_TYPES = dict(
    zip(
        (1, 2, 3, 4, 5, 6, 7, 9, 12, 13),
        ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", "i8", "u8"),
        strict=True,
    )
)
_TEXT = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}


def read_variables(path: Path) -> dict[str, Any]:
    """Variables of a .mat file of version 5 or 7.3: real numbers, text, cells and structs.

    Returns:
        Values by name: an array of float64, a text (a list of texts for a matrix of characters), a
            list of the cells of a cell array (a list of rows if it has several rows and columns),
            or the fields of a struct by name; a list of such fields for a struct array. Variables
            of other types are left out.

    Source: MathWorks, "MAT-File Format", the level 5 format.
    """
    with reading(path, LogError), open_file(path) as file:
        is_hdf5 = file.read(HEADER * 5).find(b"\x89HDF") >= 0
    return _read_hdf5(path) if is_hdf5 else _read_version_5(path)


def _read_hdf5(path: Path) -> dict[str, Any]:
    """Variables of a file of version 7.3, which is HDF5 with the MATLAB class as an attribute."""
    h5py = import_optional("h5py", "hdf5")

    def value(node: Any, depth: int = 0) -> Any:
        kind = node.attrs.get("MATLAB_class", b"")
        if depth > MAX_DEPTH:
            raise ValueError("nested too deeply")
        if isinstance(node, h5py.Group):
            fields = {name: value(each, depth + 1) for name, each in node.items()}
            is_array = all(
                isinstance(each, h5py.Dataset) and "MATLAB_class" not in each.attrs
                for each in node.values()
            )
            if not is_array:
                return fields
            return [
                dict(zip(fields, row, strict=True)) for row in zip(*fields.values(), strict=True)
            ]
        check_unpacked(path.stat().st_size, node.size * node.dtype.itemsize)
        if "MATLAB_empty" in node.attrs:
            return [] if kind == b"cell" else np.empty((0, 0))
        stored = node[()]
        if h5py.check_ref_dtype(node.dtype) is not None:
            cells = [[value(node.file[each], depth + 1) for each in row] for row in stored.T]
            return cells if min(stored.shape) > 1 else [each for row in cells for each in row]
        if kind == b"char":
            return _text(["".join(map(chr, row)) for row in np.atleast_2d(stored.T).tolist()])
        return np.asarray(stored, np.float64).T

    foreign = (OSError, ValueError, KeyError, TypeError, RuntimeError)
    with reading(path, LogError, "a MATLAB file of version 7.3", *foreign), h5py.File(path) as file:
        return {name: value(node) for name, node in file.items() if not name.startswith("#")}


def read_matrix(path: Path) -> FloatArray:
    """The only matrix of more than one number in a .mat file, (h, w) float64."""
    matrices = {
        name: value
        for name, value in read_variables(path).items()
        if isinstance(value, np.ndarray) and value.ndim == 2 and value.size > 1
    }
    if len(matrices) != 1:
        found = ", ".join(matrices) or "none"
        raise LogError(f"{path}: expected a single matrix of numbers, found {found}")
    matrix: FloatArray = next(iter(matrices.values()))
    return matrix


def _read_version_5(path: Path) -> dict[str, Any]:
    with reading(path, LogError):
        data = read_bytes(path)
    order = {b"IM": "<", b"MI": ">"}.get(data[HEADER - 2 : HEADER])
    if order is None:
        raise LogError(f"{path}: expected a MATLAB file of version 5, found another file")
    variables: dict[str, Any] = {}
    with reading(path, LogError, "a MATLAB file, found a broken one", ValueError, zlib.error):
        for matrix in _matrices(data[HEADER:], order):
            variables |= _variable(matrix, order)
    return variables


def _matrices(data: bytes, order: str) -> Iterator[bytes]:
    """The content of each variable, decompressed."""
    for kind, payload in _elements(data, order):
        if kind == _MATRIX:
            yield payload
        elif kind == _COMPRESSED:
            elements = _elements(_decompress(payload), order)
            yield from (matrix for inner, matrix in elements if inner == _MATRIX)


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and content of each element; small elements have their content in the tag."""
    start = 0
    while start < len(data):
        if start + 8 > len(data):
            raise ValueError("it ends within a tag")
        kind, size = (int(word) for word in np.frombuffer(data, f"{order}u4", 2, start))
        small, kind = divmod(kind, 1 << 16)
        begin = start + (4 if small else 8)
        size = small or size
        if begin + size > len(data) or small > 4:
            raise ValueError("an element is longer than its container")
        yield kind, data[begin : begin + size]
        packed = small == 0 and kind == _COMPRESSED
        start = start + 8 if small else begin + (size if packed else -(-size // 8) * 8)


def _decompress(payload: bytes) -> bytes:
    decompressor = zlib.decompressobj()
    content = decompressor.decompress(payload, MAX_VARIABLE_SIZE)
    if not decompressor.eof:
        raise ValueError("a compressed variable is truncated, or too large")
    return content


def _variable(matrix: bytes, order: str, depth: int = 0) -> dict[str, Any]:
    """Name and value of a matrix; empty for unsupported types."""
    if depth > 0 and not matrix:
        return {"": np.empty((0, 0))}  # MATLAB's empty cell
    elements = _elements(matrix, order)
    parts = [next(elements, (0, b"")) for _ in range(3)]
    if len(parts[0][1]) != 8 or len(parts[1][1]) < 8:
        raise ValueError("a variable without a shape")
    kind = int(np.frombuffer(parts[0][1], f"{order}u4")[0]) & 0xFF
    shape = tuple(np.frombuffer(parts[1][1][: len(parts[1][1]) // 4 * 4], f"{order}i4").tolist())
    name = parts[2][1].decode("ascii", "replace")
    if min(shape) < 0:
        raise ValueError("a variable of negative size")
    if kind == _CELL and depth < MAX_DEPTH:
        cells = [_variable(cell, order, depth + 1) for _, cell in elements]
        if len(cells) != prod(shape) or not all(cells):
            raise ValueError(f"{name} does not have the cells of its shape")
        held = [value for cell in cells for value in cell.values()]
        if min(shape) > 1 and len(shape) == 2:
            return {name: [held[row :: shape[0]] for row in range(shape[0])]}
        return {name: held}
    if kind == _STRUCT and depth < MAX_DEPTH:
        structs = _structs(elements, order, prod(shape), depth)
        return {name: structs[0] if len(structs) == 1 else structs}
    if kind not in (*_NUMERIC, _CHAR):
        return {}
    stored, content = next(elements, (0, b""))
    if stored not in (_TEXT if kind == _CHAR else _TYPES) and prod(shape) > 0:
        raise ValueError(f"{name} holds no numbers")
    if kind == _CHAR:
        text = content.decode(_TEXT.get(stored, "latin-1"), "replace")
        rows = shape[0] if len(shape) == 2 and len(text) == prod(shape) else 1
        return {name: _text([text[row::rows] for row in range(rows)])}
    values = np.frombuffer(content, order + _TYPES.get(stored, "u1"))
    return {name: values.astype(np.float64).reshape(shape, order="F")}


def _text(rows: list[str]) -> str | list[str]:
    """A text, or the texts of a matrix of several rows, which MATLAB pads with blanks."""
    texts = [row.replace("\0", "") for row in rows]
    return "".join(texts) if len(rows) < 2 else [text.rstrip() for text in texts]


def _structs(
    elements: Iterator[tuple[int, bytes]], order: str, count: int, depth: int
) -> list[dict[str, Any]]:
    """The fields of each struct by name; fields of unsupported types are dropped."""
    (_, width), (_, packed) = (next(elements, (0, b"")) for _ in range(2))
    if len(width) != 4 or (size := int(np.frombuffer(width, f"{order}i4")[0])) < 1:
        raise ValueError("a struct without names")
    ends = range(0, len(packed), size)
    names = [packed[at : at + size].split(b"\0")[0].decode("ascii", "replace") for at in ends]
    values = [_variable(matrix, order, depth + 1) for _, matrix in elements]
    if len(values) != count * len(names):
        raise ValueError("a struct array does not have the fields of its shape")
    rows = (values[at : at + len(names)] for at in range(0, len(values), max(len(names), 1)))
    return [
        {name: value for name, field in zip(names, row, strict=True) for value in field.values()}
        for row in rows
    ]
