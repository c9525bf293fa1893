"""Whether a file is a picture of something, and PNGs that say more than they hold."""

import struct
import zlib
from pathlib import Path

import cv2


def looks_like_a_picture(path):
    picture = cv2.imread(str(path))
    return picture is not None and min(picture.shape[:2]) > 200 and picture.std() > 10


def chunk(name, content):
    """Of a PNG."""
    sized = struct.pack(">I", len(content)) + name + content
    return sized + struct.pack(">I", zlib.crc32(name + content))


def png(side, rows):
    """A square one that says how large it is, and has so many rows."""
    pixels = zlib.compress((b"\0" * (side + 1)) * rows, 1)
    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    start = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
    return start + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def without_figures(monkeypatch):
    """Let `look` write empty files for its figures: to draw one takes a second."""

    def empty(_, path, formats):
        Path(f"{path}.{formats[0]}").touch()
        return f"{path}.{formats[0]}"

    monkeypatch.setattr("saccade.cli.look_image.attention_figure", lambda *_: None)
    monkeypatch.setattr("saccade.cli.look_image.save_figures", empty)
