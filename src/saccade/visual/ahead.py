"""Frames are read, and their points found, while those before them are mapped."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

T = TypeVar("T")


class Ahead(Generic[T]):
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
