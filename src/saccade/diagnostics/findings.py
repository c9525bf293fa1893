"""Results of the checks of a drive."""

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from saccade.types import IntArray

Severity: TypeAlias = Literal["error", "warning", "note"]
"""An "error" makes the map unusable, a "warning" degrades it, a "note" is harmless."""
MAX_LISTED = 6
"""Maximum number of frame numbers listed in a message."""


@dataclass(frozen=True)
class Finding:
    """A defect of a drive."""

    severity: Severity
    check: str
    """Name of the check that found it."""
    what: str
    """The defect in one sentence, with its value."""
    advice: str
    """Advice to the user."""
    value: float
    """Size of the defect."""
    unit: str
    """Unit of the value."""
    frames: tuple[int, ...] = ()
    """Affected frames; empty if the defect concerns the whole drive."""

    @classmethod
    def in_frames(
        cls, severity: Severity, check: str, what: str, advice: str, frames: IntArray
    ) -> "Finding":
        """A defect of single frames; its value is the number of frames."""
        numbers = tuple(frames.tolist())
        return cls(severity, check, what, advice, float(len(numbers)), "frames", numbers)

    def __str__(self) -> str:
        first, n = ", ".join(map(str, self.frames[:MAX_LISTED])), len(self.frames)
        more = f", ... {n} in all" if n > MAX_LISTED else ""
        frames = f" (frame{'s' if n > 1 else ''} {first}{more})" if n else ""
        return f"{self.what[:1].upper()}{self.what[1:]}{frames}. {self.advice}."


@dataclass(frozen=True)
class CheckReport:
    """Findings and measurements of a drive."""

    name: str
    """Name of the drive."""
    frames: int
    """Number of frames of the drive."""
    inspected: int
    """Number of frames inspected."""
    findings: tuple[Finding, ...]
    """Findings, most severe first."""
    figures: dict[str, Any]
    """Measurements by name; the suffix of a name is the unit."""

    @property
    def clean(self) -> bool:
        """Whether there are neither errors nor warnings."""
        return all(finding.severity == "note" for finding in self.findings)

    def __repr__(self) -> str:
        return f"CheckReport({self.name}: {len(self.findings)} findings)"


def counted(n: int, one: str, several: str) -> str:
    """A number and its noun in singular or plural: "1 frame is", "2 frames are"."""
    return f"{n} {one if n == 1 else several}"
