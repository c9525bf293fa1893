"""The decorator for compiled kernels; only here is Numba.

Kernels stand in files named `_*kernels.py`, and call others of their package or of such a file at
the top level. A kernel that is cached on disk is compiled again when one of these files changes,
and no other.
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
from typing import Any, NamedTuple, TypeVar, cast, get_args, get_type_hints

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


def kernel(fastmath: Iterable[str] = (), *, inline: bool = False) -> Callable[[F], F]:
    """Compile a function at its first call, without the GIL, cached on disk.

    Args:
        fastmath: LLVM's fast-math flags by name, such as "reassoc" or "contract";
            leave out "nnan" and "ninf" wherever a NaN can occur.
        inline: whether it is compiled as a part of each kernel that calls it, with the flags of
            that one. This saves the time that a call takes to compile: seconds where tuples of
            dozens of arrays are passed, so it is for kernels that are called in one place.

    A kernel whose name begins with an underscore is called by kernels only: it has no entry from
    Python, which takes as long to compile as a small kernel.

    Returns:
        A decorator; the compiled function keeps its plain Python body as `.py_func`
        unless Numba's JIT is switched off.
    """

    def compile_lazily(function: F) -> F:
        def compiled(*, cache: bool) -> F:
            dispatcher = numba.njit(  # type: ignore[call-overload]
                function,
                cache=cache,
                nogil=True,
                error_model="numpy",
                fastmath=set(fastmath),
                no_cpython_wrapper=function.__name__.startswith("_"),
                no_cfunc_wrapper=True,
                inline="always" if inline else "never",
            )
            if cache:
                _stamp_cache(dispatcher, kernel_stamp(function))
            return cast("F", dispatcher)

        try:
            return compiled(cache=True)
        except RuntimeError:  # no folder can be written: a read-only install without a home
            return compiled(cache=False)

    return compile_lazily


class _BoundType(types.StructRef):
    """Numba's type of `Bound`."""


structref.register(_BoundType)  # type: ignore[no-untyped-call]
if getattr(numba.config, "DISABLE_JIT", False):

    class Bound(NamedTuple):
        """Arguments of a kernel."""

        arguments: tuple[Any, ...]

else:

    class Bound(structref.StructRefProxy):  # type: ignore[no-redef]
        """Arguments of a kernel, unboxed once for many calls; a kernel makes it.

        Unboxing dozens of arrays takes as long as a small step of the filter.
        """

        arguments: tuple[Any, ...]
        """For kernels only."""

    structref.define_proxy(Bound, _BoundType, ["arguments"])  # type: ignore[no-untyped-call]


def kernel_stamp(function: Callable[..., Any]) -> str:
    """A hash of what a compiled kernel depends on.

    The kernel files of its package and of the top level, and the names of the fields of the
    NamedTuples it takes: compiled code has their positions only.

    Raises:
        TypeError: an annotation cannot be evaluated yet, such as one that is imported for type
            checkers only; its layout would be unknown.
    """
    source = Path(inspect.getfile(function))
    layouts = [_layout(each) for each in _evaluated(function).values()]
    return hashlib.sha256(f"{_hash_kernels(_package(source))}{layouts}".encode()).hexdigest()


def _evaluated(annotated: Callable[..., Any]) -> dict[str, Any]:
    """The annotations of a function or class, those evaluated that are text."""
    try:
        return get_type_hints(annotated)
    except NameError as error:
        name = annotated.__qualname__
        raise TypeError(f"{name}: expected annotations defined before it: {error}") from error


def _layout(annotation: Any) -> list[object]:
    """The names of a NamedTuple's fields, each with the layout of its own type.

    Of a tuple or another type with parameters, the layouts of these.
    """
    if hasattr(annotation, "_fields"):
        types = _evaluated(annotation)
        return [(name, _layout(types.get(name))) for name in annotation._fields]
    return [layout for each in get_args(annotation) if (layout := _layout(each))]


def _package(source: Path) -> Path:
    """The package of `saccade` that holds a file, or its folder."""
    home = Path(__file__).parent
    return next((each for each in source.parents if each.parent == home), source.parent)


@cache
def _hash_kernels(package: Path) -> str:
    digest = hashlib.sha256()
    files = {*package.rglob("_*kernels.py"), *Path(__file__).parent.glob("_*kernels.py")}
    for path in sorted(files):
        digest.update(path.read_bytes())
    return digest.hexdigest()


# Numba's private attributes, here and nowhere else. Where a version of Numba has others, kernels
# are cached in its plain way: one is compiled again only when its own file changes.


def _cache_file(dispatcher: object) -> Any | None:
    """Numba's index of what is cached of a kernel; None if there is none, or of another kind."""
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    known = hasattr(file, "_source_stamp") and callable(getattr(file, "_load_index", None))
    return file if known else None


def _stamp_cache(dispatcher: object, stamp: str) -> None:
    """Let a kernel's cache be stale where the stamp is another one, too."""
    file = _cache_file(dispatcher)
    if file is not None:
        file._source_stamp = (file._source_stamp, stamp)


def needs_compiling(function: Callable[..., Any]) -> bool:
    """Whether a kernel is still to be compiled, and will be cached then; False if unknown."""
    file = _cache_file(function)
    return file is not None and not file._load_index()


def compile_for(function: Callable[..., Any], *arguments: Any) -> None:
    """Compile a kernel for arguments of these types, unless something of it is in the cache."""
    if needs_compiling(function):
        cast("Any", function).compile(tuple(map(numba.typeof, arguments)))


def blas(name: str, *arguments: type) -> Callable[..., None]:
    """A routine of the BLAS that SciPy brings; unlike SciPy's own, it can change part of a matrix.

    Args:
        name: of the routine, such as "dsyrk".
        arguments: the ctypes of its arguments, all of which are pointers.
    """
    address = get_cython_function_address("scipy.linalg.cython_blas", name)
    return cast("Callable[..., None]", ctypes.CFUNCTYPE(None, *arguments)(address))
