"""Engines that run shards: this process, or processes on this machine; see `cluster` for Dask."""

from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Protocol, TypeAlias

from saccade.batch.forkserver import initialize_worker, worker_context
from saccade.batch.shards import Shard, ShardReport

Work: TypeAlias = Callable[[Shard], ShardReport]
QUEUED = 2
"""Shards submitted per worker, so that none waits for the main process."""
DIED = "the process that worked on it died; was there enough memory?"


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
        for shard in shards:
            with _one_opencv_thread():
                report = work(shard)
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
        finished = False
        while not finished:
            suspects = []
            pool = _start_pool(self._workers)
            try:
                for shard, future in run_on(pool, work, shards, lambda: self._workers):
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        suspects.append(shard)
            finally:
                pool.shutdown(cancel_futures=True)
            yield from _run_alone(work, suspects)
            finished = not suspects


def run_on(
    executor: Executor, work: Work, shards: Iterator[Shard], workers: Callable[[], int]
) -> Iterator[tuple[Shard, Future[ShardReport]]]:
    """Run shards on an executor, and give each with its future when it is done.

    Takes no further shard once the executor is broken.

    Args:
        executor: runs the work.
        work: to do for a shard.
        shards: taken from only as workers become free.
        workers: current number of workers of the executor.
    """
    running: dict[Future[ShardReport], Shard] = {}
    accepting = True
    while accepting or running:
        while accepting and len(running) < QUEUED * max(workers(), 1):
            shard = next(shards, None)
            accepting = shard is not None
            if shard is not None:
                running[_submit(executor, work, shard)] = shard
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            accepting = accepting and not isinstance(future.exception(), BrokenExecutor)
            yield running.pop(future), future


def _submit(executor: Executor, work: Work, shard: Shard) -> Future[ShardReport]:
    """A future, which has failed where the executor is broken already."""
    try:
        return executor.submit(work, shard)
    except BrokenExecutor as error:
        future: Future[ShardReport] = Future()
        future.set_exception(error)
        return future


def lost_shard(shard: Shard, reason: str) -> ShardReport:
    """The report of a shard without results."""
    return ShardReport(lost=[(item.name, reason) for item in shard.items])


def _run_alone(work: Work, shards: list[Shard]) -> Iterator[ShardReport]:
    """Each shard in a process of its own."""
    for shard in shards:
        with _start_pool(1) as pool:
            try:
                yield pool.submit(work, shard).result()
            except BrokenProcessPool:
                yield lost_shard(shard, DIED)


def _start_pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, worker_context(), initializer=initialize_worker)


@contextmanager
def _one_opencv_thread() -> Iterator[None]:
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
