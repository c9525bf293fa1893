"""The one decorator for hot loops; only here is Numba.

A kernel and the kernels it calls share one package: what is cached on disk is compiled anew
when a file of that package has changed.
"""

import ctypes
import hashlib
import inspect
import logging
import os
import warnings
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from saccade.errors import ConfigError

try:
    with warnings.catch_warnings():  # Numba would go on, with its own traceback in a warning
        warnings.filterwarnings("error", "Environment variable", RuntimeWarning)
        import numba
    from numba.core import event
    from numba.extending import get_cython_function_address
except (RuntimeWarning, ValueError) as error:
    given = ", ".join(each for each in os.environ if each.startswith("NUMBA_")) or "Numba"
    raise ConfigError(f"{given}: Numba cannot be loaded: {str(error).splitlines()[0]}") from error

_logger = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])


class _Announcer(event.Listener):
    """Says once per process that kernels are being compiled: it takes seconds."""

    announced = False

    def on_start(self, event: event.Event) -> None:
        if not self.announced:
            _logger.info("compiling for this machine (once; the result is cached)")
        self.announced = True

    def on_end(self, event: event.Event) -> None:
        """Required by Numba; nothing to say."""


event.register("numba:compile", _Announcer())  # type: ignore[no-untyped-call]


def kernel(fastmath: Iterable[str] = ()) -> Callable[[F], F]:
    """Compile a function at its first call, without the GIL, cached on disk.

    Args:
        fastmath: LLVM's fast-math flags by name, such as "reassoc" or "contract";
            leave out "nnan" and "ninf" wherever a NaN can occur.

    Returns:
        A decorator; the compiled function keeps its plain Python body as `.py_func`
        unless Numba's JIT is switched off.
    """

    def compile_lazily(function: F) -> F:
        def compiled(*, cache: bool) -> F:
            dispatcher = numba.njit(
                function, cache=cache, nogil=True, error_model="numpy", fastmath=set(fastmath)
            )
            if cache and hasattr(dispatcher, "_cache"):
                _stamp(dispatcher, Path(inspect.getfile(function)))
            return cast("F", dispatcher)

        try:
            return compiled(cache=True)
        except RuntimeError:  # no folder can be written: a read-only install without a home
            return compiled(cache=False)

    return compile_lazily


def needs_compiling(function: Callable[..., Any]) -> bool:
    """Whether a kernel is still to be compiled, and will be cached then."""
    file = getattr(getattr(function, "_cache", None), "_cache_file", None)
    return file is not None and not file._load_index()


def _stamp(dispatcher: Any, source: Path) -> None:
    """Let a cache be stale when any file of the package changed; Numba looks at one file only."""
    file = dispatcher._cache._cache_file
    file._source_stamp = (file._source_stamp, _sources(_package(source)))


def _package(source: Path) -> Path:
    """The package of `saccade` that holds a file, or its folder."""
    home = Path(__file__).parent
    return next((each for each in source.parents if each.parent == home), source.parent)


@cache
def _sources(folder: Path) -> str:
    digest = hashlib.sha256()
    inside = folder != Path(__file__).parent
    for path in sorted(folder.rglob("*.py") if inside else folder.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def blas(name: str, *arguments: type) -> Callable[..., None]:
    """A routine of the BLAS that SciPy brings; unlike SciPy's own, it can change part of a matrix.

    Args:
        name: of the routine, such as "dsyrk".
        arguments: the ctypes of its arguments, all of which are pointers.
    """
    address = get_cython_function_address("scipy.linalg.cython_blas", name)
    return cast("Callable[..., None]", ctypes.CFUNCTYPE(None, *arguments)(address))
