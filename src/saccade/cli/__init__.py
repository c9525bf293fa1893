"""The command line: one file per command, thin.

Data goes to stdout, messages to stderr. Exit 0: done; 1: failed; 2: bad input.
"""

import logging
import sys
from typing import Annotated

import typer

from saccade import __version__
from saccade.cli.config import config
from saccade.cli.demo import demo
from saccade.cli.detect import detect
from saccade.cli.evaluate import evaluate
from saccade.cli.look import look
from saccade.cli.match import match
from saccade.cli.slam import slam
from saccade.errors import OutputError, SaccadeError

app = typer.Typer(
    name="saccade",
    help="Active vision: where to look, what to keep, and the map it makes.",
    epilog="Start with: saccade demo",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command(epilog="Example: saccade look photo.jpg --fixations 5 --out looked")(look)
app.command(epilog="Example: saccade detect photo.jpg --preset opencv --max 500")(detect)
app.command(epilog="Example: saccade match left.jpg right.jpg --ratio 0.75")(match)
app.command(epilog="Example: saccade slam victoria_park.txt --out mapped")(slam)
app.command(epilog="Example: saccade demo --out saccade-demo")(demo)
app.add_typer(evaluate, name="evaluate")
app.command(epilog="Example: saccade config sift --preset opencv > sift.toml")(config)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"saccade {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    logging.basicConfig(format="saccade: %(message)s", stream=sys.stderr)
    logging.getLogger("saccade").setLevel(logging.INFO)


def main() -> None:
    """Run a command; turn what is wrong with its input into one line and an exit code."""
    try:
        app()
    except SaccadeError as error:
        print(f"saccade: {error}", file=sys.stderr)
        sys.exit(1 if isinstance(error, OutputError) else 2)
    except KeyboardInterrupt:
        print("saccade: interrupted", file=sys.stderr)
        sys.exit(130)
