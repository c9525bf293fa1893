"""The command line: one file per command, thin.

Data goes to stdout, messages to stderr. Exit 0: done; 1: failed; 2: bad input.
"""

import logging
import os
import sys
from contextlib import suppress
from typing import Annotated, Any, NoReturn, cast

import typer
from typer import Option

from saccade import __version__
from saccade.cli.check import check
from saccade.cli.config import config
from saccade.cli.convert import convert
from saccade.cli.demo import demo
from saccade.cli.detect import detect
from saccade.cli.drive import drive
from saccade.cli.environment import prepare_libraries, prepare_streams
from saccade.cli.evaluate import evaluate
from saccade.cli.export import export
from saccade.cli.extract import extract
from saccade.cli.find import find
from saccade.cli.fit import fit
from saccade.cli.index import index
from saccade.cli.look import look
from saccade.cli.match import match
from saccade.cli.merge_maps import merge_maps
from saccade.cli.options import Command
from saccade.cli.output import print_data_warnings
from saccade.cli.serve import serve
from saccade.cli.simulate import simulate
from saccade.cli.slam import slam
from saccade.cli.textbook import textbook
from saccade.errors import OutputError, SaccadeError
from saccade.io.files import one_line

TRACEBACK = "SACCADE_TRACEBACK"
"""Environment variable: if set, unexpected errors end with a traceback."""
_INTERRUPTED = "interrupted"

_UsageError = cast("type[Exception]", typer.BadParameter.__base__)
"""Base of the errors of Typer's own Click, which it does not export."""

app = typer.Typer(
    name="saccade",
    help="Active vision: visual attention, interest points and EKF-SLAM.",
    epilog="Start with: saccade demo",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command(cls=Command, epilog="Example: saccade look photo.jpg --fixations 5 --out looked")(look)
app.command(cls=Command, epilog="Example: saccade detect photos --max 500 --spread --format hdf5")(
    detect
)
app.command(cls=Command, epilog="Example: saccade extract photos --what sift --out features")(
    extract
)
app.command(
    cls=Command, epilog="Example: saccade export features --format colmap --out database.db"
)(export)
app.command(cls=Command, epilog="Example: saccade index features")(index)
app.command(cls=Command, epilog="Example: saccade find photo.jpg --in features")(find)
app.command(
    cls=Command,
    epilog="Example: saccade fit --images photos --fixations fixations.csv --out mine.toml",
)(fit)
app.command(cls=Command, epilog="Example: saccade match left.jpg right.jpg --geometry homography")(
    match
)
app.command(cls=Command, epilog="Example: saccade slam victoria_park.txt --out mapped")(slam)
app.command(
    cls=Command, epilog="Example: saccade merge-maps monday.npz tuesday.npz --out office.npz"
)(merge_maps)
app.command(cls=Command, epilog="Example: saccade check kitti/07")(check)
app.command(cls=Command, epilog="Example: saccade convert victoria_park.txt park.g2o")(convert)
app.command(cls=Command, epilog="Example: saccade drive KITTI/07 --out mapped")(drive)
app.command(cls=Command, epilog="Example: saccade textbook photo.jpg --module my_contrast.py")(
    textbook
)
app.command(cls=Command, epilog="Example: saccade serve --port 8014")(serve)
app.command(cls=Command, epilog="Example: saccade demo --out saccade-demo")(demo)
app.add_typer(evaluate, name="evaluate")
app.add_typer(simulate, name="simulate")
app.command(cls=Command, epilog="Example: saccade config sift --preset opencv > sift.toml")(config)


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
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it reports its font cache
    print_data_warnings()


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
