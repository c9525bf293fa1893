"""Images named on the command line, analyzed one by one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from saccade.cli.options import Options
from saccade.cli.output import INTERRUPTED, names_for, print_message, stop_on_interrupt, tracked
from saccade.errors import OutputError, SaccadeError
from saccade.io.files import is_invalid_name
from saccade.io.image import find_images

Row: TypeAlias = dict[str, Any]
"""Result of an image, for --json."""


@dataclass(frozen=True)
class ImageArguments(Options):
    """Images."""

    images: list[str]
    """Images, folders or quoted patterns."""


def analyze_each(
    images: Sequence[str], out: Path, analyze: Callable[[Path, str], Row]
) -> tuple[list[Row], int]:
    """Analyze images; errors in single files do not stop the run.

    Ctrl-C stops after the image in progress.

    Args:
        images: files, folders and patterns.
        out: the output folder, for messages.
        analyze: function of an image and the unique name of its results, returning its row.

    Returns:
        The rows, and the exit code of the command.

    Raises:
        SaccadeError: no file could be processed, or the results cannot be written.
    """
    paths = [path for each in images for path in find_images(each)]
    if len(paths) == 1:
        return [analyze(paths[0], paths[0].stem)], 0
    rows: list[Row] = []
    failed = 0
    with stop_on_interrupt("stopping after this image") as stopped:
        for path, name in tracked(names_for(paths).items(), f"{len(paths)} images", len(paths)):
            try:
                rows.append(analyze(path, name))
            except SaccadeError as error:
                if isinstance(error, OutputError) and not is_invalid_name(error):
                    raise
                failed += 1
                print_message(str(error))
            if stopped():
                break
    if failed and not rows:
        raise SaccadeError(f"none of {failed} images could be used")
    if failed:
        print_message(f"{failed} of {len(paths)} images left out; {out} has the other results")
    if stopped():
        print_message(f"stopped after {len(rows) + failed} of {len(paths)} images")
    return rows, INTERRUPTED if stopped() else int(failed > 0)
