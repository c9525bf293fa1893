"""How many workers this machine has room for."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from saccade.batch.reading import read_content
from saccade.batch.sources import Source
from saccade.errors import SaccadeError

BASE = 300 << 20
"""Bytes of a worker with its libraries."""
TO_A_PIXEL = 120
"""Bytes that the hungriest of the algorithms takes."""
UNKNOWN = 12_000_000
"""Pixels of an image whose header says nothing."""


def workers_for(source: Source) -> int:
    """One to a core, but no more than memory has room for.

    Args:
        source: the largest of its first, middle and last image counts.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    if len(source) == 1 or cores == 1:
        return 1
    pixels = max(_pixels(source, number) for number in (0, len(source) // 2, len(source) - 1))
    room = available_memory()
    fit = max(room // (BASE + TO_A_PIXEL * pixels), 1) if room else cores or 1
    return max(min(cores or 1, fit, len(source)), 1)


def available_memory() -> int:
    """Bytes that this process and its children may still take; 0 where that is not known."""
    found = []
    with suppress(OSError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        found.append(1024 * next(int(e.split()[1]) for e in lines if e.startswith("MemAvailable")))
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        limit = int((group / "memory.max").read_text())
        found.append(max(limit - int((group / "memory.current").read_text()), 0))
    return min(found, default=0)


def _pixels(source: Source, number: int) -> int:
    """Of an image, by its header."""
    from saccade.image import size_in_header

    item = source[number]
    if item.start >= 0 and item.size < 0:  # a frame
        return UNKNOWN
    try:
        content: Any = read_content(item)
        width, height = size_in_header(content, item.name)
        return width * height
    except SaccadeError:
        return UNKNOWN
