"""Reading, validating and converting images, including transparent images."""

import re
import struct
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError, ImageWarning
from saccade.io.files import (
    IMAGE_SUFFIXES,
    LARGEST_IMAGE,
    UNREAD_SUFFIXES,
    natural_order,
    read_bytes,
    reading,
)
from saccade.io.gray_alpha_tiff import find_gray_alpha, split_opacity
from saccade.types import Float32Array, Image

Color: TypeAlias = tuple[float, float, float]
"""Red, green and blue in [0, 1]."""

WHITE: Color = (1.0, 1.0, 1.0)
"""Default background of transparent images."""

ORIENTATION = 0x0112
"""EXIF tag of the orientation."""

TURNS = (
    *((False, 0), (True, 0), (False, 2), (True, 2)),
    *((True, 1), (False, 3), (True, 3), (False, 1)),
)
"""Transforms of EXIF orientations 1 to 8: whether to mirror left and right, and the number of
counterclockwise quarter turns afterwards."""


class Header(NamedTuple):
    """Properties of an image file that OpenCV does not report."""

    width: int
    height: int
    orientation: int = 1
    """EXIF orientation, 1 to 8."""
    transparent: bool = False
    """Whether the image has an alpha channel."""
    tiff: bool = False
    """Whether the file is a TIFF; OpenCV rotates TIFFs upright and premultiplies 8-bit colors."""
    multiplied: bool = False
    """Whether the stored colors are premultiplied by alpha."""


def composite(
    pixels: npt.NDArray[Any], background: Color, white: float | None, *, multiplied: bool = False
) -> npt.NDArray[Any]:
    """Composites RGBA over a background.

    Args:
        pixels: (H, W, 4).
        background: RGB in [0, 1].
        white: the value of full intensity and alpha; None for the maximum of the data type.
        multiplied: whether the colors are premultiplied by alpha.

    Returns:
        (H, W, 3) in the same dtype; a view of RGB if the image is opaque.
    """
    integer = pixels.dtype.kind != "f"
    full = (white or np.iinfo(pixels.dtype).max) if integer else 1.0
    colors, alpha = pixels[:, :, :3], pixels[:, :, 3:]
    if (alpha == full).all():
        return np.ascontiguousarray(colors)
    opacity = alpha.astype(np.float64) / full
    own = colors if multiplied else colors * opacity
    blended = own + np.array(background) * full * (1 - opacity)
    return (np.rint(blended) if integer else blended).astype(pixels.dtype)


SILENT = 0
"""OpenCV's lowest log level."""

OVERSHOOT = 1e-3
"""Accepted overshoot of float values beyond [0, 1], due to interpolation and rounding."""

InBlocks: TypeAlias = Callable[[Callable[[slice], None], int, int], None]
"""Function that calls a function on slices of a number of items, of a size."""
GRAY_ROWS = 16
"""Number of rows of an image that are converted to gray at once."""
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""Weights of R, G and B in gray, after ITU-R BT.601."""

SENSOR_BITS = (10, 12, 14)
"""Bit depths of sensors that store values in uint16."""

HEIF_BRANDS = (b"heic", b"heix", b"hevc", b"mif1", b"msf1", b"avif", b"avis")
"""Brands in the headers of HEIC and AVIF files."""

PNG_DEPTH = 24
"""Offset of the bit depth in a PNG."""
JPEG_MARKER = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")
"""A marker that is not part of compressed data."""
END_OF_IMAGE = b"\xff\xd9"
"""Marker at the end of a JPEG image."""
UNSIZED = (b"\xff\x01", b"\xff\xd8")
"""Markers without a segment."""

NOT_AN_IMAGE = "expected an image (PNG, JPEG, TIFF, ...), found another format"


def read_image(
    path: str | Path,
    *,
    background: Color = WHITE,
    white: float | None = None,
    keep_alpha: bool = False,
) -> Float32Array:
    """Reads an image, rotated upright by its EXIF orientation.

    Args:
        path: any format that OpenCV reads; gray, color, 8 or 16 bit, or floats in [0, 1].
        background: RGB in [0, 1] behind a transparent image.
        white: the stored value that becomes 1, such as 4095 for 12-bit data; None for the maximum
            of the data type, with a warning if uint16 data appear to have 10, 12 or 14 bits.
        keep_alpha: whether a transparent image keeps its alpha channel, for detectors, which find
            nothing in its transparent pixels.

    Returns:
        (H, W, 3) RGB in [0, 1]; with `keep_alpha` (H, W, 4) of a transparent image.

    Raises:
        ImageError: the file is missing, is not an image, is truncated, has values above `white`,
            or is larger than `LARGEST_IMAGE` (the command line rejects it before decoding; in a
            program OpenCV's own limit applies, OPENCV_IO_MAX_IMAGE_PIXELS in the environment).
    """
    data = _read(Path(path))
    options: dict[str, Any] = {"background": background, "white": white, "keep_alpha": keep_alpha}
    return decode_image(data, str(path), **options)


def decode_image(
    data: bytes,
    name: str,
    *,
    background: Color = WHITE,
    white: float | None = None,
    keep_alpha: bool = False,
) -> Float32Array:
    """`read_image` from the bytes of a file; `name` is for error messages."""
    pixels = _decode(data, name)
    try:
        header = read_header(data, name)
    except ImageError:  # of a format that OpenCV alone reads
        header = Header(0, 0)
    multiplied = header.tiff and pixels.dtype == np.uint8 and pixels.ndim == 3
    multiplied |= header.multiplied
    if pixels.ndim == 2 and header.transparent:
        pixels = _with_opacity(pixels, data)
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        layered = composite(pixels, background, white, multiplied=multiplied)
        alpha = pixels[:, :, 3] if keep_alpha and header.transparent else None
        pixels = layered if header.transparent else pixels[:, :, :3]
    else:
        alpha = None

    def upright(each: npt.NDArray[Any]) -> npt.NDArray[Any]:
        mirrored, turns = TURNS[0 if header.tiff else header.orientation - 1]
        return np.rot90(each[:, ::-1] if mirrored else each, turns)

    colors = as_rgb(upright(pixels), name, white=white)
    if alpha is None:
        return colors
    return np.dstack([colors, in_unit_range(upright(alpha), np.float32, white)])


def read_stored(path: str | Path) -> Image:
    """Reads an image as stored by the camera, to which the calibration applies.

    Args:
        path: any format that OpenCV reads; gray, color, 8 or 16 bit.

    Returns:
        (H, W), or (H, W, 3) RGB; uint8 or uint16. The EXIF orientation is ignored.

    Raises:
        ImageError: as `read_image`.
    """
    return decode_stored(_read(Path(path)), str(path))


def decode_stored(data: bytes, name: str) -> Image:
    """`read_stored` from the bytes of a file; `name` is for error messages."""
    pixels = _decode(data, name)
    return pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[:, :, :3])


def read_orientation(path: str | Path) -> int:
    """The EXIF orientation of an image file, 1 to 8; 1 is upright, or unknown.

    Raises:
        ImageError: the file cannot be read.
    """
    return orientation_of_bytes(_read(Path(path)))


def orientation_of_bytes(data: bytes) -> int:
    """`read_orientation` from the bytes of a file."""
    try:
        return read_header(data, "image").orientation
    except ImageError:  # of a format that OpenCV alone reads
        return 1


def read_header(data: bytes, name: str) -> Header:
    """Reads the header of an image without decoding it.

    Args:
        data: content of a file in any format that Pillow reads.
        name: for error messages.

    Raises:
        ImageError: not an image, or the header gives an enormous size.
    """
    from PIL import Image as Pillow  # slow to import

    if gray := find_gray_alpha(data, name):
        multiplied = gray.multiplied
        return Header(gray.width, gray.height, gray.orientation, True, multiplied=multiplied)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about its size and metadata
            with Pillow.open(BytesIO(data)) as image:
                transparent = "A" in image.getbands() or "transparency" in image.info
                exif = Pillow.Image.getexif(image)  # for PNG, exif would decode the image
                orientation = exif.get(ORIENTATION, 1)
                valid = orientation if orientation in range(1, 9) else 1
                return Header(*image.size, valid, transparent, image.format == "TIFF")
    except Pillow.DecompressionBombError as error:
        raise ImageError(f"{name}: the image is far too large") from error
    except Exception as error:  # Pillow raises arbitrary exceptions
        raise ImageError(f"{name}: {NOT_AN_IMAGE}") from error


def _read(path: Path) -> bytes:
    with reading(path, ImageError, "the name of a file", ValueError):  # nulls in the name
        return read_bytes(path)


def _decode(data: bytes, name: str) -> npt.NDArray[Any]:
    """The stored pixels of a file: (H, W), or (H, W, 3) RGB, or (H, W, 4) RGBA."""
    import cv2  # slow to import

    if not data:
        raise ImageError(f"{name}: expected an image, found an empty file")
    if _is_truncated(data):
        raise ImageError(f"{name}: the image is cut short")
    if gray := find_gray_alpha(data, name):
        return split_opacity(_decode(gray.data, name), gray.differs)
    with quiet_opencv():
        try:
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            if "MAX_IMAGE" in str(error):
                raise ImageError(_too_large(name, "more")) from error
            raise ImageError(f"{name}: cannot be decoded: {error.err}") from error
    if pixels is None:
        raise ImageError(f"{name}: {NOT_AN_IMAGE}{_hint(data)}")
    height, width = pixels.shape[:2]
    if height * width > LARGEST_IMAGE:
        raise ImageError(_too_large(name, f"{width} x {height}"))
    if pixels.ndim == 2:
        return pixels
    order = cv2.COLOR_BGR2RGB if pixels.shape[2] == 3 else cv2.COLOR_BGRA2RGBA
    return cv2.cvtColor(pixels, order)


def _with_opacity(pixels: npt.NDArray[Any], data: bytes) -> npt.NDArray[Any]:
    """(H, W, 4) from a gray image (H, W) whose alpha OpenCV does not read."""
    from PIL import Image as Pillow  # slow to import

    with Pillow.open(BytesIO(data)) as image:
        if image.format == "TIFF":
            return np.asarray(image.convert("LA").convert("RGBA"))
        clear = int(image.info["transparency"])  # transparent gray of a PNG
        if image.mode == "L":
            clear *= 255 // (2 ** min(data[PNG_DEPTH], 8) - 1)
    opacity = np.where(pixels == clear, 0, np.iinfo(pixels.dtype).max).astype(pixels.dtype)
    return np.dstack([pixels, pixels, pixels, opacity])


def _hint(data: bytes) -> str:
    """Advice for an unsupported image format."""
    if data[4:8] == b"ftyp" and data[8:12] in HEIF_BRANDS:
        return " (HEIC or AVIF); convert it to JPEG or PNG"
    return ""


def warn_of_unread(names: Iterable[str], source: str) -> None:
    """Warns about files in unsupported image formats in a folder."""
    unread = Counter(
        suffix for name in names if (suffix := Path(name).suffix.lower()) in UNREAD_SUFFIXES
    )
    if unread:
        counts = ", ".join(f"{count} {suffix}" for suffix, count in sorted(unread.items()))
        message = f"{source}: left out: {counts}, not supported; convert them to JPEG or PNG"
        warnings.warn(message, ImageWarning, stacklevel=3)


def _too_large(name: str, found: str) -> str:
    return (
        f"{name}: expected at most {LARGEST_IMAGE:,} pixels, found {found}; reduce it, or split it"
    )


LARGEST_SEARCH = 10_000
"""Maximum number of files that are looked at for the hint of a message."""


def find_images(source: str | Path) -> list[Path]:
    """Images given by a file, a folder or a glob pattern, in natural order of names.

    Args:
        source: a file; a folder, without its subfolders; or a pattern such as `photos/**/*.jpg`.

    Raises:
        ImageError: an empty name, an invalid pattern, or a folder or a pattern without images.
    """
    if not str(source):
        raise ImageError("image: expected a file, a folder or a pattern, found an empty name")
    path = Path(source)
    with reading(source, ImageError, "a pattern of names", ValueError):
        if path.is_dir():
            entries = list(path.iterdir())
            warn_of_unread((entry.name for entry in entries), str(source))
            paths = [entry for entry in entries if entry.suffix.lower() in IMAGE_SUFFIXES]
        elif not path.exists() and any(sign in str(source) for sign in "*?["):
            paths = [*Path(path.anchor).glob(str(path.relative_to(path.anchor)))]
        else:
            return [path]
        files = sorted((each for each in paths if not each.is_dir()), key=natural_order)
    if not files:
        below = islice(path.rglob("*"), LARGEST_SEARCH) if path.is_dir() else ()
        kinds = {each.suffix for each in below if each.suffix.lower() in IMAGE_SUFFIXES}
        hint = f"; for those of its folders: '{source}/**/*{min(kinds)}'" if kinds else ""
        expected = ", ".join(IMAGE_SUFFIXES)
        raise ImageError(f"{source}: expected images ({expected}), found none{hint}")
    return files


def as_rgb(
    image: Image,
    name: str = "image",
    dtype: npt.DTypeLike = np.float32,
    *,
    background: Color = WHITE,
    white: float | None = None,
    bgr: bool = False,
) -> npt.NDArray[Any]:
    """Converts an image to (H, W, 3) RGB in [0, 1]; gray is repeated.

    Args:
        image: see `saccade.types.Image`.
        name: for error messages.
        dtype: float32 or float64 of the result.
        background: see `read_image`.
        white: see `read_image`; for uint8 and uint16.
        bgr: True for an image in OpenCV's channel order, as `cv2.imread` returns it.

    Raises:
        ImageError: as `check_image`.
    """
    pixels = check_image(image, name, background=background, white=white, bgr=bgr)
    return repeat_gray(in_unit_range(pixels, dtype, white))


def repeat_gray(pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(H, W, 3) of (H, W) or (H, W, 3)."""
    return pixels if pixels.ndim == 3 else np.repeat(pixels[:, :, None], 3, axis=2)


def in_turn(work: Callable[[slice], None], items: int, block_size: int) -> None:
    """Calls a function on consecutive slices of `block_size` items."""
    for start in range(0, items, block_size):
        work(slice(start, min(start + block_size, items)))


def as_gray(image: Image, name: str = "image", run_in_blocks: InBlocks = in_turn) -> Float32Array:
    """Converts an image to (H, W) gray in [0, 1] (ITU-R BT.601 weights).

    Args:
        image: see `saccade.types.Image`.
        name: for error messages.
        run_in_blocks: function that calls another on slices of the rows, perhaps in threads.

    Raises:
        ImageError: as `check_image`.
    """
    pixels = check_image(image, name)
    if pixels.ndim == 2:
        return in_unit_range(pixels)
    luma = np.empty(pixels.shape[:2], np.float32)

    def convert(rows: slice) -> None:
        np.einsum("hwc,c->hw", in_unit_range(pixels[rows]), LUMA, out=luma[rows])

    run_in_blocks(convert, len(luma), GRAY_ROWS)  # in the cache, in a third of the time
    return luma


def check_image(
    image: Image,
    name: str = "image",
    *,
    background: Color = WHITE,
    white: float | None = None,
    bgr: bool = False,
) -> npt.NDArray[Any]:
    """Validates an image; clips floats to [0, 1] and composites alpha.

    Args:
        image: see `saccade.types.Image`.
        name: for error messages.
        background: see `read_image`.
        white: see `read_image`; for uint8 and uint16.
        bgr: see `as_rgb`.

    Returns:
        (H, W) or (H, W, 3) RGB; uint8, uint16, float32 or float64, in C order; the image itself if
        it needs no change.

    Raises:
        ImageError: not an image, empty, not finite, or outside [0, 1] or [0, white].
    """
    image = np.asarray(image)
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        raise ImageError(
            f"{name}: expected shape (H, W), (H, W, 3) or (H, W, 4), found {image.shape}"
        )
    if image.size == 0:
        raise ImageError(f"{name}: expected at least one pixel, found shape {image.shape}")
    if bgr and image.ndim == 3:
        image = image[:, :, [2, 1, 0, 3][: image.shape[2]]]
    pixels = _check_values(image, name, white)
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        return composite(pixels, background, white)
    return pixels


def _check_values(image: npt.NDArray[Any], name: str, white: float | None) -> npt.NDArray[Any]:
    """Returns the image in C order, with a supported dtype and values in range."""
    if image.dtype in (np.uint8, np.uint16):
        pixels = np.ascontiguousarray(image)
        if white is not None:
            highest = int(pixels.max())
            if not highest <= white:
                raise ImageError(f"{name}: expected values up to white={white:g}, found {highest}")
        elif pixels.dtype == np.uint16:
            _remark_on_depth(int(pixels[..., :3].max()), name)
        return pixels
    if white is not None:
        raise ImageError(f"{name}: expected uint8 or uint16 with white, found {image.dtype}")
    if image.dtype == np.bool_:
        return np.ascontiguousarray(image, dtype=np.float32)
    if image.dtype.kind != "f":
        raise ImageError(f"{name}: expected uint8, uint16, bool or float, found {image.dtype}")
    keeps = image.dtype in (np.float32, np.float64)
    pixels = np.ascontiguousarray(image, dtype=image.dtype if keeps else np.float32)
    low, high = float(pixels.min()), float(pixels.max())
    if not (np.isfinite(low) and np.isfinite(high)):
        row, column = np.argwhere(~np.isfinite(pixels))[0, :2]
        raise ImageError(
            f"{name}: expected finite values, found NaN or infinity in row {row}, column {column}"
        )
    if low < -OVERSHOOT or high > 1 + OVERSHOOT:
        raise ImageError(
            f"{name}: expected float values in [0, 1], found {low:.6g} to {high:.6g}; "
            "scale it, or pass uint8 or uint16"
        )
    return pixels if low >= 0 and high <= 1 else pixels.clip(0, 1)


def _remark_on_depth(highest: int, name: str) -> None:
    """Warns if the maximum of a uint16 image suggests a sensor with fewer bits."""
    for bits in SENSOR_BITS:
        if 2 ** (bits - 1) <= highest < 2**bits:
            warnings.warn(
                f"{name}: the uint16 values do not exceed {2**bits - 1} and appear dark; for "
                f"{bits}-bit data pass white={2**bits - 1} to read_image or as_rgb",
                ImageWarning,
                stacklevel=4,
            )


def in_unit_range(
    pixels: npt.NDArray[Any], dtype: npt.DTypeLike = np.float32, white: float | None = None
) -> npt.NDArray[Any]:
    """A validated image as float32 or float64 in [0, 1]; see `read_image` for `white`."""
    if pixels.dtype.kind == "f":
        return pixels.astype(dtype, copy=False)
    values = pixels.astype(dtype)
    values /= white or np.iinfo(pixels.dtype).max
    return values


def _is_truncated(data: bytes) -> bool:
    """Whether a JPEG or PNG is truncated, which OpenCV silently fills with gray.

    This also protects from PNG chunks whose declared size would exhaust the memory.
    """
    if data.startswith(b"\xff\xd8"):
        start = 2
        while marker := JPEG_MARKER.search(data, start):
            if marker[0] == END_OF_IMAGE:
                return False  # ignore trailing data, such as a motion photo's video
            size = (
                0 if marker[0] in UNSIZED else int.from_bytes(data[marker.end() : marker.end() + 2])
            )
            start = marker.end() + size
        return True
    if data.startswith(b"\x89PNG"):
        offset = 8
        while offset + 8 <= len(data):
            length, kind = struct.unpack_from(">I4s", data, offset)
            if kind == b"IEND":
                return False
            offset += 12 + length  # length, kind and checksum
        return True
    return False


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Silences OpenCV's log within the block, since errors are raised as exceptions."""
    import cv2  # slow to import

    logging: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging  # OpenCV 4, 5
    level = logging.getLogLevel()
    logging.setLogLevel(SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)
