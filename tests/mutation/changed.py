"""The project with one file changed, or interpreted, in this process and nothing on the disk."""

import sys
import types
from collections.abc import Callable, Collection
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any

QUIETLY = ("-q", "-n", "0", "--assert=plain", "--tb=native", "-p", "no:cacheprovider")


def replace(path: Path, source: str) -> None:
    """Let a file that is not imported yet say something else.

    Its kernels, and the kernels that know its, are not compiled: those of the disk's cache would
    hold the old code.
    """
    original = SourceFileLoader.get_code

    def get_code(loader: SourceFileLoader, name: str) -> Any:
        if Path(loader.get_filename(name)) == path:
            return compile(source, str(path), "exec")
        return original(loader, name)

    SourceFileLoader.get_code = get_code  # type: ignore[method-assign, assignment]
    interpret([path])


def interpret(paths: Collection[Path]) -> None:
    """Leave the kernels of some files, and all that call them, to Python."""
    from saccade import _jit

    compiled = _jit.kernel
    left: set[str] = set()

    def kernel(*options: Any, **named: Any) -> Callable[[Any], Any]:
        def decide(function: Any) -> Any:
            known = function.__globals__.values()
            homes = {
                each.__name__ if isinstance(each, types.ModuleType) else each.__module__
                for each in known
                if isinstance(each, types.ModuleType | types.FunctionType)
            }
            its_own = Path(sys.modules[function.__module__].__file__ or "")
            if its_own in paths or homes & left:
                left.add(function.__module__)
                return function
            return compiled(*options, **named)(function)

        return decide

    _jit.kernel = kernel  # type: ignore[assignment]
