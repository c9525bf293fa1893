"""Sessions that are too slow for every change: `uvx nox -s NAME`."""

import sys
import tarfile
from pathlib import Path
from tempfile import TemporaryDirectory

import nox

nox.options.default_venv_backend = "uv"
nox.options.sessions = []


@nox.session
def sbom(session: nox.Session) -> None:
    """dist/sbom.json (CycloneDX) and dist/licenses.md of what the core install brings."""
    session.install(".")
    python = f"{session.virtualenv.location}/bin/python"
    session.run(
        *("uvx", "--from", "cyclonedx-bom", "cyclonedx-py", "environment", python),
        *("--pyproject", "pyproject.toml", "--output-file", "dist/sbom.json"),
        external=True,
    )
    session.run(
        *("uvx", "pip-licenses", "--python", python, "--format", "markdown", "--with-urls"),
        *("--from", "mixed", "--output-file", "dist/licenses.md"),
        external=True,
    )


@nox.session
def fuzz(session: nox.Session) -> None:
    """Break files for ten minutes, at random and as coverage guides."""
    session.install(".", "--group", "dev")
    names = (
        *("test_fuzz", "cli/test_invalid_arguments"),
        *("test_restricted_machines", "datasets/test_log_formats"),
    )
    tests = [f"tests/{name}.py" for name in names]
    at_random = ("--hypothesis-profile", "random")
    session.run("pytest", "-q", *at_random, *tests, env={"FUZZ_EXAMPLES": "200"})
    session.run("python", "tests/fuzz/run.py", "--seconds", "600")


@nox.session
def nightly(session: nox.Session) -> None:
    """Tests that take long."""
    session.install(".", "--group", "dev")
    session.run("pytest", "-q", "-m", "nightly", *session.posargs)


@nox.session
def interpreted(session: nox.Session) -> None:
    """Kernels against their plain twins, without the compiler."""
    session.install(".", "--group", "dev")
    env = {"NUMBA_DISABLE_JIT": "1"}
    session.run("pytest", "-q", "-m", "kernel", *session.posargs, env=env)


@nox.session
def coverage(session: nox.Session) -> None:
    """Lines that the tests run; of compiled kernels none counts."""
    session.install(".", "--group", "dev", "pytest-cov>=6")
    report = ("--cov=saccade", "--cov-report=term:skip-covered")
    session.run("pytest", "-q", *report, *session.posargs)


PYTHONS = ("3.11", "3.12", "3.13", "3.14")
PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"
EXTRAS = ".[parquet,hdf5,colmap,ros,cluster,serve,live]"
"""All but PyTorch, which is large."""
TESTING = (
    *("pytest>=8.2", "pytest-xdist>=3.6", "hypothesis>=6.100", "gtsam>=4.3"),
    *("pandas>=2.2", "polars>=2.1", "duckdb>=2.0", "evo>=1.30", "httpx>=0.27", "httpx2>=2.0"),
)
"""What these tests need besides the extras; always the newest."""


def run_tests(session: nox.Session) -> None:
    """Prints the versions of the libraries and runs the given tests, or all of them."""
    session.run("uv", "pip", "list", "--quiet", external=True)
    # Old libraries warn of what is new around them.
    session.run("pytest", "-q", "-W", "ignore::DeprecationWarning", *session.posargs)


@nox.session(python=PYTHONS)
def newest(session: nox.Session) -> None:
    """The newest of everything, on every Python."""
    session.install("--upgrade", ".", "--group", "dev")
    run_tests(session)


@nox.session(python=PYTHONS[0])
def oldest(session: nox.Session) -> None:
    """The oldest of everything that pyproject.toml allows."""
    session.install("--resolution", "lowest-direct", EXTRAS)
    session.install(*TESTING)
    run_tests(session)


NUMBAS = ("0.60", "0.61.2", "0.62", "0.63", "0.64", "0.65", "0.66", "0.67", "0.68")


@nox.session(python=PYTHONS[1])
@nox.parametrize("numba", NUMBAS)
def jit(session: nox.Session, numba: str) -> None:
    """The cache of compiled kernels, on each supported version of Numba."""
    session.install(".", *TESTING)
    session.install(f"numba=={numba}.*")
    session.run("pytest", "-q", "tests/test_jit.py")


@nox.session(python=PYTHONS[1])
@nox.parametrize("opencv", ["4", "5"])
def opencv(session: nox.Session, opencv: str) -> None:
    """Both of OpenCV's major versions."""
    wanted = f"opencv-python-headless=={opencv}.*"
    session.install("--upgrade", EXTRAS, wanted, *TESTING)
    run_tests(session)


WITHOUT_EXTRAS = ("test_packaging.py", "test_extras.py", "io", "attention", "keypoints")
"""Tests that pass with nothing but the core dependencies."""


@nox.session(venv_backend="none")
def wheel(session: nox.Session) -> None:
    """Wheel and sdist, each alone in a clean environment: `-- dist` takes those of that folder."""
    with TemporaryDirectory(prefix="saccade-wheel-") as folder:
        work = Path(folder)
        dist = Path(*session.posargs).resolve() if session.posargs else work / "dist"
        if not session.posargs:
            session.run("uv", "build", "--quiet", "--sdist", "--wheel", "--out-dir", str(dist))
        (built,), (sdist,) = dist.glob("*.whl"), dist.glob("*.tar.gz")
        session.run("uvx", "twine", "check", "--strict", str(built), str(sdist))
        with tarfile.open(sdist) as archive:
            archive.extractall(work, filter="data")
        source = work / sdist.name.removesuffix(".tar.gz")
        for package in (built, sdist):
            use_alone(session, package, source, work / f"from{package.suffix}")


def use_alone(session: nox.Session, package: Path, source: Path, home: Path) -> None:
    """Installs a package into a new environment in `home`; runs commands and the sdist's tests."""
    home.mkdir()
    scripts = home / "env" / "bin"
    saccade = str(scripts / "saccade")
    install = ("uv", "pip", "install", "--quiet", "--python", str(scripts / "python"))
    session.run("uv", "venv", "--quiet", "--python", PYTHON, str(home / "env"))
    session.run(*install, str(package))
    (data,) = (home / "env").glob("lib/*/site-packages/saccade/data")
    log = str(data / "victoria_park.txt")
    with session.chdir(home):
        version = session.run(saccade, "--version", silent=True)
        if version.split()[1] != source.name.rpartition("-")[2]:
            session.error(f"{package.name} prints the version {version}")
        session.run(saccade, "look", str(data / "coffee.jpg"), silent=True)
        session.run(saccade, "slam", log, silent=True)
        out = ("detect", str(data / "coffee.jpg"), "--format", "hdf5")
        refused = session.run(saccade, *out, success_codes=[2], silent=True)
        if "pysaccade[hdf5]" not in refused:
            session.error(f"without the extra `hdf5` it says {refused}")
    session.run(*install, "pytest>=8.2", "pytest-xdist>=3.6", "hypothesis>=6.100")
    with session.chdir(source):
        tests = [f"tests/{name}" for name in WITHOUT_EXTRAS]
        env = {"SACCADE_DIST": str(package.parent)}
        session.run(str(scripts / "pytest"), "-q", *tests, env=env)
