"""Images named on the command line, analyzed one by one."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from cyclopts import Parameter

from saccade.cli.output import INTERRUPTED, names_for, print_message, stop_on_interrupt, tracked
from saccade.errors import ImageError, OutputError, SaccadeError
from saccade.io.files import is_invalid_name, natural_order
from saccade.io.image import find_images
from saccade.io.preparation import warnings_of

Row: TypeAlias = dict[str, Any]
"""Result of an image, for --json."""


Images: TypeAlias = Annotated[
    str,
    Parameter(help="Images, folders with their subfolders, or quoted patterns.", required=True),
]

RESULTS = (".look.", ".keypoints.", ".match.")
"""Parts of the names of figures that the commands write."""


def images_of(source: str, out: Path) -> list[Path]:
    """The images of a file, a folder with its subfolders, or a pattern, without own results.

    Args:
        source: file, folder or pattern.
        out: the output folder, whose figures and maps are no images to analyze.

    Raises:
        ImageError: as `find_images`.
    """
    folder = Path(source)
    if not (source and folder.is_dir()):
        found = find_images(source)
        return found if found == [folder] else [each for each in found if not is_own(each, out)]
    inside = [each for each in folder.rglob("*") if each.is_dir()]
    visible = [each for each in inside if not each.relative_to(folder).as_posix().startswith(".")]
    found = []
    for each in sorted(visible, key=natural_order):
        with suppress(ImageError):
            found += find_images(each)
    with suppress(ImageError) if found else nullcontext():
        found = [*find_images(folder), *found]
    images = [each for each in found if not is_own(each, out)]
    if not images:
        raise ImageError(f"{source}: expected images, found figures of an earlier run alone")
    return images


def names_below(sources: Sequence[str], out: Path) -> dict[Path, str]:
    """Names of images below the folder, or the fixed part of the pattern, that they come from."""
    names: dict[Path, str] = {}
    for source in sources:
        folder = Path(source)
        while not folder.is_dir() and folder != folder.parent:
            folder = folder.parent
        names |= {each: each.relative_to(folder).as_posix() for each in images_of(source, out)}
    return names


def is_own(path: Path, out: Path) -> bool:
    """Whether an image is a figure or a map that a command wrote to its output folder."""
    path, out = path.absolute(), out.absolute()
    if not path.is_relative_to(out):
        return False
    return path.relative_to(out).parts[0] == "maps" or any(each in path.name for each in RESULTS)


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
    paths = [path for each in images for path in images_of(each, out)]
    if len(paths) == 1:
        with warnings_of(str(paths[0])):
            return [analyze(paths[0], paths[0].stem)], 0
    rows: list[Row] = []
    failed = 0
    with stop_on_interrupt("stopping after this image") as stopped:
        for path, name in tracked(names_for(paths).items(), f"{len(paths)} images", len(paths)):
            try:
                with warnings_of(str(path)):
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
