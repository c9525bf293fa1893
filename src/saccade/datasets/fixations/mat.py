"""Fixations in MATLAB files: structs, cells and matrices, identified by shape and name.

OSIE's `fixations.mat` is a cell array of image structs (`img`). Each has a cell array of subject
structs with the vectors `fix_x`, `fix_y` and `fix_duration`. SALICON has a file for each image,
with a struct `gaze` for each subject, whose `fixations` are a matrix (n, 2). MIT1003 and CAT2000
have a file for each image with a binary map of the fixated pixels.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from saccade.datasets.fixations.exports import (
    NO_BOX,
    ROLES,
    FixationList,
    RawFixations,
    is_named,
)
from saccade.datasets.matlab import read_variables
from saccade.errors import LogError, require

EXPECTED = (
    "structs or columns with x, y, image and subject, or cells {image, subject} of matrices (n, 2)"
)
VECTOR_ROLES = ("x", "y", "index", "time", "duration")
Rows = list[tuple[Any, ...]]
"""Rows of `RawFixations.of`."""


BINARY_NAME = re.compile(r"[_-]?fix(ation)?s?[_-]?(locs?|pts|points|maps?)?$", re.IGNORECASE)
"""End of the name of a file with a binary map, after the name of its image."""
SMALLEST_MAP = 32
"""Minimum side of a binary map of fixations."""
MOST_FIXATED = 0.05
"""Maximum fraction of the pixels that are fixated."""


def read_mat_fixations(
    path: Path, columns: Mapping[str, str] | None = None, name: str = ""
) -> FixationList:
    """The fixations of a MATLAB file.

    Positions are in vectors x and y with their usual names, or in the first two columns of
    matrices. Image and subject are fields with their usual names, or indices of nested cells or
    structs: images, then subjects. A cell of as many texts as images holds their names; without it,
    images are numbered from 1.

    Args:
        path: the file.
        columns: none; the names of fields are usual ones.
        name: name of the image if the file names none; by default the name of the file.

    Raises:
        LogError: the file is broken or has another layout; the message lists its variables.
    """
    require(not columns, "--columns", "none for a MATLAB file", columns)
    variables, name = read_variables(path), name or path.stem
    if rows := _of_gaze(variables, name):
        return FixationList(RawFixations.of(rows), "index", Counter())
    if rows := _of_binary_map(variables, BINARY_NAME.sub("", name) or name):
        return FixationList(RawFixations.of(rows), "none", Counter())
    fixations: Rows = []
    texts = [each for each in variables.values() if _is_texts(each)]
    try:
        shapes = {*_shapes(variables)}
        transposed = len({h for h, _ in shapes}) == 1 < len({w for _, w in shapes})
        _collect(_turned(variables) if transposed else variables, {}, texts, fixations)
    except ValueError as error:
        raise LogError(f"{path}: expected {EXPECTED}: {error}") from error
    if not fixations:
        found = ", ".join(f"{name} ({_described(each)})" for name, each in variables.items())
        raise LogError(f"{path}: expected {EXPECTED}, found {found[:300] or 'nothing'}")
    return FixationList(RawFixations.of(fixations), "index", Counter())


def _of_gaze(variables: Mapping[str, Any], name: str) -> Rows:
    """Rows of SALICON's layout; empty for another."""
    gaze, image = variables.get("gaze"), variables.get("image", name)
    subjects = gaze if isinstance(gaze, list) else [gaze]
    if not (isinstance(image, str) and all(isinstance(each, dict) for each in subjects)):
        return []
    rows: Rows = []
    for number, each in enumerate(subjects):
        xy = each.get("fixations", np.empty((0, 2)))
        if isinstance(xy, np.ndarray) and xy.ndim == 2 and xy.shape[1] == 2:
            rows += [
                (image.strip(), str(number), float(index), x, y, np.nan, NO_BOX, "", "")
                for index, (x, y) in enumerate(xy.tolist())
            ]
    return rows


def _of_binary_map(variables: Mapping[str, Any], name: str) -> Rows:
    """Rows of a single map of zeros and ones, which has no subjects; empty for another content."""
    maps = [each for each in variables.values() if isinstance(each, np.ndarray) and each.size > 1]
    if len(maps) != 1 or maps[0].ndim != 2 or min(maps[0].shape) < SMALLEST_MAP:
        return []
    fixated = maps[0] > 0
    is_binary = len(np.unique(maps[0])) == 2 and maps[0].min() == 0
    if not is_binary or fixated.mean() > MOST_FIXATED:
        return []
    return [
        (name, "0", float(index), float(x), float(y), np.nan, NO_BOX, "", "")
        for index, (y, x) in enumerate(np.argwhere(fixated).tolist())
    ]


def _collect(value: Any, known: Mapping[str, Any], texts: Sequence[list[str]], out: Rows) -> None:
    """Adds the fixations in a value; `known` has the values by role found so far."""
    if isinstance(value, dict):
        found = {
            role: field
            for role in ROLES
            for name, field in sorted(value.items(), key=lambda each: each[0] != role)[::-1]
            if is_named(role, name) and not _has_parts(field)
        }
        known = {**known, **found}
        if "x" in found and "y" in found:
            _add_vectors(known, out)
            return
        known = {role: each for role, each in known.items() if not _is_texts(each)}
        texts = [each for each in value.values() if _is_texts(each)] or texts
        for field in value.values():
            _collect(field, known, texts, out)
    elif isinstance(value, list) and not _is_texts(value):
        if value and all(isinstance(each, dict) for each in value):
            columns = _as_columns(value)
            if columns is not None:
                _collect(columns, known, texts, out)
                return
        names = [each for each in texts if len(each) == len(value)]
        of_images = "image" not in known
        inner = {len(each) for each in value if isinstance(each, list)}
        if of_images and not names and any(len(each) in inner for each in texts):
            of_images = False  # first assume subjects, then images
        role = "image" if of_images else "subject"
        for number, each in enumerate(value):
            name = names[0][number] if of_images and names else str(number + of_images)
            _collect(each, {**known, role: name, "trial": str(number)}, texts, out)
    elif isinstance(value, np.ndarray) and value.ndim == 2:
        heads = [each for each in texts if len(each) == value.shape[1]]
        if heads and any(is_named("x", name) for name in heads[0]):
            _collect(dict(zip(heads[0], value.T, strict=True)), known, (), out)
        elif {"image", "subject"} <= known.keys() and value.shape[1] > 1 and len(value):
            _add_vectors({**known, "x": value[:, 0], "y": value[:, 1]}, out)


def _shapes(value: Any) -> Iterator[tuple[int, int]]:
    """Shapes of all matrices in a value."""
    if isinstance(value, np.ndarray) and value.ndim == 2 and min(value.shape) > 1:
        yield value.shape[0], value.shape[1]
    elif isinstance(value, list | dict):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _shapes(each)


def _turned(value: Any) -> Any:
    """The value with all matrices transposed, for files with fixations as columns."""
    if isinstance(value, dict):
        return {name: _turned(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_turned(each) for each in value]
    return value.T if isinstance(value, np.ndarray) else value


def _add_vectors(known: Mapping[str, Any], out: Rows) -> None:
    """Adds the fixations of vectors x and y; other roles have one value, or one per fixation."""
    count = np.size(known["x"])

    def column(role: str, default: Any) -> list[Any]:
        value = known.get(role, default)
        if role not in VECTOR_ROLES and isinstance(value, np.ndarray):
            value = [f"{number:g}" for number in value.ravel().tolist()]
        elif isinstance(value, np.ndarray):
            value = value.ravel().tolist()
        values = value if isinstance(value, list) else [value]
        values = values * count if len(values) == 1 else values
        if len(values) != count:
            raise ValueError(f"{role} has {len(values)} values, and x {count}")
        return values

    for role in ("image", "subject"):
        if role not in known and not (role == "subject" and "trial" in known):
            raise ValueError(f"found no {role} of the fixations")
    order = known.get("index", known.get("time", np.arange(float(count))))
    role = "index" if "index" in known else "time"
    columns = (
        *(column("image", ""), column("subject", "0"), column(role, order), column("x", 0)),
        *(column("y", 0), column("duration", np.nan), [NO_BOX] * count, column("trial", "")),
        [""] * count,
    )
    out += zip(*columns, strict=True)


def _as_columns(structs: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Columns from structs that hold one fixation each; None for other structs."""
    columns: dict[str, Any] = {}
    for name in structs[0]:
        values = [each.get(name) for each in structs]
        if all(isinstance(each, np.ndarray) and each.size == 1 for each in values):
            columns[name] = np.array([each.item() for each in values if each is not None])
        elif all(isinstance(each, str) for each in values):
            columns[name] = values
    has_points = all(any(is_named(role, name) for name in columns) for role in ("x", "y"))
    return columns if has_points and len(structs) > 1 else None


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, str) for each in value)


def _has_parts(value: Any) -> bool:
    """Whether a value is nested: a struct, or a cell array that is not all text."""
    return isinstance(value, dict) or (isinstance(value, list) and not _is_texts(value))


def _described(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return " x ".join(map(str, value.shape))
    if isinstance(value, dict):
        return f"struct with {', '.join(value)}"
    return f"cell of {len(value)}" if isinstance(value, list) else "text"
