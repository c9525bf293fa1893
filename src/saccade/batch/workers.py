"""How many worker processes this machine has cores and memory for."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from saccade.batch.items import read_content
from saccade.batch.sources import Source
from saccade.errors import SaccadeError

WORKER_MEMORY = 300 << 20
"""Bytes of a worker with its libraries."""
BYTES_PER_PIXEL = 120
"""Peak memory of the most demanding algorithm."""
DEFAULT_PIXELS = 12_000_000
"""Assumed of an image whose header does not tell."""


def count_workers(source: Source) -> int:
    """One worker per core, but no more than fit into memory.

    Args:
        source: the largest of its first, middle and last image counts.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    workers = min(cores or 1, len(source))
    if workers <= 1:
        return 1
    memory = available_memory()
    if memory is None:
        return workers
    pixels = max(_pixels(source, number) for number in (0, len(source) // 2, len(source) - 1))
    return max(min(workers, memory // (WORKER_MEMORY + BYTES_PER_PIXEL * pixels)), 1)


def available_memory() -> int | None:
    """Bytes that this process and its children may still allocate; None where unknown."""
    limits = []
    with suppress(OSError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        limits.append(1024 * next(int(s.split()[1]) for s in lines if s.startswith("MemAvailable")))
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        limit = int((group / "memory.max").read_text())
        limits.append(max(limit - int((group / "memory.current").read_text()), 0))
    return min(limits, default=None)


def _pixels(source: Source, number: int) -> int:
    """Pixels of an image, from its header."""
    from saccade.image import size_in_header

    item = source[number]
    if item.frame is not None:
        return DEFAULT_PIXELS
    try:
        content: Any = read_content(item)
        width, height = size_in_header(content, item.name)
        return width * height
    except SaccadeError:
        return DEFAULT_PIXELS
