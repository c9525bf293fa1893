"""Fixations: tables of any lab, EyeLink's and Tobii's recordings, and `.mat` files as of OSIE."""

import re
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.datasets.fixation_tables import (
    ROLES,
    Box,
    FixationList,
    RawFixation,
    read_eyelink,
    read_fixation_table,
)
from saccade.datasets.matlab import read_matlab
from saccade.datasets.tables import write_table
from saccade.errors import LogError, LogWarning, require
from saccade.io.files import IMAGE_SUFFIXES, atomic_write, is_file, reading
from saccade.io.image import read_image
from saccade.types import FixationTable, FloatArray, IntArray

Names = npt.NDArray[np.str_]

NORMALIZED = (-0.5, 1.5)
"""Range of normalized coordinates, with that of the fixations beside the image."""
OUTSIDE = 0.2
"""Fraction of the fixations outside their images from which coordinates are refused; 0 to .01 is
usual."""
SHIFTED = 0.03
"""Fraction outside where a shift brings three quarters inside; below it, a warning."""
FEWEST = 5
"""Fixations outside from which they are judged."""
MIDDLE = 50
"""Fixations from which some reach the middle of their images."""
EXTENT = (0.02, 0.98)
"""Quantiles taken for the borders of all fixations: blinks are beyond."""
PIXELS = "--xy pixels takes them as they are"


def list_folder(folder: Path) -> list[Path]:
    """Content of a folder, by name; nothing where there is none.

    Raises:
        LogError: it cannot be read.
    """
    with reading(folder, LogError):
        return sorted(folder.iterdir()) if folder.is_dir() else []


def resolve_images(names: Names, folder: Path) -> Names:
    """The file of each image: of this name, or with another case, without a folder or suffix.

    Args:
        names: (n,) as in a table.
        folder: of the images.

    Returns:
        (n,) names of files; those of which there is none stay as they are.

    Raises:
        LogError: a name without suffix fits several files.
    """
    files: dict[str, list[str]] = {}
    for name in (path.name for path in list_folder(folder)):
        if name.lower().endswith(IMAGE_SUFFIXES):
            for key in {name.casefold(), Path(name).stem.casefold()}:
                files.setdefault(key, []).append(name)
    unique, inverse = np.unique(names, return_inverse=True)
    resolved = []
    for name in unique:
        fits = files.get(PureWindowsPath(str(name)).name.casefold(), [])
        if is_file(folder / str(name)) or not fits:
            fits = [str(name)]
        if len(fits) > 1:
            raise LogError(f"{folder}: the image {name} could be {' or '.join(fits)}")
        resolved.append(fits[0])
    return np.array(resolved)[inverse]


def image_sizes(names: Names, folder: Path) -> FloatArray:
    """(n, 2) width and height of the image of each name.

    Raises:
        ImageError: an image cannot be read.
    """
    unique, inverse = np.unique(names, return_inverse=True)
    shapes = [read_image(folder / str(name)).shape for name in unique]
    return np.array([(shape[1], shape[0]) for shape in shapes], np.float64)[inverse]


def to_image_pixels(xy: FloatArray, boxes: Sequence[Box | None], sizes: FloatArray) -> FloatArray:
    """Positions in the pixels of images, of positions on the screen.

    Args:
        xy: (n, 2) positions in the units of the boxes.
        boxes: (n,) where the images were; None for positions that are in their pixels already.
        sizes: (n, 2) of the images, width and height in pixels.
    """
    moved = np.array([box is not None for box in boxes])
    if not moved.any():
        return xy
    x, y, width, height, centered = np.array(
        [box for box in boxes if box is not None], np.float64
    ).T
    shown = np.where(np.isnan([width, height]), sizes[moved].T, [width, height])
    corner = np.array([x, y]) - centered * shown / 2
    pixels = (xy[moved] - corner.T) * (sizes[moved] / shown.T)
    placed = xy.copy()
    placed[moved] = np.round(pixels, 6)  # those in decimals are as they were before division
    return placed


def check_positions(source: str, xy: FloatArray, sizes: FloatArray) -> str:
    """Refuse positions that cannot be in the pixels of their images.

    Args:
        source: for the message.
        xy: (n, 2) positions.
        sizes: (n, 2) of the images.

    Returns:
        A remark on positions that may be elsewhere, or nothing.

    Raises:
        LogError: they are normalized, on the screen, or on smaller images; says what is to be done.
    """
    low, high = np.quantile(xy, EXTENT, axis=0)
    side = np.median(sizes, axis=0)
    size = f"{side[0]:.0f} x {side[1]:.0f}"
    found = f"{source}: expected positions in pixels of the images ({size}), found"
    span = f"x from {low[0]:.3g} to {high[0]:.3g} and y from {low[1]:.3g} to {high[1]:.3g}"
    if (low >= NORMALIZED[0]).all() and (high <= NORMALIZED[1]).all() and side.min() > 8:
        raise LogError(f"{found} {span}: normalized; pass --xy normalized ({PIXELS})")
    if len(xy) >= MIDDLE and (high < side / 2).all() and (high - low < side / 2).all():
        raise LogError(
            f"{found} {span}: smaller units? pass --xy WIDTH,HEIGHT, the size of the images in the "
            "units of x and y (100,100 of percent), and --offset X,Y, if their upper left corner "
            f"is not 0,0 ({PIXELS})"
        )
    outside = _outside(xy, sizes)
    if outside.sum() < FEWEST:
        return ""
    found += f" {outside.sum()} of {len(xy)} fixations outside"
    shift = np.round(np.quantile(xy - sizes / 2, EXTENT, axis=0).mean(axis=0))
    if 4 * _outside(xy - shift, sizes).sum() < outside.sum():
        found += (
            ", on one side: positions on the screen? pass --offset X,Y, the images' upper left "
            f"corner on it (about {shift[0]:.0f},{shift[1]:.0f} by the fixations; {PIXELS})"
        )
        if outside.mean() > SHIFTED:
            raise LogError(found)
        return found
    if outside.mean() > OUTSIDE:
        raise LogError(
            f"{found} ({span}); pass --xy WIDTH,HEIGHT, the size of the images on the screen, and "
            f"--offset X,Y, their upper left corner on it ({PIXELS})"
        )
    return ""


def _outside(xy: FloatArray, sizes: FloatArray) -> npt.NDArray[np.bool_]:
    """(n,) whether positions are outside their images, whose first pixel is about (0, 0)."""
    pixels = np.floor(xy + 0.5)
    return np.asarray(((pixels < 0) | (pixels >= sizes)).any(axis=1))


DURATION = "duration_ms"
TABLES = (".csv", ".tsv", ".txt")
_Cells = npt.NDArray[np.object_]


@dataclass(frozen=True)
class FixationFormat:
    """Format of fixations, where a file does not say it by itself."""

    columns: Mapping[str, str] = field(default_factory=dict)
    """Columns by what they hold: image, viewer, index, time, x, y, duration."""
    shown: tuple[float, float] | None = None
    """Size of the images on the screen, in the units of x and y: (1, 1) if these are normalized.
    None for that of the files, in pixels."""
    offset: tuple[float, float] | None = None
    """x and y of the images' upper left corner; None for (0, 0)."""
    checked: bool = True
    """Whether positions that cannot be in the pixels of the images are refused."""

    def __post_init__(self) -> None:
        """Check the settings."""
        unknown = sorted(self.columns.keys() - set(ROLES))
        require(not unknown, "--columns", f"names of {', '.join(ROLES)}", ", ".join(unknown))
        if self.shown is not None:
            require(min(self.shown) > 0, "--xy", "a width and a height", self.shown)


def _warn(message: str) -> None:
    warnings.warn(message, LogWarning, stacklevel=4)


def read_fixations(
    path: str | Path,
    images: str | Path | None = None,
    form: FixationFormat | None = None,
    *,
    only_present: bool = False,
    say: Callable[[str], None] = _warn,
) -> FixationTable:
    """The fixations in a file, or in those of a folder.

    A row with an empty cell, as of a blink, is left out, and so is one that repeats another, which
    is counted in a remark. `FixationTable.subject` is the subject's number, or, where subjects
    have names, the place of the name among them. `FixationTable.index` is that of the file less
    the first one (0 or 1), so that it is 0 for the first fixation of a scanpath; where a file has
    times, or numbers that go on from image to image, the rank among the fixations of the scanpath.

    Args:
        path: a table separated by commas, semicolons or tabs, with columns of image, viewer, x
            and y, and where it has them, index or time, and duration, by their usual names; an
            export of Tobii Pro Lab (.tsv); a recording of EyeLink (.asc); a .mat in the layout of
            OSIE's `fixations.mat` (Xu et al., Journal of Vision 2014); or a folder of tables and
            recordings, of a viewer each where they do not name one.
        images: folder of the images: names without suffix are completed, and positions are
            converted to pixels of the images and checked. None to take both as they are.
        form: columns of other names, and where images were on the screen.
        only_present: whether fixations on images that are not in the folder are left out.
        say: called with each remark on what was left out or assumed; a `LogWarning` by default.

    Returns:
        Fixations by image, viewer and index.

    Raises:
        LogError: the file is missing or broken, with the line; an image is absent, all of them,
            with `only_present`; or positions are not in the pixels of the images.
        ConfigError: a column that is not in the file.
        ImageError: an image cannot be read.
    """
    path, form = Path(path), form or FixationFormat()
    if path.suffix.lower() == ".mat":
        recording = FixationList(_mat_rows(path), "index")
    else:
        recording = _recording(path, form.columns)
    fixations = _complete(path, recording, say)
    image = np.array([each.image for each in fixations])
    xy = np.array([(each.x, each.y) for each in fixations])
    if images is not None:
        image = resolve_images(image, Path(images))
        present = _present(path, image, Path(images), only_present, say)
        image, xy = image[present], xy[present]
        fixations = [each for each, kept in zip(fixations, present, strict=True) if kept]
        sizes = image_sizes(image, Path(images))
        boxes: Sequence[Box | None] = [each.box for each in fixations]
        if form.shown is not None or form.offset is not None:
            boxes = [Box(*(form.offset or (0, 0)), *(form.shown or ()))] * len(fixations)
        xy = to_image_pixels(xy, boxes, sizes)
        if form.checked:
            remark = check_positions(str(path), xy, sizes)
            if remark:
                say(remark)
    viewer = _viewer_numbers(path, [each.viewer for each in fixations], say)
    order = np.array([each.order for each in fixations])
    seconds = np.array([each.milliseconds for each in fixations]) / 1000
    table = FixationTable(
        image,
        viewer,
        _indices(path, image, viewer, order, recording.order, say),
        xy,
        None if np.isnan(seconds).all() else seconds,
    )
    return table[np.lexsort((order, table.subject, table.image))]


def _recording(path: Path, columns: Mapping[str, str]) -> FixationList:
    """The fixations of a table, of an .asc, or of all of those in a folder."""
    if not path.is_dir():
        if path.suffix.lower() != ".asc":
            return read_fixation_table(path, columns)
        foreign = ", ".join(sorted(columns.keys() - {"image"}))
        require(not foreign, "--columns", "image alone of an EyeLink recording", foreign)
        return read_eyelink(path, columns)
    files = [each for each in list_folder(path) if each.suffix.lower() in (".asc", *TABLES)]
    if not files:
        raise LogError(f"{path}: expected tables or recordings ({', '.join(TABLES)}, .asc)")
    parts = [
        _recording(each, columns)
        if each.suffix.lower() == ".asc"
        else read_fixation_table(each, columns, viewer=each.stem)
        for each in files
    ]
    orders = {part.order for part in parts}
    if len(orders) > 1:
        found = " and some with ".join(sorted(orders))
        raise LogError(f"{path}: expected files of one kind, found some with {found}")
    left_out = sum((Counter(part.left_out) for part in parts), Counter())
    return FixationList([each for part in parts for each in part.fixations], orders.pop(), left_out)


def _complete(path: Path, recording: FixationList, say: Callable[[str], None]) -> list[RawFixation]:
    """The fixations with a position, each once."""
    found = [each for each in recording.fixations if np.isfinite([each.x, each.y]).all()]
    blank = len(recording.fixations) - len(found)
    if not found:
        raise LogError(f"{path}: expected at least one fixation, found none")
    order = recording.order
    once = {
        (
            *(each.image, each.viewer, each.x, each.y),
            str(each.milliseconds) if order == "row" else each.order,
        ): each
        for each in reversed(found)
    }
    places = {(each.image, each.viewer, each.order) for each in once.values()}
    if order == "row":
        say(f"{path}: neither index nor time is a column; the order is that of the rows")
    for reason, count in recording.left_out.items():
        if count:
            say(f"{path}: {count} fixations {reason} are left out")
    if blank:
        say(f"{path}: {blank} rows with an empty cell, as of blinks, are left out")
    if len(once) < len(found):
        repeated = len(found) - len(once)
        say(f"{path}: {repeated} rows that repeat another (of the same {order}) are left out")
    if len(places) < len(once):
        count = len(once) - len(places)
        say(f"{path}: {count} fixations have the image, viewer and {order} of another and are kept")
    return [*reversed(once.values())]


def _present(
    path: Path,
    image: npt.NDArray[np.str_],
    images: Path,
    only_present: bool,
    say: Callable[[str], None],
) -> npt.NDArray[np.bool_]:
    """(n,) whether the file of an image is in the folder."""
    names = np.unique(image)
    absent = [name for name in names if not is_file(images / name)]
    if absent:
        found = f"{len(absent)} of the {len(names)} images of {path} are not in {images}"
        if len(absent) == len(names):
            raise LogError(f"{found}, {absent[0][:80]} first")
        if not only_present:
            raise LogError(f"{found}, {absent[0][:80]} first; --only-present leaves them out")
        say(f"{found} and are left out")
    return np.asarray(~np.isin(image, absent))


def _viewer_numbers(path: Path, viewers: Sequence[str], say: Callable[[str], None]) -> IntArray:
    """(n,) the numbers of viewers; of names, their places in the order of the numbers in them."""
    names = sorted(set(viewers), key=_natural)
    if all(name.isascii() and name.isdecimal() and len(name) < 19 for name in names):
        return np.array([int(viewer) for viewer in viewers])
    numbers = {name: number for number, name in enumerate(names)}
    shown = ", ".join(names if len(names) <= 20 else [*names[:3], "...", names[-1]])
    say(f"{path}: the viewers are numbered from 0 in this order: {shown}")
    return np.array([numbers[viewer] for viewer in viewers])


def _natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts P2 before P10."""
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    digits = [part.lstrip("0") if part[0].isdigit() else None for part in parts]
    return [
        (-1, part) if number is None else (len(number), number)
        for part, number in zip(parts, digits, strict=True)
    ]


def _indices(
    path: Path,
    image: npt.NDArray[np.str_],
    viewer: IntArray,
    order: FloatArray,
    kind: str,
    say: Callable[[str], None],
) -> IntArray:
    """(n,) numbers of the fixations of a viewer on an image, from 0; see `read_fixations`."""
    by = np.lexsort((order, viewer, image))
    new = np.ones(len(by), bool)
    new[1:] = (image[by][1:] != image[by][:-1]) | (viewer[by][1:] != viewer[by][:-1])
    first = order[by][new]
    base = first.min()
    if kind == "index" and base in (0, 1) and np.mean(first == base) >= 0.5:
        if base == 1:
            say(f"{path}: the index counts from 1, the first fixation of a viewer on an image")
        return np.asarray(order - base).astype(np.int64)
    rank = np.empty(len(by), np.int64)
    rank[by] = np.arange(len(by)) - np.flatnonzero(new)[np.cumsum(new) - 1]
    return rank


def _mat_rows(path: Path) -> list[RawFixation]:
    images = read_matlab(path, ("fixations",))["fixations"]
    try:
        return [
            RawFixation(image["img"], str(viewer), index, float(x), float(y), float(milliseconds))
            for image in images
            for place, eye in enumerate(image["subjects"])
            for viewer in [int(eye.get("viewer", np.array(place)).item())]
            for index, (x, y, milliseconds) in enumerate(
                zip(
                    eye["fix_x"].ravel(),
                    eye["fix_y"].ravel(),
                    eye.get("fix_duration", np.full(eye["fix_x"].size, np.nan)).ravel(),
                    strict=True,
                )
            )
        ]
    except (TypeError, KeyError, IndexError, AttributeError, ValueError) as error:
        raise LogError(f"{path}: expected the fixations of OSIE, found another file") from error


def write_fixations(path: str | Path, table: FixationTable, **columns: npt.NDArray[Any]) -> None:
    """Write fixations as `read_fixations` reads them.

    Args:
        path: .csv, a row for each fixation: image, viewer, index, x, y, duration_ms (empty where
            unknown) and further columns; or .mat, in OSIE's layout: a cell array `fixations` with
            `img` and a cell array `subjects` for each image, and `viewer`, `fix_x`, `fix_y`,
            `fix_duration` (ms) and further fields `fix_NAME` for each viewer. Written whole or
            not at all; an old file is replaced.
        table: fixations, of each viewer in their order.
        columns: (n,) further numbers, by name.

    Raises:
        ConfigError: another suffix.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    require(path.suffix in (".csv", ".mat"), "path", "a .csv or .mat", str(path))
    x, y = table.xy.T
    unknown = np.full(len(table), np.nan)
    milliseconds = unknown if table.duration is None else 1000 * table.duration
    if path.suffix == ".csv":
        keys = {"image": table.image, "viewer": table.subject, "index": table.index}
        write_table(path, keys | {"x": x, "y": y, DURATION: milliseconds} | columns)
        return
    from scipy.io import savemat  # slow to import

    cells = _osie_cells(table, {"x": x, "y": y, "duration": milliseconds} | columns)
    with atomic_write(path) as temporary:
        savemat(temporary, {"fixations": cells}, do_compression=True, oned_as="column")


def _osie_cells(table: FixationTable, fields: Mapping[str, npt.NDArray[Any]]) -> _Cells:
    """The images with their viewers, in the layout of OSIE."""
    images = []
    for name in np.unique(table.image):
        own = np.flatnonzero(table.image == name)
        viewers = []
        for viewer in np.unique(table.subject[own]):
            rows = own[table.subject[own] == viewer]
            numbers = {f"fix_{key}": values[rows] for key, values in fields.items()}
            viewers.append({"viewer": viewer, **numbers})
        images.append({"img": str(name), "subjects": _cells(viewers)})
    return _cells(images)


def _cells(structs: Sequence[Mapping[str, Any]]) -> _Cells:
    """A cell array of structs."""
    cells = np.empty(len(structs), object)
    cells[:] = structs
    return cells
