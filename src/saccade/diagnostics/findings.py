"""What is wrong with a drive, in words and numbers."""

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from saccade.types import IntArray

Severity: TypeAlias = Literal["error", "warning", "note"]
"""An "error" spoils a run; a "warning" makes it worse; a "note" is good to know, and no trap."""
LISTED = 6
"""Frames that are named in words; the others are counted."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong."""

    severity: Severity
    """How bad it is."""
    check: str
    """Which check found it: a short name."""
    what: str
    """One sentence with the number in it."""
    advice: str
    """What to do."""
    value: float
    """The number."""
    unit: str
    """Of the number."""
    frames: tuple[int, ...] = ()
    """Where, if it is not everywhere."""

    def __str__(self) -> str:
        where = f" ({listed(self.frames)})" if self.frames else ""
        return f"{self.what[:1].upper()}{self.what[1:]}{where}. {self.advice}."


@dataclass(frozen=True)
class CheckReport:
    """What was found, and what was measured on the way."""

    name: str
    """Of the drive."""
    frames: int
    """How many it has."""
    inspected: int
    """How many of them were looked at."""
    findings: tuple[Finding, ...]
    """The worst first."""
    figures: dict[str, Any] = field(default_factory=dict)
    """What was measured, by name; a unit at the end of each."""

    @property
    def clean(self) -> bool:
        """Whether nothing but notes was found."""
        return all(finding.severity == "note" for finding in self.findings)

    def __repr__(self) -> str:
        return f"CheckReport({self.name}: {len(self.findings)} findings)"


def numbers_of(frames: IntArray) -> tuple[int, ...]:
    """Frames of an array (k,) as a finding has them."""
    return tuple(int(i) for i in frames)


def listed(frames: tuple[int, ...]) -> str:
    """Frames in words, the first few of them."""
    first = ", ".join(map(str, frames[:LISTED]))
    more = f", ... {len(frames)} in all" if len(frames) > LISTED else ""
    return f"frame{'s' if len(frames) > 1 else ''} {first}{more}"


def counted(n: int, one: str, several: str) -> str:
    """A number and what it counts: "1 frame is", "2 frames are"."""
    return f"{n} {one if n == 1 else several}"
