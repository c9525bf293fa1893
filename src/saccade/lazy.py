"""Names of a package that are loaded when they are first used."""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_names(package: str, file: str) -> tuple[list[str], Callable[[str], Any]]:
    """The public names of a package and its `__getattr__`, which imports a name when it is used.

    Args:
        package: name of the package.
        file: its `__init__.py`; the imports of the stub `__init__.pyi` beside it list the names.
    """
    stub = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    module_of = {
        name.name: node.module
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    }

    def load(name: str) -> Any:
        module = module_of.get(name)
        if module is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        is_package = module == package
        found = import_module(f"{module}.{name}" if is_package else module)
        value = found if is_package else getattr(found, name)
        setattr(sys.modules[package], name, value)
        return value

    return sorted(module_of), load
