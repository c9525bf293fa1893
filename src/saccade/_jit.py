"""The one decorator for hot loops, and the only file that imports Numba.

A kernel and the kernels it calls share one file: the cache on disk cannot see
a change in another file.
"""

import logging
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numba
from numba.core import event

_logger = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])


class _Announcer(event.Listener):  # type: ignore[misc]
    """Says once per process that kernels are being compiled: it takes seconds."""

    def on_start(self, event: Any) -> None:  # noqa: ANN401
        _logger.info("compiling for this machine (once; the result is cached)")
        numba.core.event.unregister("numba:compile", self)

    def on_end(self, event: Any) -> None:  # noqa: ANN401
        """Required by Numba; nothing to say."""


event.register("numba:compile", _Announcer())


def kernel(fastmath: Iterable[str] = ()) -> Callable[[F], F]:
    """Compile a function at its first call, without the GIL, cached on disk.

    Args:
        fastmath: LLVM's fast-math flags by name, such as "reassoc" or "contract";
            leave out "nnan" and "ninf" wherever a NaN can occur.

    Returns:
        A decorator; the compiled function keeps its plain Python body as `.py_func`
        unless Numba's JIT is switched off.
    """
    options = {"nogil": True, "error_model": "numpy", "fastmath": set(fastmath)}

    def compile_lazily(function: F) -> F:
        try:
            return numba.njit(cache=True, **options)(function)  # type: ignore[no-any-return]
        except RuntimeError:  # no folder can be written: a read-only install without a home
            return numba.njit(cache=False, **options)(function)  # type: ignore[no-any-return]

    return compile_lazily
