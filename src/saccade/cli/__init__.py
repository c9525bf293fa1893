"""The command line: a module for each command, imported when it is run.

Data goes to stdout, messages to stderr. Exit 0: done; 1: failed; 2: bad input.
Only the entry point in this module changes environment variables and streams of the process;
neither `import saccade` nor a command called as a function does.
"""

import gc
import io
import logging
import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from inspect import getdoc
from pathlib import Path
from typing import Any, NoReturn

from cyclopts import App, CycloptsError, Group, Parameter, UnknownCommandError

from saccade import __version__
from saccade.cli.output import INTERRUPTED, Result, emit, print_data_warnings
from saccade.errors import OutputError, SaccadeError, printable
from saccade.io.files import LARGEST_IMAGE, one_line

TRACEBACK = "SACCADE_TRACEBACK"
"""Environment variable: if set, unexpected errors end with a traceback."""
OPENCV_LIMITS = {
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(LARGEST_IMAGE),  # rejected from the header, before decoding
    "OPENCV_FFMPEG_LOGLEVEL": "-8",  # quiet: saccade reports errors itself
}
"""Variables that OpenCV reads once, unless the user has set them."""
THREADED = ("match", "evaluate")
"""Commands with matrix products large enough for threads of BLAS. Elsewhere these would only wait,
which doubles the processor time of importing NumPy."""
OBJECTS_PER_COLLECTION = 10_000
"""Allocation threshold of the garbage collector. With Python's default of 700, collection takes a
tenth of the time of a first command, since imports and the compiler allocate a million objects."""

COMMANDS = {
    "Images": {
        "look": "Compute saliency maps and a scanpath.",
        "detect": "Detect and describe keypoints.",
        "match": "Match the keypoints of two or more images.",
        "fit": "Fit a saliency model to your own photographs and fixations.",
        "extract": "Extract features of many images into a Parquet data set.",
    },
    "Maps": {
        "slam": "Map the landmarks of a recorded log with an extended Kalman filter.",
        "merge": "Merge maps of several runs into one, in the frame of the first.",
        "drive": "Map a camera drive: visual odometry, keypoint landmarks and EKF-SLAM.",
        "check": "Check a camera drive or a landmark log for errors before mapping.",
        "simulate": "Simulate a landmark log or a camera drive, with ground truth.",
        "tags": "Write tags to print, for robots with a camera.",
    },
    "More": {
        "convert": "Convert a landmark log or extracted keypoints to another format.",
        "textbook": "Walk through the equations of the source with a photograph or a log.",
        "serve": "Serve an interactive page for photographs and for SLAM.",
        "demo": "Run look, match, slam and drive on built-in data, and write index.html.",
        "config": "Print a configuration as TOML.",
    },
}
"""Commands by help panel, with the first lines of their docstrings. Command NAME is the function
NAME in the module `saccade.cli.NAME`, which is imported when the command runs."""
HELP = {"--help", "-h"}
"""Options that print the help of a command."""
USAGES = {"match": "Usage: saccade match [OPTIONS] FIRST [SECOND]"}
"""Usage of commands whose last argument is optional."""
EVALUATIONS = {
    "Images": {
        "fixations": "Score saliency maps by how well they predict human fixations.",
        "scanpaths": "Score scanpaths by their similarity to human scanpaths.",
        "features": "Score detectors and descriptors on image pairs related by a homography.",
    },
}
"""Commands of `saccade evaluate` by help panel; NAME is in the module
`saccade.cli.evaluate_NAME`."""


def _shown_default(value: object) -> str | None:
    return None if value is None or value is False else str(value)


def _joined_lines(text: str) -> str:
    """The text with each paragraph on one line."""
    return re.sub(r"(?<!\n)\n *(?!\n)", " ", text)


class _HelpFormatter:
    """Prints help as cyclopts does; Markdown, for texts of several lines, would take .1 s more."""

    def render_usage(self, console: Any, options: Any, usage: Any) -> None:
        from cyclopts.help.formatters import DefaultFormatter

        DefaultFormatter().render_usage(console, options, usage)

    def __call__(self, console: Any, options: Any, panel: Any) -> None:
        from cyclopts.help.formatters import DefaultFormatter
        from rich.text import Text

        for each in panel.entries:
            text = each.description.primary_renderable
            if isinstance(text, Text):
                text.plain = _joined_lines(text.plain)
        DefaultFormatter()(console, options, panel)


def _application() -> App:
    """All commands."""
    app = App(
        "saccade",
        help="Active vision: visual attention, interest points and EKF-SLAM.\n\n"
        "Start with: saccade demo",
        version=f"saccade {__version__}",
        default_parameter=Parameter(negative="", show_default=_shown_default),
        group_commands="Options",
        help_format="plaintext",
        help_formatter=_HelpFormatter(),
        group_parameters=Group("Options", sort_key=1),
    )
    evaluate = App(
        "evaluate",
        help="Evaluate against human fixations, other implementations and ground truth.",
        group="More",
    )
    app.command(evaluate)
    for parent, module, panels in (
        (app, "saccade.cli.", COMMANDS),
        (evaluate, "saccade.cli.evaluate_", EVALUATIONS),
    ):
        for panel, commands in panels.items():
            for number, (name, summary) in enumerate(commands.items()):
                options: Any = {"help": summary, "group": panel, "sort_key": number}
                options["usage"] = USAGES.get(name)
                path = f"{module}{name}:{name}"
                parent.command(path, name, **options)
    app.register_install_completion_command()
    return app


app = _application()


def run_command(words: Sequence[str]) -> int:
    """Run a command, print its result, and return the exit code.

    Raises:
        CycloptsError: unknown command, or invalid options.
        SaccadeError: invalid input, or failed output.
    """
    asked = [each for each in words if each not in HELP]
    _, apps, rest = app.parse_commands(asked)
    for each in apps:
        if each.default_command is not None:
            each.help = _joined_lines(getdoc(each.default_command) or "")
    unknown = rest and apps[-1].default_command is None
    if len(asked) < len(words) and not unknown:
        app.help_print(asked)
        return 0
    command, bound, _ = app.parse_args(words, print_error=False, exit_on_error=False)
    bound.apply_defaults()
    result = command(*bound.args, **bound.kwargs)
    if not isinstance(result, Result):
        return 0 if words else 2
    emit(result, as_json=bound.arguments["options"].as_json)
    return result.code


def prepare_streams() -> None:
    """Escape characters that a stream cannot encode; replace streams that the parent closed."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115 - until the end
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def prepare_libraries() -> None:
    """Set a Matplotlib backend, limits of OpenCV and threads of BLAS; collect garbage less."""
    gc.set_threshold(OBJECTS_PER_COLLECTION)
    os.environ["MPLBACKEND"] = "agg"  # figures go into files
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # silence its remarks on the font cache
    for name, value in OPENCV_LIMITS.items():
        os.environ.setdefault(name, value)
    if HELP & {*sys.argv} or not {*sys.argv[1:2]} & {*THREADED}:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> None:
    """Run a command; every error ends in one line on stderr and an exit code."""
    prepare_streams()
    logging.basicConfig(format="saccade: %(message)s", stream=sys.stderr)
    logging.getLogger("saccade").setLevel(logging.INFO)
    print_data_warnings()
    try:
        prepare_libraries()
        code = run_command(sys.argv[1:])
        sys.stdout.flush()
    except OutputError as error:
        _end(str(error), 1)
    except SaccadeError as error:
        _end(str(error), 2)
    except CycloptsError as error:
        command = " ".join(("saccade", *(error.command_chain or ())))
        _end(f"{_usage_error(error).rstrip('.')}; see {command} --help", 2)
    except KeyboardInterrupt:
        _end("interrupted", INTERRUPTED)
    except MemoryError as error:
        _end(f"not enough memory: {error}", 1)
    except OSError as error:
        _discard_stdout()
        _end(f"{error.filename or 'standard output'}: {error.strerror or error}", 1)
    except Exception as error:  # from a library, in an unexpected environment
        if os.environ.get(TRACEBACK):
            raise
        _end(f"{type(error).__name__}: {one_line(error)}; set {TRACEBACK}=1 for a traceback", 1)
    sys.exit(code)


def _usage_error(error: CycloptsError) -> str:
    """The error in one line, without the imports that cyclopts needs for an unknown command."""
    if not isinstance(error, UnknownCommandError):
        return one_line(error)
    word = "".join((error.unused_tokens or [])[:1])
    near = get_close_matches(word, list(error.app or app), 1)
    return " ".join((f'Unknown command "{word}".', *(f'Did you mean "{each}"?' for each in near)))


def _end(message: str, code: int) -> NoReturn:
    with suppress(OSError):  # stderr may be on a full disk too
        print(f"saccade: {printable(message)}", file=sys.stderr)
    sys.exit(code)


def _discard_stdout() -> None:
    """Redirect stdout to the null device, so that the interpreter does not flush it at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
