"""Threads and reusable memory of a computation."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from math import prod
from typing import TypeAlias

import numpy as np

from saccade.errors import require
from saccade.threads import SERIAL_OPENCV
from saccade.types import Float32Array

Memory: TypeAlias = dict[tuple[str, int], Float32Array]


class Workspace:
    """Threads of a computation, and memory that the next computation reuses.

    Allocation would take a third of the time of a scale space. An array is valid until the next
    computation in the same memory.

    Args:
        executor: thread pool; None for the caller's thread alone.
        threads: number of threads.
        memory: arrays of an earlier computation.
    """

    def __init__(
        self,
        executor: ThreadPoolExecutor | None = None,
        threads: int = 1,
        memory: Memory | None = None,
    ) -> None:
        self._executor = executor
        self.threads = threads
        self._memory: Memory = {} if memory is None else memory

    def array(self, name: str, number: int, shape: tuple[int, ...]) -> Float32Array:
        """An uninitialized array in the memory with this name and number."""
        size = prod(shape)
        memory = self._memory.get((name, number))
        if memory is None or memory.size < size:
            memory = self._memory[name, number] = np.empty(size, np.float32)
        return memory[:size].reshape(shape)

    def run_in_blocks(self, work: Callable[[slice], None], items: int, block_size: int) -> None:
        """Calls `work` on consecutive slices of `block_size` items, in parallel.

        The slices do not depend on the number of threads; neither does the result, if calls do not
        read each other's output.

        Args:
            work: function of a slice of the items; it should release the GIL.
            items: number of items.
            block_size: items in a slice.
        """
        starts = iter(range(0, items, block_size))  # taken by whichever thread is free

        def run() -> None:
            for start in starts:
                work(slice(start, min(start + block_size, items)))

        if self._executor is None or items <= block_size:
            return run()
        others = [self._executor.submit(run) for _ in range(self.threads - 1)]
        try:
            run()
        finally:
            for each in others:
                if not each.cancel():  # it has begun
                    each.result()


SERIAL = Workspace()
"""Workspace of the caller's thread, without reusable memory."""


class WorkspacePool:
    """Workspaces of a detector, one for each concurrent call.

    Args:
        threads: number of threads per call; None for one per core.

    Raises:
        ConfigError: the number of threads is not positive.
    """

    def __init__(self, threads: int | None) -> None:
        require(threads is None or threads >= 1, "threads", "1 or more, or None", threads)
        self.threads = threads or os.cpu_count() or 1
        self._spare: list[Memory] = []

    @contextmanager
    def workspace(self) -> Iterator[Workspace]:
        """Yields an unused workspace; its threads end with the block."""
        try:
            memory = self._spare.pop()
        except IndexError:  # another thread may take the last workspace between check and pop
            memory = {}
        try:
            with (
                SERIAL_OPENCV,
                ThreadPoolExecutor(self.threads, "saccade") as executor,  # starts none unless used
            ):
                yield Workspace(executor if self.threads > 1 else None, self.threads, memory)
        finally:
            self._spare.append(memory)
