"""Who imports whom, what stays unloaded, and which words are retired."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import saccade
from support.processes import run_python

SOURCE = Path(saccade.__file__).parent
FOUNDATION = {
    "types",
    "motions",
    "landmark_names",
    "pictured",
    "frames",
    "plane",
    "errors",
    "extras",
    "threads",
    "io",
}
ALLOWED = {
    "errors": set(),
    "landmark_names": {"errors"},
    "pictured": set(),
    "lazy": set(),
    "threads": set(),
    "workers": {"errors", "extras"},
    "pictures": {"types", "errors", "io", "attention", "viewing"},
    "motions": {"errors"},
    "types": {"errors", "landmark_names", "motions", "pictured"},
    "frames": {"types", "errors"},
    "plane": {"types", "errors", "motions"},
    "extras": {"errors"},
    "_jit": {"_compiler"},
    "_compiler": {"errors"},
    "io": {"types", "errors", "extras"},
    "scale": {"types", "errors", "_jit", "threads"},
    "textbook": {"types", "errors", "io"},
    "attention": {"types", "pictured", "errors", "extras", "_jit", "io", "scale"},
    "keypoints": {"types", "errors", "extras", "frames", "_jit", "io", "scale", "textbook"},
    "slam": FOUNDATION | {"_compiler", "_jit", "lazy"},
    "gaze": FOUNDATION | {"slam"},
    "visual": FOUNDATION | {"_jit", "scale", "attention", "keypoints", "slam", "gaze", "tags"},
    "simulation": FOUNDATION | {"slam", "gaze", "visual", "tags"},
    "datasets": FOUNDATION | {"lazy"},
    "evaluation": FOUNDATION
    | {"_jit", "scale", "attention", "keypoints", "slam", "visual", "gaze"}
    | {"datasets", "simulation", "exchange"},
    "diagnostics": FOUNDATION | {"visual", "slam"},
    "exchange": FOUNDATION,
    "batch": FOUNDATION | {"attention", "keypoints", "exchange", "workers"},
    "viewing": FOUNDATION | {"textbook", "slam"},
    "settings": {"errors", "io"},
    "tags": {"types", "errors", "landmark_names", "frames", "plane", "io"},
    "torch": {"errors", "extras", "types", "io", "scale", "attention"},
    "serving": FOUNDATION | {"settings", "scale", "attention", "keypoints", "slam", "viewing"},
}
"""What each package may import besides itself; `cli` may import everything, nobody imports it."""
HEAVY = ("numba", "cv2", "scipy", "matplotlib")


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def modules_imported(path):
    found = []
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: import by the full name"
            names = [f"saccade.{name.name}" for name in node.names]
            found += names if node.module == "saccade" else [node.module]
        elif isinstance(node, ast.Import):
            found += [name.name for name in node.names]
    return found


def packages_imported(path):
    names = (module.split(".") for module in modules_imported(path))
    return {parts[1] for parts in names if parts[0] == "saccade" and len(parts) > 1}


def package_of(path):
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("package", sorted(ALLOWED))
def test_a_package_imports_only_what_it_may(package):
    files = [path for path in SOURCE.rglob("*.py") if package_of(path) == package]
    assert files
    for path in files:
        strangers = packages_imported(path) - ALLOWED[package] - {package}
        assert not strangers, f"{path.relative_to(SOURCE)} imports {strangers}"


def test_the_demo_needs_no_extra():
    assert not packages_imported(SOURCE / "cli" / "demo.py") & {"batch", "serving", "torch"}


def is_kernel_file(module):
    name = module.rpartition(".")[2]
    return name.startswith("_") and name.endswith("kernels")


def is_kernel(node):
    return isinstance(node, ast.FunctionDef) and any(
        isinstance(each, ast.Call) and ast.unparse(each.func) == "kernel"
        for each in node.decorator_list
    )


def test_kernels_stand_in_files_of_their_own():
    for path in SOURCE.rglob("*.py"):
        if is_kernel_file(path.stem):
            holds_kernels_alone(path, tree_of(path))
        else:
            assert not [node.name for node in tree_of(path).body if is_kernel(node)], path


def holds_kernels_alone(path, tree):
    others = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert [node.name for node in tree.body if is_kernel(node)] == others, f"{path}: no kernel"
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    modules = {
        name.name for node in tree.body if isinstance(node, ast.Import) for name in node.names
    }
    assert modules <= {"numpy", "numpy.typing", "math", "ctypes"}, path
    known = {"math", "ctypes", "typing", "saccade._jit", "saccade.types"}
    package = f"saccade.{path.relative_to(SOURCE).parts[0]}."
    for node in imports:
        own = node.module.startswith(package) and is_kernel_file(node.module)
        assert node.module in known or own, (
            f"{path}: the cache of kernels does not know when {node.module} changes"
        )


def values_of_constants(path):
    """Names of constants that are numbers, with the text of their values."""
    for node in tree_of(path).body:
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
        elif isinstance(node, ast.AnnAssign):
            target, value = node.target, node.value
        else:
            continue
        several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        pairs = zip(target.elts, value.elts, strict=True) if several else [(target, value)]
        for name, each in pairs:
            if isinstance(name, ast.Name) and name.id.isupper() and is_number(each):
                yield name.id, ast.unparse(each)


def is_number(value):
    """Whether an expression is made of numbers, such as `1e-3`, `(3, 2)` or `np.radians(30)`."""
    nodes = [*ast.walk(value)] if value is not None else []
    literals = [node.value for node in nodes if isinstance(node, ast.Constant)]
    others = any(isinstance(node, (ast.Dict, ast.Lambda, ast.comprehension)) for node in nodes)
    return bool(literals) and not others and all(type(each) in (int, float) for each in literals)


def test_a_constant_has_one_value():
    """Two modules give one name to equal numbers only; the textbook names its own as the source."""
    values = {}
    for path in sorted(SOURCE.rglob("*.py")):
        if package_of(path) != "textbook":
            for name, value in values_of_constants(path):
                values.setdefault(name, {})[path.relative_to(SOURCE).as_posix()] = value
    assert len(values) > 500
    several = {name: where for name, where in values.items() if len({*where.values()}) > 1}
    assert not several


def test_no_module_is_in_an_import_circle():
    """By the imports at the top of modules, which run when a module is loaded."""
    modules = {
        ".".join(("saccade", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(
            ".__init__"
        ): path
        for path in SOURCE.rglob("*.py")
    }
    imported = {
        name: imports_at_the_top(path) & {*modules} - {name} for name, path in modules.items()
    }
    tuple(TopologicalSorter(imported).static_order())  # raises CycleError, which names the circle


def imports_at_the_top(path):
    """Full names that may be modules, of all imports that run when the module is loaded."""
    found = set()
    for node in tree_of(path).body:
        if isinstance(node, ast.ImportFrom):
            found |= {node.module} | {f"{node.module}.{name.name}" for name in node.names}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return found


def test_every_package_has_its_rule():
    packages = {package_of(path) for path in SOURCE.rglob("*.py")}
    assert packages == set(ALLOWED) | {"__init__", "__main__", "cli"}


@pytest.mark.parametrize(("module", "owner"), [("numba", "_compiler.py"), ("cyclopts", "cli")])
def test_some_libraries_have_one_door(module, owner):
    users = {
        path.relative_to(SOURCE).parts[0]
        for path in SOURCE.rglob("*.py")
        if any(name.split(".")[0] == module for name in modules_imported(path))
    }
    assert users == {owner}


@pytest.mark.parametrize(
    "statement",
    [
        "import saccade",
        "from saccade.cli import main; import sys; sys.argv[1:] = ['--help']; main()",
    ],
)
def test_the_start_is_light(statement):
    report = f"""
import atexit, sys
atexit.register(lambda: print([m for m in {HEAVY!r} if m in sys.modules], file=sys.stderr))
{statement}
"""
    done = run_python("-c", report, check=True)
    assert done.stderr.strip() == "[]"


def test_help_is_light():
    """Help loads neither the compiler, a filter nor figures, with the tables of all kinds."""
    report = """
import sys
from saccade.cli import COMMANDS, EVALUATIONS, app
names = [[name] for panel in COMMANDS.values() for name in panel]
names += [["evaluate", name] for panel in EVALUATIONS.values() for name in panel]
for each in names:
    app.parse_commands(each)[1][-1].default_command
print([m for m in ("numba", "scipy", "matplotlib", "saccade.slam.online") if m in sys.modules])
"""
    assert run_python("-c", report, check=True).stdout.strip() == "[]"


def test_every_public_name_is_there():
    for name in saccade.__all__:
        assert getattr(saccade, name) is not None
    assert set(saccade.__all__) <= set(dir(saccade))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        saccade.nonsense  # noqa: B018


def test_no_file_outgrows_its_subject():
    for path in SOURCE.rglob("*.py"):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 600, path


def test_files_are_opened_in_one_place():
    """By `saccade.io.files`, which refuses what has no end; our own data needs no such care."""
    opening = ("read_text(", "read_bytes(", '.open("rb")', ".open(newline", ".open(encoding")
    ours = {"_compiler.py", "cli/serve.py", "workers.py", "viewing/page.py"}
    ours |= {"lazy.py", "extras.py"}  # our own names, and the record of our installation
    for path in SOURCE.rglob("*.py"):
        if path != SOURCE / "io" / "files.py" and path.relative_to(SOURCE).as_posix() not in ours:
            for line in path.read_text(encoding="utf-8").splitlines():
                found = [word for word in opening if f".{word.lstrip('.')}" in line]
                assert not found, f"{path}: {line.strip()}"


def test_tests_share_code_through_support_only():
    """No test file imports another, nor a `conftest`."""
    for path in Path(__file__).parent.rglob("*.py"):
        for module in modules_imported(path):
            last = module.rpartition(".")[2]
            assert not last.startswith(("test_", "conftest")), f"{path}: {module}"
