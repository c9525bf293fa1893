"""The command line: a module for each command, imported when it is run.

Data goes to stdout, messages to stderr. Exit 0: done; 1: failed; 2: bad input.
Environment variables and streams of the process are changed only here, by the entry point: neither
`import saccade` nor a command called as a function changes them.
"""

import gc
import io
import logging
import os
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, ClassVar, NoReturn, cast

import typer
from typer import Option

from saccade import __version__
from saccade.cli.group import LazyGroup
from saccade.cli.output import print_data_warnings
from saccade.errors import ConfigError, OutputError, SaccadeError
from saccade.io.files import LARGEST_IMAGE, one_line

TRACEBACK = "SACCADE_TRACEBACK"
"""Environment variable: if set, unexpected errors end with a traceback."""
OPENCV_LIMITS = {
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(LARGEST_IMAGE),  # refused by its header, before decoding
    "OPENCV_FFMPEG_LOGLEVEL": "-8",  # quiet: errors are reported once, by us
}
"""Variables that OpenCV reads once, unless the user has set them."""
TERMINAL_SIZE = ("COLUMNS", "LINES", "TERMINAL_WIDTH")
"""Rich prints nothing where one is 0, and Typer fails where one is no number."""
OPENCV_NUMBERS = ("OPENCV_IO_MAX_IMAGE_", "OPENCV_IMGCODECS_", "OPENCV_THREAD_POOL_")
"""Prefixes of variables at which OpenCV aborts the process unless they are numbers."""
NUMBER = re.compile(r"\d{1,18}(KB|Kb|kb|MB|Mb|mb)?")


OBJECTS_PER_COLLECTION = 10_000
"""Imports and the compiler make a million objects, few of them garbage: with Python's 700, looking
for it takes a tenth of the time of a first command."""
_INTERRUPTED = "interrupted"

_UsageError = cast("type[Exception]", typer.BadParameter.__base__)
"""Base of the errors of Typer's own Click, which it does not export."""


class Evaluate(LazyGroup):
    """Evaluate against human fixations, other implementations and ground truth."""

    prefix = "saccade.cli.evaluate_"
    panels: ClassVar = {
        "Images": {
            "fixations": "evaluate fixations --images photos --fixations fixations.csv",
            "scanpaths": "evaluate scanpaths --images photos --fixations fixations.csv",
            "features": "evaluate features --pairs oxford --detector opencv",
        },
        "Maps": {
            "trajectory": "evaluate trajectory mapped/trajectory.tum --truth groundtruth.tum",
        },
    }


class Saccade(LazyGroup):
    """All commands."""

    prefix = "saccade.cli."
    groups: ClassVar = {"evaluate": Evaluate}
    panels: ClassVar = {
        "Images": {
            "look": "look photo.jpg --fixations 5 --out looked",
            "detect": "detect photos --max 500 --spread --format hdf5",
            "match": "match left.jpg right.jpg --geometry homography",
            "fit": "fit --images photos --fixations fixations.csv --out mine.toml",
        },
        "Many images": {
            "extract": "extract photos --what sift --out features",
            "find": "find photo.jpg --in features",
        },
        "Maps": {
            "slam": "slam victoria_park.txt --out mapped",
            "drive": "drive KITTI/07 --out mapped",
            "check": "check kitti/07",
            "simulate": "simulate drive --preset repeated --seed 7 --out ring",
        },
        "More": {
            "convert": "convert victoria_park.txt park.g2o",
            "evaluate": "",
            "textbook": "textbook photo.jpg --module my_contrast.py",
            "serve": "serve --port 8014",
            "demo": "demo --out saccade-demo",
            "config": "config sift --preset opencv > sift.toml",
        },
    }


app = typer.Typer(
    name="saccade",
    cls=Saccade,
    help="Active vision: visual attention, interest points and EKF-SLAM.",
    epilog="Start with: saccade demo",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"saccade {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    logging.basicConfig(format="saccade: %(message)s", stream=sys.stderr)
    logging.getLogger("saccade").setLevel(logging.INFO)
    print_data_warnings()


def prepare_streams() -> None:
    """Escape what a stream cannot encode; replace streams that the parent process has closed."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115 - until the end
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def prepare_libraries() -> None:
    """Set a Matplotlib backend without a display and limits of OpenCV; unset bad terminal sizes.

    Garbage is collected less often.

    Raises:
        ConfigError: OpenCV would abort the process because of a variable.
    """
    gc.set_threshold(OBJECTS_PER_COLLECTION)
    os.environ["MPLBACKEND"] = "agg"  # figures go into files
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it reports its font cache
    for name, value in OPENCV_LIMITS.items():
        os.environ.setdefault(name, value)
    for name in TERMINAL_SIZE:
        value = os.environ.get(name, "1")
        if not value.isdecimal() or int(value) < 1:
            del os.environ[name]
    for name, value in os.environ.items():
        if name.startswith(OPENCV_NUMBERS) and not NUMBER.fullmatch(value):
            raise ConfigError(f"{name}: expected a number for OpenCV, found {value!r}; unset it")


def main() -> None:
    """Run a command; every error ends in one line on stderr and an exit code."""
    prepare_streams()
    try:
        prepare_libraries()
        code = app(standalone_mode=False) or 0
        if sys.stdout is not None:
            sys.stdout.flush()
    except OutputError as error:
        _end(str(error), 1)
    except SaccadeError as error:
        _end(str(error), 2)
    except _UsageError as error:
        _end_usage(error)
    except (KeyboardInterrupt, typer.Abort):
        _end(_INTERRUPTED, 130)
    except MemoryError as error:
        _end(f"not enough memory: {error}", 1)
    except OSError as error:
        _discard_stdout()
        _end(f"{error.filename or 'standard output'}: {error.strerror or error}", 1)
    except Exception as error:  # of a library, in an unexpected environment
        if os.environ.get(TRACEBACK):
            raise
        _end(f"{type(error).__name__}: {one_line(error)}; set {TRACEBACK}=1 for a traceback", 1)
    if code == 130:  # Typer returns it on Ctrl-C
        _end(_INTERRUPTED, 130)
    sys.exit(code)


def _end_usage(error: Any) -> NoReturn:
    """End because of an error in the command line."""
    message = " ".join(error.format_message().split())
    if not message:  # no arguments: the help is printed already
        sys.exit(2)
    hint = f"; see {error.ctx.command_path} --help" if error.ctx is not None else ""
    _end(f"{message.rstrip('.')}{hint}", 2)


def _end(message: str, code: int) -> NoReturn:
    with suppress(OSError):  # of a disk that is full behind stderr too
        print(f"saccade: {message}", file=sys.stderr)
    sys.exit(code)


def _discard_stdout() -> None:
    """Redirect stdout to the null device, or the interpreter would flush it again at exit."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
