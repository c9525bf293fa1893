"""Engines that run shards: this process, processes on this machine, or a Dask cluster.

Where the system has forkservers, worker processes are forked from one that imports their libraries
once, while the main process does so too: import nothing heavy here. Number of threads and signals
are set in worker processes only.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager, suppress
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

from saccade.errors import ConfigError, SaccadeError
from saccade.extras import import_optional

if TYPE_CHECKING:
    from saccade.batch.sources import Item, Source

QUEUED = 2
"""Shards submitted per worker, so that none waits for the main process."""
DIED = "the process that worked on it died; was there enough memory?"
FORKSERVER = "forkserver"
WORKER_MEMORY = 300 << 20
"""Bytes of a worker with its libraries."""
BYTES_PER_PIXEL = 120
"""Peak memory of the most demanding algorithm."""
DEFAULT_PIXELS = 12_000_000
"""Assumed of an image whose header does not tell."""
TIMEOUT = 20.0
"""Seconds in which a scheduler must answer."""


class Shard(NamedTuple):
    """Images, or pairs of images, whose results share a file: the work of one worker at a time."""

    name: str
    """Made of the names of its items, and of the generation."""
    items: Sequence[Any]
    """Each has a `name`."""
    inputs: Sequence[str] = ()
    """Records that it reads: of its previous generation, or of the images of pairs."""


class ShardReport(NamedTuple):
    """Counts of a shard that was processed."""

    done: int = 0
    """Items processed, without those that failed."""
    unchanged: int = 0
    """Items done before, likewise."""
    failed: int = 0
    """Images that failed, now or before."""
    lost: Sequence[tuple[str, str]] = ()
    """Items whose results could not be written, and why."""

    @classmethod
    def of_lost(cls, items: Sequence[Any], reason: str) -> "ShardReport":
        """The report of items without results."""
        return cls(lost=[(item.name, reason) for item in items])


Work: TypeAlias = Callable[[Shard], ShardReport]


class Engine(Protocol):
    """Runs shards in any order, several at a time."""

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """The report of every shard; takes the next shard only when a worker is free for it."""


class InProcess:
    """One shard after the other, in this process.

    While a shard is processed OpenCV uses one thread; its setting is restored after each.
    """

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`."""
        import cv2

        for shard in shards:
            threads = cv2.getNumThreads()
            cv2.setNumThreads(1)
            try:
                report = work(shard)
            finally:
                cv2.setNumThreads(threads)
            yield report


class Processes:
    """Processes on this machine.

    Args:
        workers: how many.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`. A shard that kills its process is retried once, alone."""
        suspects: list[Shard] | None = None
        while suspects is None or suspects:
            suspects = []
            pool = _start_pool(self._workers)
            try:
                for shard, future in _run_on(pool, work, shards, lambda: self._workers):
                    try:
                        yield future.result()
                    except BrokenExecutor:
                        suspects.append(shard)
            finally:
                pool.shutdown(cancel_futures=True)
            for shard in suspects:
                with _start_pool(1) as pool:
                    try:
                        yield pool.submit(work, shard).result()
                    except BrokenExecutor:
                        yield ShardReport.of_lost(shard.items, DIED)


class DaskEngine:
    """Runs shards on the workers of a Dask cluster, which must see the same files.

    Args:
        client: a `distributed.Client`.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`. Dask reruns the shards of a worker that died on another."""
        executor = self._client.get_executor(pure=False)
        for shard, future in _run_on(executor, work, shards, self._count_threads):
            failure = future.exception()
            lost = ShardReport.of_lost(shard.items, str(failure))
            yield future.result() if failure is None else lost

    def _count_threads(self) -> int:
        """Number of threads of all workers, which may come and go."""
        return sum(self._client.nthreads().values())


@contextmanager
def connect(address: str) -> Iterator[DaskEngine]:
    """The workers of a running scheduler.

    Args:
        address: such as tcp://host:8786.

    Raises:
        ConfigError: Dask is not installed, or no scheduler answers.
    """
    distributed = import_optional("distributed", "cluster")
    try:
        client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(f"scheduler: expected one at {address}, found none: {error}") from error
    with client:
        yield DaskEngine(client)


def _run_on(
    executor: Executor, work: Work, shards: Iterator[Shard], count_workers: Callable[[], int]
) -> Iterator[tuple[Shard, "Future[ShardReport]"]]:
    """Run shards on an executor, and give each with its future when it is done.

    Takes a further shard when a worker is free, and none once the executor is broken.
    """
    running: dict[Future[ShardReport], Shard] = {}
    accepting = True
    while accepting or running:
        while accepting and len(running) < QUEUED * max(count_workers(), 1):
            shard = next(shards, None)
            accepting = shard is not None
            if shard is not None:
                running[_submit(executor, work, shard)] = shard
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            accepting = accepting and not isinstance(future.exception(), BrokenExecutor)
            yield running.pop(future), future


def _submit(executor: Executor, work: Work, shard: Shard) -> "Future[ShardReport]":
    """A future, which has failed where the executor is broken already."""
    try:
        return executor.submit(work, shard)
    except BrokenExecutor as error:
        future: Future[ShardReport] = Future()
        future.set_exception(error)
        return future


def _start_pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, worker_context(), initializer=_initialize_worker)


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


def _initialize_worker() -> None:
    """One thread, no Ctrl-C, and an exit when the parent does."""
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
    memory = _available_memory()
    if workers <= 1 or memory is None:
        return max(workers, 1)
    pixels = max(_pixels(source[number]) for number in (0, len(source) // 2, -1))
    return max(min(workers, memory // (WORKER_MEMORY + BYTES_PER_PIXEL * pixels)), 1)


def _available_memory() -> int | None:
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
    from saccade.io.image import read_header

    if item.frame is None:
        with suppress(SaccadeError):
            content: Any = read_content(item)
            width, height = read_header(content, item.name)[:2]
            return width * height
    return DEFAULT_PIXELS
