"""Environment variables and streams of the process of a command.

Changed only here, and only by the entry point: neither `import saccade` nor a command called as a
function changes them.
"""

import gc
import io
import logging
import os
import re
import sys
from pathlib import Path

from saccade.errors import ConfigError
from saccade.io.files import LARGEST_IMAGE

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
