"""Workers: processes on this machine, or a Dask cluster.

Number of threads and signals are set in worker processes only.
"""

import logging
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from contextlib import contextmanager, suppress
from itertools import takewhile
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TypeAlias, TypeVar

from saccade.errors import ConfigError, printable
from saccade.extras import import_optional

DIED = "the worker process died, perhaps for lack of memory"
"""Reason for a block without a report."""
WORKER_MEMORY = 1_800_000_000
"""Bytes of a worker that analyzes images of 12 megapixels."""
SCHEDULER_TIMEOUT = 20.0
"""Seconds in which a scheduler must answer."""

Block = TypeVar("Block")
Report = TypeVar("Report")


def run_blocks(
    work: Callable[[Block], Report],
    blocks: Sequence[Block],
    *,
    workers: int = 1,
    scheduler: str | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[Block, Report | None]]:
    """Every block with its report, as soon as it is done; None where its process has died.

    Args:
        work: processes a block; may run in any process on any machine.
        blocks: the blocks.
        workers: number of processes; with 1 the work is done in this process.
        scheduler: address of a Dask scheduler, whose workers are used.
        should_stop: called before or after every block; true ends the run after the blocks that
            have begun.
    """
    if not blocks or (scheduler is None and workers == 1):
        yield from (
            (block, work(block)) for block in takewhile(lambda _: not should_stop(), blocks)
        )
        return
    start = _processes(min(workers, len(blocks))) if scheduler is None else _cluster(scheduler)
    with start as (submit, deaths):
        block_of = {submit(work, block): block for block in blocks}
        for future in as_completed(block_of):
            if should_stop():
                for each in block_of:
                    each.cancel()
            if future.cancelled():
                continue
            try:
                yield block_of[future], future.result()
            except deaths:
                yield block_of[future], None


Workers: TypeAlias = tuple[Callable[..., "Future[Any]"], type[Exception]]
"""A function that submits work for a block, and the exception raised where its process died."""


@contextmanager
def _cluster(address: str) -> Iterator[Workers]:
    """The workers of a Dask cluster, which reruns the blocks of a worker that died."""
    distributed = import_optional("distributed", "cluster")
    try:
        client = distributed.Client(address, timeout=SCHEDULER_TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(f"scheduler: expected one at {address}, found none: {error}") from error
    with client:
        yield client.get_executor(pure=False).submit, distributed.KilledWorker


@contextmanager
def _processes(count: int) -> Iterator[Workers]:
    """Threads on this machine, each with a process of its own: one that dies fails one block.

    The processes end when the other end of their pipe is closed: at the end of the block, or of
    this process however it ends.
    """
    context = multiprocessing.get_context("spawn")
    lifeline, held = context.Pipe(duplex=False)
    pools: SimpleQueue[ProcessPoolExecutor] = SimpleQueue()

    def new_pool() -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, context, _initialize_worker, (lifeline,))

    def run(work: Callable[[Any], Any], block: Any) -> Any:
        pool = pools.get()
        try:
            return pool.submit(work, block).result()
        except BrokenExecutor:
            pool = new_pool()
            raise
        finally:
            pools.put(pool)

    for _ in range(count):
        pools.put(new_pool())
    threads = ThreadPoolExecutor(count)
    try:
        yield lambda work, block: threads.submit(run, work, block), BrokenExecutor
    finally:
        threads.shutdown(wait=False, cancel_futures=True)
        held.close()
        threads.shutdown()


def _initialize_worker(lifeline: Connection) -> None:
    """One thread, messages as the command prints them, no Ctrl-C, and an exit with the parent."""
    import cv2  # slow to import
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)  # of NumPy's BLAS
    cv2.setNumThreads(1)
    warnings.showwarning = _print_warning
    logging.basicConfig(format="saccade: %(message)s", stream=sys.stderr)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_after, args=(lifeline,), daemon=True).start()


def _print_warning(
    message: Warning | str, category: type[Warning], *place: Any, **kwargs: Any
) -> None:
    """Prints a warning as the command does, in one line."""
    print(f"saccade: {printable(str(message))}", file=sys.stderr)


def _exit_after(lifeline: Connection) -> None:
    with suppress(EOFError, OSError):
        lifeline.recv()
    os._exit(1)


def count_workers(count: int) -> int:
    """One worker for every core, but no more than fit into memory or than there are images."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    limits = [cores or 1, count]
    with suppress(OSError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        free = next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
        limits.append(1024 * free // WORKER_MEMORY)
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        limit, used = (int((group / f"memory.{name}").read_text()) for name in ("max", "current"))
        limits.append((limit - used) // WORKER_MEMORY)
    return max(min(limits), 1)
