"""Declares compiled kernels: decorators for functions and structures.

Kernels stand in files named `_*kernels.py`, with the types of their arguments. They are cached on
disk and compiled again when a kernel file of their package changes. Numba, which takes most of a
second to import, is loaded when a kernel is first called.
"""

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import update_wrapper
from pkgutil import resolve_name
from threading import Lock
from typing import Any, TypeVar, cast, dataclass_transform

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C", bound=type[Any])


_loading = Lock()


class Kernel:
    """A function that is compiled when it is first called."""

    def __init__(
        self, function: Callable[..., Any], fastmath: Iterable[str], *, inline: bool
    ) -> None:
        self._function, self._fastmath, self._inline = function, fastmath, inline
        self._dispatcher: Callable[..., Any] | None = None
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return self.load()(*arguments)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.load(), name)  # Numba asks a kernel in another one for its type

    def __reduce__(self) -> tuple[Callable[[str], Any], tuple[str]]:
        return resolve_name, (f"{self._function.__module__}:{self._function.__qualname__}",)

    def load(self) -> Callable[..., Any]:
        """Numba's dispatcher; it takes the place of the kernel."""
        if self._dispatcher is None:
            with _loading:
                self._dispatcher = self._dispatcher or self._compile()
            replace_everywhere(self, self._dispatcher)
        return self._dispatcher

    def _compile(self) -> Callable[..., Any]:
        from saccade._compiler import dispatcher_of  # loads Numba

        return dispatcher_of(self._function, self._fastmath, inline=self._inline)


def replace_everywhere(kernel: Kernel, dispatcher: Callable[..., Any]) -> None:
    """Puts the dispatcher in the place of the kernel in all modules, so that calls are direct."""
    for module in [each for name, each in sys.modules.items() if name.startswith("saccade.")]:
        for name in [name for name, value in list(vars(module).items()) if value is kernel]:
            setattr(module, name, dispatcher)


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

    def declare(function: F) -> F:
        return cast("F", Kernel(function, fastmath, inline=inline))

    return declare


@dataclass_transform(eq_default=False)
def structure(fields: C) -> C:
    """Class decorator: a structure that kernels take as one argument, by reference.

    Its annotations are its fields, in order: numbers that stay, arrays, and records. One is made
    by `_compiler.share`. Passing it takes a quarter of the time of passing a tuple of its arrays,
    and compiles faster.
    """
    return cast("C", dataclass(eq=False)(fields))
