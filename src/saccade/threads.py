"""Libraries that start no threads of their own for a while."""

from collections.abc import Callable
from contextlib import ContextDecorator
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


class Serial(ContextDecorator):
    """Context in which a library starts no threads of its own, in the whole process.

    Contexts may overlap, in several threads too; the last one restores the number of threads.

    Args:
        limit: sets the number of threads to one, and returns the function that restores it.
    """

    def __init__(self, limit: Callable[[], Callable[[], object]]) -> None:
        self._limit = limit
        self._lock = Lock()
        self._inside = 0
        self._restore: Callable[[], object] = lambda: None

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._restore = self._limit()
            self._inside += 1

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._restore()


def _limit_opencv() -> Callable[[], object]:
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    return lambda: cv2.setNumThreads(before)


def _limit_blas() -> Callable[[], object]:
    libraries = [(each, each.num_threads) for each in _blas().lib_controllers]
    several = [(each, number) for each, number in libraries if number > 1]
    for each, _ in several:
        each.set_num_threads(1)
    return lambda: [each.set_num_threads(number) for each, number in several]


@cache
def _blas() -> "ThreadpoolController":
    """The threads of the BLAS that are loaded."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


SERIAL_OPENCV = Serial(_limit_opencv)
"""The threads of a workspace share the work already."""
SERIAL_BLAS = Serial(_limit_blas)
"""Sums of several threads depend on their number. They also wait for each other longer than one
works on matrices of a map."""
