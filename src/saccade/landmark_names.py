"""Names of landmarks: numbers where they are computed with, text where people read them.

A name that is an integer is its own number. Any other name is text, as tags have it; its number is
`FIRST_TEXT` plus its place in a table of such names. A landmark without a name is -1.
"""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError

FIRST_TEXT = 10**18
"""Number of the first name that is text; integers are below."""
UNKNOWN = ("", "-1")
"""Text of a landmark without a name."""
EXPECTED = "names of landmarks (text, or integers from 0 on; empty or -1 where unknown)"
"""Input of `number_names`, for messages."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)|nan", re.ASCII | re.IGNORECASE)


def number_names(
    names: npt.ArrayLike, table: tuple[str, ...] = (), *, name: str = "names"
) -> tuple[npt.NDArray[np.int64], tuple[str, ...]]:
    """Numbers of landmark names.

    Args:
        names: (k,) integers from 0 on, or text, or both; -1, an empty text or None where unknown.
        table: names that are text and already have numbers.
        name: of the argument, for messages.

    Returns:
        (k,) numbers, and the table with the new names at its end.

    Raises:
        LogError: something else is among them, such as a number with a fraction.
    """
    values = names if isinstance(names, np.ndarray) else np.array(names, object)
    if values.ndim != 1:
        raise LogError(f"{name}: expected a list of names, found shape {values.shape}")
    if values.dtype.kind == "i":
        wrong = (values < -1) | (values >= FIRST_TEXT + len(table))
        if wrong.any():
            raise LogError(f"{name}: expected {EXPECTED}, found {values[wrong][0]}")
        return values.astype(np.int64, copy=False), table
    known = {text: FIRST_TEXT + i for i, text in enumerate(table)}
    numbers = []
    for value in values.tolist():
        number = parse_name(value)
        if number is None:
            raise LogError(f"{name}: expected {EXPECTED}, found {value!r}")
        if isinstance(number, str):
            number = known.setdefault(number, FIRST_TEXT + len(known))
        numbers.append(number)
    return np.array(numbers, np.int64), tuple(known)


def parse_name(value: Any) -> int | str | None:
    """A name as an integer if it is one, -1 for none, else as text; None if it is no name."""
    if value is None:
        return -1
    if isinstance(value, str):
        text = value.strip()
        if text in UNKNOWN:
            return -1
        if text.isdecimal() and text.startswith("0") and text != "0":
            return text  # 007 need not be 7
        if not _NUMBER.fullmatch(text):
            return text if text.isprintable() else None
        value = int(text) if text.isdecimal() else None
    elif isinstance(value, float) and value.is_integer():
        value = int(value)
    is_number = isinstance(value, int | np.integer) and -1 <= value < FIRST_TEXT
    return int(value) if is_number else None


def renumber(
    numbers: npt.NDArray[np.int64], table: tuple[str, ...], other: tuple[str, ...]
) -> tuple[npt.NDArray[np.int64], tuple[str, ...]]:
    """Numbers (k,) of names by another table, and that table with the new names at its end."""
    if not table:
        return numbers, other
    of_text, other = number_names(table, other)
    text = np.maximum(numbers - FIRST_TEXT, 0)
    return np.where(numbers >= FIRST_TEXT, of_text[text], numbers), other


def stored_texts(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[str, ...]:
    """The table of a state that was stored as arrays; empty if it has none."""
    return tuple(arrays["text_names"].tolist()) if "text_names" in arrays else ()


def name_texts(numbers: npt.NDArray[np.int64], table: tuple[str, ...]) -> npt.NDArray[Any]:
    """Names (k,) of numbers (k,) as they are written: the numbers themselves if none is text.

    Else an array of text, empty where a name is unknown.
    """
    if not table:
        return numbers
    texts = [
        "" if n < 0 else str(n) if n < FIRST_TEXT else table[n - FIRST_TEXT]
        for n in numbers.tolist()
    ]
    return np.array(texts, object)
