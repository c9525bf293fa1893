"""Prefetching: the next frames are read and searched for points while a frame is mapped."""

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Generic, Self, TypeVar

from threadpoolctl import threadpool_limits

T = TypeVar("T")

SWITCH_INTERVAL = 5e-4
"""Seconds that a thread waits for the Python code of another; Python's own is ten times as long."""


class Prefetcher(Generic[T]):
    """Computes the items of a series ahead of their use, in order and in one thread.

    A context manager: its thread ends with it.

    Args:
        compute: an item, by its number.
        count: of items.
        ahead: items that are computed before they are used, at most.
    """

    def __init__(self, compute: Callable[[int], T], count: int, ahead: int) -> None:
        self._compute, self._count, self._ahead = compute, count, ahead
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="saccade-prefetch")
        self._pending: dict[int, Future[T]] = {}

    def __call__(self, number: int) -> T:
        """An item; raises what its computation raised."""
        for i in range(number, min(number + 1 + self._ahead, self._count)):
            if i not in self._pending:
                self._pending[i] = self._thread.submit(self._compute, i)
        return self._pending.pop(number).result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.shutdown(cancel_futures=True)


@contextmanager
def dedicated_process() -> Iterator[None]:
    """Settings of the whole process under which mapping and prefetching run fastest together.

    For programs that have the process to themselves, as `saccade drive`; `run` leaves the
    settings alone. The two threads take turns more often, and linear algebra runs in one thread:
    more would compete with the prefetching. Both are restored at the end.
    """
    interval = sys.getswitchinterval()
    sys.setswitchinterval(min(interval, SWITCH_INTERVAL))
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        sys.setswitchinterval(interval)
