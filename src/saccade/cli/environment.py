"""What surrounds a command: mended where it does not matter, refused where a library would abort.

What else libraries make of an environment that they did not foresee ends in `saccade.cli.main`.
"""

import io
import os
import re
import sys
from pathlib import Path

from saccade.errors import ConfigError
from saccade.files import LARGEST_IMAGE

WIDTHS = ("COLUMNS", "LINES", "TERMINAL_WIDTH")
"""Of the terminal; rich prints nothing where one is 0, Typer takes no word for a number."""
NUMBERS = ("OPENCV_IO_MAX_IMAGE_", "OPENCV_IMGCODECS_", "OPENCV_THREAD_POOL_")
"""What names begin with whose values are numbers: OpenCV aborts the process at any other."""
LIMITS = {
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(LARGEST_IMAGE),  # refused by its header, before decoding
    "OPENCV_FFMPEG_LOGLEVEL": "-8",  # quiet: errors are reported once, by us
}
"""Variables that OpenCV reads once, unless the user has set them."""
BYTES = re.compile(r"\d{1,18}(KB|Kb|kb|MB|Mb|mb)?")


def prepare_streams() -> None:
    """Let every text be written: a name may be no text, and a terminal may know ASCII alone."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by whoever started us
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115 - until the end
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def prepare_libraries() -> None:
    """Leave libraries no variable that they stumble over.

    Raises:
        ConfigError: OpenCV would end the process at the value of one.
    """
    os.environ["MPLBACKEND"] = "agg"  # figures go into files
    for name, value in LIMITS.items():
        os.environ.setdefault(name, value)
    for name in WIDTHS:
        value = os.environ.get(name, "1")
        if not value.isdecimal() or int(value) < 1:
            del os.environ[name]
    for name, value in os.environ.items():
        if name.startswith(NUMBERS) and not BYTES.fullmatch(value):
            raise ConfigError(f"{name}: expected a number for OpenCV, found {value!r}; unset it")
