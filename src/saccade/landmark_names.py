"""Names of landmarks: numbers where they are computed with, text where people read them.

A name that is an integer below `FIRST_TEXT` is its own number, also where it is written as 3.0, as
pandas does in columns with empty cells. Any other name is text, as tags have it; its number is
`FIRST_TEXT` plus its index in a table of such names. A landmark without a name is -1.
"""

import re
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError

Label: TypeAlias = int | str
"""Label that a sensor reads from a landmark: a nonnegative integer, or text."""
FIRST_TEXT = 10**18
"""Number of the first name that is text; integers are below."""
UNKNOWN = ("", "-1")
"""Text of a landmark without a name."""
EXPECTED = "names of landmarks (text, or integers from 0 on; empty or -1 where unknown)"
"""Input of `number_names`, for messages."""
_WHOLE = re.compile(r"(-?\d{1,19})(\.0*)?", re.ASCII)
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
    if values.dtype.kind == "i" and (table or values.max(initial=0) < FIRST_TEXT):
        wrong = (values < -1) | (values >= FIRST_TEXT + len(table))
        if wrong.any():
            raise LogError(f"{name}: expected {EXPECTED}, found {values[wrong][0]}")
        return values.astype(np.int64, copy=False), table
    return number_labels(parse_labels(values, name=name), table)


def number_labels(
    labels: list[Label | None], table: tuple[str, ...] = ()
) -> tuple[npt.NDArray[np.int64], tuple[str, ...]]:
    """Numbers (k,) of valid labels, and the table with the new ones at its end."""
    known = {text: FIRST_TEXT + i for i, text in enumerate(table)}
    numbers = []
    for label in labels:
        if isinstance(label, str):
            label = known.setdefault(label, FIRST_TEXT + len(known))
        numbers.append(-1 if label is None else label)
    return np.array(numbers, np.int64), tuple(known)


def parse_labels(labels: npt.ArrayLike, *, name: str = "labels") -> list[Label | None]:
    """Labels (k,) as integers or text, None where unknown; see `number_names`.

    Raises:
        LogError: something else is among them, such as a number with a fraction.
    """
    values = labels if isinstance(labels, np.ndarray) else np.array(labels, object)
    if values.ndim != 1:
        raise LogError(f"{name}: expected a list of names, found shape {values.shape}")
    if values.dtype.kind == "i" and not ((values < -1) | (values >= FIRST_TEXT)).any():
        return [None if value < 0 else value for value in values.tolist()]
    found: list[Label | None] = []
    for value in values.tolist():
        label = parse_name(value)
        if label is None:
            raise LogError(f"{name}: expected {EXPECTED}, found {value!r}")
        found.append(None if label == -1 else label)
    return found


def labels_of(numbers: npt.NDArray[np.int64], table: tuple[str, ...]) -> list[Label | None]:
    """Labels (k,) of numbers (k,), None where unknown."""
    return [
        None if n < 0 else n if n < FIRST_TEXT else table[n - FIRST_TEXT] for n in numbers.tolist()
    ]


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
        whole = _WHOLE.fullmatch(text)
        value = int(whole[1]) if whole else None
    elif isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int | np.integer) or not -1 <= value < 1 << 63:
        return None
    return int(value) if value < FIRST_TEXT else str(value)


def name_texts(numbers: npt.NDArray[np.int64], table: tuple[str, ...]) -> npt.NDArray[Any]:
    """Names (k,) of numbers (k,) as they are written: the numbers themselves if none is text.

    Else an array of text, empty where a name is unknown.
    """
    if not table:
        return numbers
    texts = ["" if label is None else str(label) for label in labels_of(numbers, table)]
    return np.array(texts, object)


def label_array(labels: list[Label | None]) -> npt.NDArray[Any]:
    """Labels (k,) as integers, -1 where unknown; if one is text, all as text, "" where unknown."""
    if any(isinstance(label, str) for label in labels):
        return np.array(["" if label is None else str(label) for label in labels], object)
    return np.array([-1 if label is None else label for label in labels], np.int64)


_TAG = re.compile(r"(?:(.+):)?0*(\d{1,15})", re.ASCII)
"""A tag: optionally its family and a colon, then its number."""


class TagSpelling:
    """Spellings of the tags of a map: `5`, `05` and `FAMILY:5` are one tag of one family.

    If several families are in use, or two labels of the map have one number, labels stay as they
    are.

    Args:
        labels: labels of the map.
    """

    def __init__(self, labels: Iterable[Label]) -> None:
        self._known = frozenset(labels)
        tags = [(label, *_tag(label)) for label in self._known]
        families = {family for _, family, number in tags if number is not None and family}
        self._family = next(iter(families), "")
        self._by_number = {number: label for label, _, number in tags if number is not None}
        numbers = sum(number is not None for _, _, number in tags)
        if len(families) > 1 or len(self._by_number) < numbers:
            self._by_number = {}

    def resolve(self, labels: Sequence[Label | None]) -> list[Label | None]:
        """Labels (k,) as the map spells them; labels that it does not have are unchanged."""
        return [
            each if each is None or each in self._known or not self._by_number else self._find(each)
            for each in labels
        ]

    def _find(self, label: Label) -> Label:
        family, number = _tag(label)
        if number is None or (family and self._family and family != self._family):
            return label
        self._family = self._family or family
        return self._by_number.get(number, label)


def _tag(label: Label) -> tuple[str, int | None]:
    """Family, empty if unknown, and number of a tag; None if the label has no such form."""
    found = _TAG.fullmatch(str(label))
    return ("", None) if found is None else (found[1] or "", int(found[2]))
