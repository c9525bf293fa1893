"""Compiled kernels: decorators for functions and structures, and routines of BLAS.

Kernels stand in files named `_*kernels.py`, with the types of their arguments. They are cached on
disk and compiled again when a kernel file of their package changes.
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
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast, dataclass_transform

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

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C", bound=type[Any])
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


def kernel(fastmath: Iterable[str] = (), *, inline: bool = False) -> Callable[[F], F]:
    """Compiles a function at its first call; it releases the GIL and is cached on disk.

    A kernel whose name begins with an underscore is called by kernels only: it has no entry from
    Python, which takes as long to compile as a small kernel.

    Args:
        fastmath: LLVM's fast-math flags by name, such as "reassoc" or "contract";
            leave out "nnan" and "ninf" wherever a NaN can occur.
        inline: whether the kernel becomes a part of its callers, with their flags. This saves
            compilation time for kernels with one caller and dozens of arrays as arguments.

    Returns:
        A decorator; the compiled function keeps its plain Python body as `.py_func`
        unless Numba's JIT is switched off.
    """

    def compile_lazily(function: F) -> F:
        compiler = numba.njit(  # type: ignore[call-overload]
            nogil=True,
            error_model="numpy",
            fastmath=set(fastmath),
            no_cpython_wrapper=function.__name__.startswith("_"),
            no_cfunc_wrapper=True,
            inline="always" if inline else "never",
        )
        dispatcher = compiler(function)
        with suppress(RuntimeError, AttributeError):  # no writable folder; no compiler
            dispatcher.enable_caching()
            _stamp_cache(dispatcher, _hash_kernels(Path(inspect.getfile(function))))
        return cast("F", dispatcher)

    return compile_lazily


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


@dataclass_transform(eq_default=False)
def structure(fields: C) -> C:
    """Class decorator: a structure that kernels take as one argument, by reference.

    Its annotations are its fields, in order: numbers that stay, arrays, and records (see `share`).
    Passing it takes a quarter of the time of passing a tuple of its arrays, and compiles faster.
    """
    names = tuple(inspect.get_annotations(fields))
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        plain = dataclass(eq=False)(fields)
        cast("Any", plain)._fields = names
        return cast("C", plain)
    own = {name: each for name, each in vars(fields).items() if name[:2] != "__"}
    home = {"__module__": fields.__module__}
    kind = type(f"_{fields.__name__}Type", (types.StructRef,), home)
    setattr(sys.modules[fields.__module__], kind.__name__, kind)  # where the cache looks for it
    own |= {**home, "_fields": names, "__deepcopy__": _copy_shared}
    proxy = type(fields.__name__, (structref.StructRefProxy,), own)
    structref.register(kind)  # type: ignore[no-untyped-call]
    structref.define_proxy(proxy, kind, names)  # type: ignore[no-untyped-call]
    return cast("C", proxy)


def share(make: Callable[..., T], *fields: Any) -> T:
    """A structure with these fields, made by the kernel `make`, whose fields Python reads as well.

    A field that is a `ctypes.Structure` is a record: kernels and Python write to the same numbers.
    """
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return make(fields)
    shared = make(tuple(_record(f) if isinstance(f, ctypes.Structure) else f for f in fields))
    vars(shared).update(zip(cast("Any", shared)._fields, fields, strict=True), _made=(make, fields))
    return shared


def _copy_shared(shared: Any, memo: dict[int, Any]) -> Any:
    make, fields = shared._made
    return share(make, *copy.deepcopy(fields, memo))


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
