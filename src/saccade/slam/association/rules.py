"""The table of association rules."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import numpy as np

from saccade.errors import LogError, require
from saccade.extras import import_function
from saccade.types import FloatArray, IntArray

Pairing: TypeAlias = Callable[[FloatArray], IntArray]
"""Pairs of observations and landmarks by squared Mahalanobis distances (m, c), which are infinite
outside the larger gate: (m,) the column of each row, -1 for none; no column twice."""


@dataclass(frozen=True)
class Rule:
    """A rule of data association."""

    name: str
    """Name in the settings."""
    summary: str
    """What it does, in the help of the command line."""
    pairing: Pairing
    """Pairs of a scan without labels; it also pairs observations whose label is rejected."""
    uses_labels: bool = False
    """Whether labels are used; else all observations are associated by geometry."""
    accepts_all: bool = False
    """Whether every label is accepted. Observations without a label are not used then."""
    may_branch: bool = False
    """Whether scans without labels have several hypotheses while the map is small."""

    @property
    def name_in_file(self) -> str:
        """Name in a map file; the name of an own rule is in no table."""
        return self.name if RULES.get(self.name) is self else f"own {self.name}"


def mutual_pairs(distance: FloatArray) -> IntArray:
    """(m,) column of each row that is mutually nearest to it, else -1; of ties, the first."""
    column = distance.argmin(1)
    mutual = distance.argmin(0)[column] == np.arange(len(distance))
    return np.where(mutual, column, -1)


def nearest_first(distance: FloatArray) -> IntArray:
    """(m,) column of each row, paired greedily with the smallest distance first, else -1."""
    paired, used = np.full(len(distance), -1), set[int]()
    order = np.argsort(distance, axis=None, kind="stable")
    for row, column in zip(*np.unravel_index(order, distance.shape), strict=True):
        if paired[row] < 0 and int(column) not in used:
            paired[row] = column
            used.add(int(column))
    return paired


def no_pairs(distance: FloatArray) -> IntArray:
    """(m,) -1: no observation is associated by geometry."""
    return np.full(len(distance), -1)


RULES: dict[str, Rule] = {
    rule.name: rule
    for rule in (
        Rule(
            "auto",
            "by labels that agree with the map, else by several hypotheses or mutually nearest",
            mutual_pairs,
            uses_labels=True,
            may_branch=True,
        ),
        Rule("known", "by trusted labels alone", no_pairs, uses_labels=True, accepts_all=True),
        Rule("nearest", "the nearest landmark, labels or not", nearest_first),
        Rule("mutual", "mutually nearest, labels or not", mutual_pairs),
        Rule(
            "hypotheses",
            "several hypotheses while the map is small, labels or not",
            mutual_pairs,
            may_branch=True,
        ),
    )
}
"""The rules by name."""


def rule_of(association: object) -> Rule:
    """The rule of a name, a `Rule` itself, or a rule by geometry alone with a `Pairing`.

    A `Pairing` is a function, or its name as module:function.

    Raises:
        ConfigError: an unknown name, or neither a name nor a function.
    """
    if isinstance(association, Rule):
        return association
    if callable(association):
        return Rule(_name_of(association), "an own function", _checked(association))
    if isinstance(association, str) and ":" in association:
        return _imported(association)
    known = isinstance(association, str) and association in RULES
    require(known, "association", f"{', '.join(RULES)}, or a function", association)
    return RULES[str(association)]


@cache
def _imported(name: str) -> Rule:
    """The rule of the function at module:function."""
    return rule_of(import_function("association", name))


def _name_of(function: Pairing) -> str:
    return getattr(function, "__qualname__", type(function).__name__)


def _checked(pairing: Pairing) -> Pairing:
    """An own pairing, whose results are checked."""

    def checked(distance: FloatArray) -> IntArray:
        paired = np.asarray(pairing(distance))
        used, (m, c) = paired[paired >= 0], distance.shape
        valid = paired.shape == (m,) and np.issubdtype(paired.dtype, np.integer)
        if not valid or len(np.unique(used)) < len(used) or not (used < c).all():
            raise LogError(
                f"association: {_name_of(pairing)}: expected ({m},) different columns below {c}, "
                f"or -1, found {paired}"
            )
        return paired.astype(np.int64)

    return checked
