"""Frames are read, and their points found, while those before them are mapped."""

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

T = TypeVar("T")

SWITCH_INTERVAL = 5e-4
"""Seconds that a thread waits for the Python code of another. By default it is ten times as long,
and many waits make up a frame."""


@contextmanager
def shorter_switch_interval() -> Iterator[None]:
    """Let two threads of Python work well beside each other meanwhile.

    They take turns often, and the linear algebra of the one does not start more threads: with the
    other at work those wait for each other, ten times longer than it takes one alone.
    """
    usual = sys.getswitchinterval()
    sys.setswitchinterval(min(usual, SWITCH_INTERVAL))
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        sys.setswitchinterval(usual)


class Prefetcher(Generic[T]):
    """The work on the items of a series, some of which are done before they are asked for.

    It is done one by one and in order by a thread of its own, so that the outcome is that of
    doing it when it is asked for.

    Args:
        work: on the item of a number.
        count: of items.
        ahead: how many are worked on before they are asked for, at most.
    """

    def __init__(self, work: Callable[[int], T], count: int, ahead: int) -> None:
        self._work, self._count, self._ahead = work, count, ahead
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="saccade-ahead")
        self._begun: dict[int, Future[T]] = {}

    def __call__(self, number: int) -> T:
        """What comes of an item; raises what the work on it raises."""
        for i in range(number, min(number + 1 + self._ahead, self._count)):
            if i not in self._begun:
                self._begun[i] = self._thread.submit(self._work, i)
        return self._begun.pop(number).result()
