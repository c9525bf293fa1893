"""The fixations that commands score, and the images that they are on."""

from pathlib import Path

import numpy as np

from saccade.cli.output import print_message
from saccade.datasets.fixations import read_fixations
from saccade.errors import LogError
from saccade.files import is_file
from saccade.types import FixationTable, select_rows


def load_fixations(file: Path, images: Path, only_present: bool) -> FixationTable:
    """The fixations of a file, each on an image of a folder.

    Args:
        file: the fixations.
        images: the folder.
        only_present: whether fixations on absent images are left out, with a message.

    Raises:
        LogError: the file is broken, or an image is absent; all of them, with `only_present`.
    """
    table = read_fixations(file)
    names = np.unique(table.image)
    absent = [name for name in names if not is_file(images / name)]
    if not absent:
        return table
    found = f"{len(absent)} of the {len(names)} images of {file} are not in {images}"
    if not only_present:
        raise LogError(f"{found}, {absent[0][:80]} first; --only-present leaves them out")
    if len(absent) == len(names):
        raise LogError(f"{found}, {absent[0][:80]} first")
    print_message(f"{found} and are left out")
    return select_rows(table, ~np.isin(table.image, absent))
