"""The decorator for compiled kernels; only here is Numba.

Kernels stand in files named `_*kernels.py` with the types that they take, and call others of their
package or of such a file at the top level. A kernel that is cached on disk is compiled again when
one of these files changes, and no other.
"""

import copy
import ctypes
import hashlib
import inspect
import logging
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
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
    from llvmlite.binding import get_host_cpu_features
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
                source = Path(inspect.getfile(function))
                _stamp_cache(dispatcher, _hash_kernels(_package(source)))
                _add_shipped(dispatcher, source)
                _compile_once(dispatcher)
            return cast("F", dispatcher)

        try:
            return compiled(cache=True)
        except RuntimeError:  # no folder can be written: a read-only install without a home
            return compiled(cache=False)

    return compile_lazily


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
        return make(*fields)
    shared = make(*(_record(f) if isinstance(f, ctypes.Structure) else f for f in fields))
    vars(shared).update(zip(cast("Any", shared)._fields, fields, strict=True), _made=(make, fields))
    return shared


def _copy_shared(shared: Any, memo: dict[int, Any]) -> Any:
    make, fields = shared._made
    return share(make, *copy.deepcopy(fields, memo))


def _record(structure: ctypes.Structure) -> Any:
    """The same memory as a record of NumPy's, as Numba knows it."""
    names, kinds = zip(*structure._fields_, strict=True)
    dtype = np.dtype({"names": names, "formats": [np.dtype(each) for each in kinds]}, align=True)
    return np.frombuffer(cast("Any", structure), dtype).view(np.recarray)[0]


def _package(source: Path) -> Path:
    """The package of `saccade` that holds a file, or its folder."""
    home = Path(__file__).parent
    return next((each for each in source.parents if each.parent == home), source.parent)


@cache
def _hash_kernels(package: Path) -> str:
    """A hash of the kernel files of a package and of the top level."""
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


WAIT = 60.0
"""Seconds for which a process waits for a kernel that another one compiles."""


def _compile_once(dispatcher: object) -> None:
    """Of several processes that need a kernel, let one compile it and the others wait for it."""
    file = _cache_file(dispatcher)
    if file is None:
        return
    cache = cast("Any", dispatcher)._cache
    load, save, lock = cache.load_overload, cache.save_overload, ExitStack()

    def load_overload(*key: Any) -> Any:
        found = load(*key)
        if found is None:
            lock.enter_context(_locked(f"{file._index_path}.lock"))
            found = load(*key)  # another process has compiled it meanwhile
        if found is not None:
            lock.close()
        return found

    def save_overload(*compiled: Any) -> None:
        with lock:
            save(*compiled)

    cache.load_overload, cache.save_overload = load_overload, save_overload


@contextmanager
def _locked(name: str) -> Iterator[None]:
    """Hold a lock among processes, where the system has such locks and the folder is writable."""
    with ExitStack() as stack:
        with suppress(ImportError, OSError):
            from fcntl import LOCK_EX, LOCK_NB, flock

            file, end = stack.enter_context(Path(name).open("w")), time.monotonic() + WAIT
            stack.callback(Path(name).unlink, missing_ok=True)
            while time.monotonic() < end:
                try:
                    flock(file, LOCK_EX | LOCK_NB)
                    break
                except BlockingIOError:
                    time.sleep(0.02)
        yield


SHIPPED = Path(__file__).parent / "_compiled"
"""Kernels that a wheel carries: a cache of Numba's, with a folder for each package."""
SHIPPED_CPU = "x86-64-v3"
SHIPPED_FEATURES = {"avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"}
"""For which processors they were compiled, and by which features these are known."""


def _add_shipped(dispatcher: object, source: Path) -> None:
    """Take a kernel that is not in the cache from those shipped, if it fits.

    It fits a processor that has the features, and the same source, bytecode and Numba.
    """
    file = _cache_file(dispatcher)
    if file is None or not SHIPPED.is_dir() or not _runs_shipped():
        return
    name = Path(file._index_path).stem
    shipped = type(file)(str(SHIPPED / source.parent.name), name, file._source_stamp)
    cached = file.load

    def load(key: Any) -> Any:
        signature, (platform, *_), code = key
        return cached(key) or shipped.load((signature, (platform, SHIPPED_CPU, ""), code))

    file.load, file.shipped = load, shipped


@cache
def _runs_shipped() -> bool:
    """Whether this processor runs them."""
    try:
        features = get_host_cpu_features()
    except RuntimeError:  # of one that is unknown to LLVM
        return False
    return all(features.get(name) for name in SHIPPED_FEATURES)


def needs_compiling(function: Callable[..., Any]) -> bool:
    """Whether a kernel is still to be compiled, and will be cached then; False if unknown."""
    file = _cache_file(function)
    files = () if file is None else filter(None, (file, getattr(file, "shipped", None)))
    return file is not None and not any(each._load_index() for each in files)


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
