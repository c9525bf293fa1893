"""Worker processes: how many there is room for, and how they start.

Where the system has forkservers, workers are forked from a process that imports their libraries
once, while the main process does so too: import nothing heavy here. Number of threads and signals
are set in worker processes only.
"""

import multiprocessing
import os
import signal
import threading
from contextlib import suppress
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade.batch.sources import Item, Source

FORKSERVER = "forkserver"
WORKER_MEMORY = 300 << 20
"""Bytes of a worker with its libraries."""
BYTES_PER_PIXEL = 120
"""Peak memory of the most demanding algorithm."""
DEFAULT_PIXELS = 12_000_000
"""Assumed of an image whose header does not tell."""


def worker_context(*modules: str) -> BaseContext:
    """The context that starts workers; begins to load their libraries.

    Args:
        modules: to import besides, such as the one that the program was started with.
    """
    if FORKSERVER not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    from multiprocessing import forkserver

    context = multiprocessing.get_context(FORKSERVER)
    context.set_forkserver_preload(["saccade.batch.preload", *modules])
    forkserver.ensure_running()
    return context


def limit_blas_threads() -> None:
    """Let BLAS use one thread in this worker: there is a process for every core.

    Takes effect if NumPy is not loaded yet.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def initialize_worker() -> None:
    """Initializer of a worker: one thread, no Ctrl-C, and it exits when its parent does."""
    limit_blas_threads()
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()


def _exit_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


def count_workers(source: "Source") -> int:
    """One worker per core, but no more than fit into memory.

    Args:
        source: the largest of its first, middle and last image counts.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    workers = min(cores or 1, len(source))
    memory = available_memory()
    if workers <= 1 or memory is None:
        return max(workers, 1)
    pixels = max(_pixels(source[number]) for number in (0, len(source) // 2, -1))
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


def _pixels(item: "Item") -> int:
    """Pixels of an image, from its header."""
    from saccade.batch.sources import read_content
    from saccade.errors import SaccadeError
    from saccade.io.image import size_in_header

    if item.frame is not None:
        return DEFAULT_PIXELS
    try:
        content: Any = read_content(item)
        width, height = size_in_header(content, item.name)
        return width * height
    except SaccadeError:
        return DEFAULT_PIXELS
