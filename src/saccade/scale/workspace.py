"""The threads and the reusable memory of a computation."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from math import prod
from typing import TypeAlias

import numpy as np

from saccade.errors import require
from saccade.types import Float32Array

Memory: TypeAlias = dict[tuple[str, int], Float32Array]


class Workspace:
    """The threads of one computation, and memory that the next one reuses.

    Allocating anew took a third of the time of a scale space. An array is valid until the next
    computation in the same memory.

    Args:
        executor: its threads; None for the thread of the caller alone.
        threads: their number.
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
        """An uninitialized array in the memory of a name and number."""
        size = prod(shape)
        memory = self._memory.get((name, number))
        if memory is None or memory.size < size:
            memory = self._memory[name, number] = np.empty(size, np.float32)
        return memory[:size].reshape(shape)

    def run_in_blocks(self, work: Callable[[slice], None], items: int, block_size: int) -> None:
        """Call `work` on consecutive slices of `block_size` items, several at a time.

        The slices do not depend on the number of threads; nor does the result, as long as no
        call reads what another one writes.

        Args:
            work: takes a slice of the items; spends its time in code that releases the GIL.
            items: number of items.
            block_size: items in a slice.
        """
        starts = range(0, items, block_size)
        blocks = [slice(start, min(start + block_size, items)) for start in starts]
        if self._executor is None or len(blocks) < 2:
            list(map(work, blocks))
        else:
            list(self._executor.map(work, blocks))


SERIAL = Workspace()
"""Only the thread of the caller; its memory is not for use."""


class WorkspacePool:
    """The workspaces of a detector: one for each call that runs at the same time.

    Args:
        threads: of a call; None for one per core.

    Raises:
        ConfigError: the number of threads is not positive.
    """

    def __init__(self, threads: int | None) -> None:
        require(threads is None or threads >= 1, "threads", "1 or more, or None", threads)
        self.threads = threads or os.cpu_count() or 1
        self._spare: list[Memory] = []

    @contextmanager
    def workspace(self) -> Iterator[Workspace]:
        """A workspace that no other call uses; its threads end with the block."""
        try:
            memory = self._spare.pop()
        except IndexError:  # not asked before: another thread may take the last meanwhile
            memory = {}
        try:
            with ThreadPoolExecutor(self.threads, "saccade") as executor:  # starts none unless used
                yield Workspace(executor if self.threads > 1 else None, self.threads, memory)
        finally:
            self._spare.append(memory)
