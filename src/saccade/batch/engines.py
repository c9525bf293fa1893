"""What runs the shards: this process, processes on this machine, or a cluster.

We write no engine: the processes are those of `concurrent.futures`, the cluster is Dask's.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from typing import Any, Protocol, TypeAlias

from saccade.batch.forkserver import begin_loading
from saccade.batch.shards import Shard, ShardReport

Work: TypeAlias = Callable[[Shard], ShardReport]
PREFETCH = 2
"""Shards that wait for each worker: it need not wait for the one that hands them out."""
DIED = "the process that worked on it died; was there enough memory?"


class Engine(Protocol):
    """Runs shards in any order, some at a time."""

    @property
    def workers(self) -> int:
        """How many work at a time."""

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """The report of every shard; takes a new one only when there is room for it."""


class InProcess:
    """One after the other, in this process."""

    workers = 1

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`."""
        import cv2

        threads = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            yield from map(work, shards)
        finally:
            cv2.setNumThreads(threads)


class Processes:
    """Processes on this machine.

    Args:
        workers: how many.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`. A shard that kills its process is tried once more, alone."""
        pool = _start(self.workers)
        try:
            running: dict[Future[ShardReport], Shard] = {}
            suspects: list[Shard] = []
            more = True
            while more or running:
                while more and not suspects and len(running) < PREFETCH * self.workers:
                    shard = next(shards, None)
                    more = shard is not None
                    if shard is not None:
                        running[pool.submit(work, shard)] = shard
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    shard = running.pop(future)
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        suspects.append(shard)
                if suspects and not running:
                    pool.shutdown()
                    yield from _one_by_one(work, suspects)
                    suspects.clear()
                    pool = _start(self.workers) if more else pool
        finally:
            pool.shutdown(cancel_futures=True)


class Cluster:
    """The workers of a Dask cluster, which see the same files.

    Args:
        client: a `distributed.Client`.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    @property
    def workers(self) -> int:
        """Threads of all workers now; they may come and go."""
        return sum(self._client.nthreads().values())

    def run(self, work: Work, shards: Iterator[Shard]) -> Iterator[ShardReport]:
        """See `Engine`. What a worker had begun that went away is done by another."""
        distributed: Any = import_module("distributed")

        waiting: dict[Any, Shard] = {}
        completed = distributed.as_completed(loop=self._client.loop)
        more = True
        while more or waiting:
            while more and len(waiting) < PREFETCH * max(self.workers, 1):
                shard = next(shards, None)
                more = shard is not None
                if shard is not None:
                    future = self._client.submit(work, shard, pure=False)
                    waiting[future.key] = shard
                    completed.add(future)
            if waiting:
                future = next(completed)
                shard = waiting.pop(future.key)
                failure = future.exception()
                yield future.result() if failure is None else lost(shard, str(failure))


def lost(shard: Shard, why: str) -> ShardReport:
    """The report of a shard of which nothing came."""
    return ShardReport(lost=[(item.name, why) for item in shard.items])


def _one_by_one(work: Work, shards: list[Shard]) -> Iterator[ShardReport]:
    for shard in shards:
        with _start(1) as pool:
            try:
                yield pool.submit(work, shard).result()
            except BrokenProcessPool:
                yield lost(shard, DIED)


def _start(workers: int) -> ProcessPoolExecutor:
    """Processes that are forked from one which has the libraries loaded, where that is possible."""
    return ProcessPoolExecutor(workers, begin_loading(), initializer=_prepare)


def _prepare() -> None:
    """In a worker: leave Ctrl-C to the parent, and do not outlive it."""
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)
