"""Numba: compiles kernels and structures, and finds routines of BLAS.

`saccade._jit` declares them and loads this module when a kernel is first called.
"""

import copy
import ctypes
import hashlib
import inspect
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from saccade.errors import ConfigError

try:
    with warnings.catch_warnings():  # Numba would go on, with its own traceback in a warning
        warnings.filterwarnings("error", "Environment variable", RuntimeWarning)
        import numba
    from numba.core import event, types
    from numba.experimental import structref
    from numba.extending import get_cython_function_address
except (RuntimeWarning, ValueError) as error:
    given = ", ".join(each for each in os.environ if each.startswith("NUMBA_")) or "Numba"
    raise ConfigError(f"{given}: Numba cannot be loaded: {str(error).splitlines()[0]}") from error

_logger = logging.getLogger(__name__)

T = TypeVar("T")


class _Announcer(event.Listener):
    """Logs once per process that kernels are compiled, which takes seconds."""

    announced = False

    def on_start(self, event: event.Event) -> None:
        if not self.announced:
            _logger.warning("compiling for this machine (once; the result is cached)")
        self.announced = True

    def on_end(self, event: event.Event) -> None:
        """Does nothing; Numba requires the method."""


event.register("numba:compile", _Announcer())  # type: ignore[no-untyped-call]


def dispatcher_of(
    function: Callable[..., Any], fastmath: Iterable[str], *, inline: bool
) -> Callable[..., Any]:
    """The function of a kernel, compiled at its first call; see `_jit.kernel`."""
    compiler = numba.njit(  # type: ignore[call-overload]
        nogil=True,
        error_model="numpy",
        fastmath=set(fastmath),
        no_cpython_wrapper=function.__name__.startswith("_"),
        no_cfunc_wrapper=True,
        inline="always" if inline else "never",
    )
    dispatcher: Callable[..., Any] = compiler(function)
    with suppress(RuntimeError, AttributeError):  # no writable folder; no compiler
        cast("Any", dispatcher).enable_caching()
        _stamp_cache(dispatcher, _hash_kernels(Path(inspect.getfile(function))))
    return dispatcher


def _stamp_cache(dispatcher: Any, stamp: str) -> None:
    """Makes a cached kernel stale where the stamp differs, besides where its own file changed.

    Raises:
        AttributeError: this version of Numba has other private attributes; its own rule holds.
    """
    file = dispatcher._cache._cache_file
    file._source_stamp = (file._source_stamp, stamp)


@cache
def _hash_kernels(source: Path) -> str:
    """The hash of the kernel files in the package of `saccade` that holds the file `source`."""
    home = Path(__file__).parent
    package = next((each for each in source.parents if each.parent == home), source.parent)
    digest = hashlib.sha256()
    for path in sorted(package.rglob("_*kernels.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def share(fields: type[T], make: Callable[[tuple[Any, ...]], T], *values: Any) -> T:
    """A structure with these values, made by the kernel `make`, whose fields Python reads as well.

    A value that is a `ctypes.Structure` is a record: kernels and Python write to the same numbers.
    """
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return make(values)
    _register(cast("Any", fields))
    shared = make(tuple(_record(v) if isinstance(v, ctypes.Structure) else v for v in values))
    names = inspect.get_annotations(fields)
    vars(shared).update(zip(names, values, strict=True), _made=(fields, make, values))
    return shared


@cache
def _register(fields: type) -> None:
    """Makes a structure known to Numba: its type, its constructor in kernels, and its proxy."""
    home = {"__module__": fields.__module__}
    kind = type(f"_{fields.__name__}Type", (types.StructRef,), home)
    setattr(sys.modules[fields.__module__], kind.__name__, kind)  # where the cache looks for it
    own = {name: each for name, each in vars(fields).items() if name[:2] != "__"}
    own |= {**home, "__deepcopy__": _copy_shared}
    proxy = type(fields.__name__, (structref.StructRefProxy,), own)
    structref.register(kind)  # type: ignore[no-untyped-call]
    names = tuple(inspect.get_annotations(fields))
    structref.define_constructor(fields, kind, names)  # type: ignore[no-untyped-call]
    structref.define_boxing(kind, proxy)  # type: ignore[no-untyped-call]


def _copy_shared(shared: Any, memo: dict[int, Any]) -> Any:
    fields, make, values = shared._made
    return share(fields, make, *copy.deepcopy(values, memo))


def _record(structure: ctypes.Structure) -> Any:
    """The memory of a structure as a NumPy record, which Numba can take."""
    names, kinds = zip(*structure._fields_, strict=True)
    dtype = np.dtype({"names": names, "formats": [np.dtype(each) for each in kinds]}, align=True)
    return np.frombuffer(cast("Any", structure), dtype).view(np.recarray)[0]


def blas(name: str, *arguments: type) -> Callable[..., None]:
    """A routine of the BLAS in SciPy; unlike SciPy's wrappers, it can change part of a matrix.

    Args:
        name: name of the routine, such as "dsyrk".
        arguments: ctypes of its arguments, all of which are pointers.
    """
    address = get_cython_function_address("scipy.linalg.cython_blas", name)
    return cast("Callable[..., None]", ctypes.CFUNCTYPE(None, *arguments)(address))
