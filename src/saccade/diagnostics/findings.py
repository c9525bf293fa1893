"""Findings: defects of a drive, in words and numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np

from saccade.types import IntArray

Severity: TypeAlias = Literal["error", "warning", "note"]
"""An "error" spoils a run; a "warning" makes it worse; a "note" does no harm."""
MAX_LISTED = 6
"""Frames that are listed in words; the others are counted."""


@dataclass(frozen=True)
class Finding:
    """A defect of a drive."""

    severity: Severity
    """How bad it is."""
    check: str
    """Short name of the check that found it."""
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

    @classmethod
    def in_frames(
        cls,
        severity: Severity,
        check: str,
        what: str,
        advice: str,
        frames: IntArray | Sequence[int],
        unit: str = "frames",
    ) -> "Finding":
        """A defect of single frames, whose number is that of the frames."""
        numbers = tuple(np.asarray(frames).tolist())
        return cls(severity, check, what, advice, float(len(numbers)), unit, numbers)

    def __str__(self) -> str:
        frames = f" ({listed(self.frames)})" if self.frames else ""
        return f"{self.what[:1].upper()}{self.what[1:]}{frames}. {self.advice}."


@dataclass(frozen=True)
class CheckReport:
    """Findings and measurements of a drive."""

    name: str
    """Of the drive."""
    frames: int
    """How many it has."""
    inspected: int
    """How many of them were inspected."""
    findings: tuple[Finding, ...]
    """The worst first."""
    figures: dict[str, Any] = field(default_factory=dict)
    """Measurements by name, with the unit at its end."""

    @property
    def clean(self) -> bool:
        """Whether there are no findings but notes."""
        return all(finding.severity == "note" for finding in self.findings)

    def __repr__(self) -> str:
        return f"CheckReport({self.name}: {len(self.findings)} findings)"


def listed(frames: tuple[int, ...]) -> str:
    """The first few frames in words, and how many there are."""
    first = ", ".join(map(str, frames[:MAX_LISTED]))
    more = f", ... {len(frames)} in all" if len(frames) > MAX_LISTED else ""
    return f"frame{'s' if len(frames) > 1 else ''} {first}{more}"


def counted(n: int, one: str, several: str) -> str:
    """A number and what it counts: "1 frame is", "2 frames are"."""
    return f"{n} {one if n == 1 else several}"
