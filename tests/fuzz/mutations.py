"""Good files made bad: cut, flipped, spliced, and with numbers that nobody expects."""

import io
import re
from random import Random

import numpy as np

ODD_WORDS = (
    *("nan", "inf", "-inf", "-1", "0", "1e300", "-1e300", "1e-320", "99999999999999999999"),
    *("", "x", '"', "'", "\x00", "\ufeff", "é", "٣", "[", "]", "[" * 3000, "{", ",", ";"),
    *("\n", "\r", "\t", " ", "#", "1_000", "0x10", "2147483648", "-9223372036854775809"),
)
ODD_BYTES = (0, 1, 0x7F, 0x80, 0xFE, 0xFF)
ENCODINGS = ("utf-16", "utf-8-sig", "latin-1", "cp037")
DTYPES = ("f2", "f4", "f8", ">f8", "i1", "u1", "i8", "u8", "c16", "?", "U7", "S3", "M8[s]")
ODD_NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e300, -1.0, 0.0, 2.0**31, 2.0**63)


def broken(name: str, data: bytes, chance: Random) -> bytes:
    """Something like a file, but not it; `name` tells what is in it."""
    if name.endswith(".npz") and chance.random() < 0.7:
        return broken_arrays(data, chance)
    if name.endswith(".h5") and chance.random() < 0.5:
        return broken_hdf5(data, chance)
    if name.endswith(".parquet") and chance.random() < 0.5:
        return broken_parquet(data, chance)
    text = is_text(data)
    for _ in range(chance.randint(1, 4)):
        change = chance.choice(TEXT if text and chance.random() < 0.8 else BYTES)
        data = change(data, chance)
    return data


def is_text(data: bytes) -> bool:
    """Whether all of it is ASCII that can be read."""
    return all(byte in (9, 10, 13) or 32 <= byte < 127 for byte in data)


def cut(data: bytes, chance: Random) -> bytes:
    """Without its end."""
    return data[: chance.randint(0, len(data))]


def flipped(data: bytes, chance: Random) -> bytes:
    """With a bit that is another."""
    changed = bytearray(data or b"\0")
    changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def odd_bytes(data: bytes, chance: Random) -> bytes:
    """With a few bytes in a row that are as large or as small as can be."""
    start, count = chance.randint(0, len(data)), chance.choice((1, 2, 4, 8))
    return data[:start] + bytes([chance.choice(ODD_BYTES)]) * count + data[start + count :]


def spliced(data: bytes, chance: Random) -> bytes:
    """With a piece of it at another place, or left out."""
    start = chance.randint(0, len(data))
    end = min(len(data), start + chance.randint(0, 64))
    there = chance.randint(0, len(data))
    piece = data[start:end]
    without = data[:start] + data[end:]
    return without if chance.random() < 0.5 else without[:there] + piece * 2 + without[there:]


def odd_word(data: bytes, chance: Random) -> bytes:
    """With a word that is another."""
    words = list(re.finditer(rb"[^\s,;:=\[\]]+", data))
    if not words:
        return chance.choice(ODD_WORDS).encode()
    word = chance.choice(words)
    odd = chance.choice(ODD_WORDS).encode("utf-8", "surrogatepass")
    return data[: word.start()] + odd + data[word.end() :]


def swapped(data: bytes, chance: Random) -> bytes:
    """With two words changed for each other."""
    words = list(re.finditer(rb"[^\s,;:=\[\]]+", data))
    if len(words) < 2:
        return data
    one, two = sorted(chance.sample(words, 2), key=lambda word: word.start())
    between = data[one.end() : two.start()]
    return data[: one.start()] + two[0] + between + one[0] + data[two.end() :]


def other_lines(data: bytes, chance: Random) -> bytes:
    """With a line twice, elsewhere, or not at all."""
    lines = data.split(b"\n")
    line = lines.pop(chance.randrange(len(lines)))
    for _ in range(chance.randint(0, 2)):
        lines.insert(chance.randint(0, len(lines)), line)
    return b"\n".join(lines)


def other_encoding(data: bytes, chance: Random) -> bytes:
    """The same text in other bytes."""
    return data.decode("latin-1").encode(chance.choice(ENCODINGS), "replace")


BYTES = (cut, flipped, flipped, odd_bytes, odd_bytes, spliced)
TEXT = (odd_word, odd_word, odd_word, swapped, other_lines, other_encoding, cut, spliced)


def broken_arrays(data: bytes, chance: Random) -> bytes:
    """An .npz with one array that is another."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    name = chance.choice(list(arrays))
    values = broken_array(arrays.pop(name), chance)
    if chance.random() < 0.9:
        arrays[name if chance.random() < 0.9 else "other"] = values
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def broken_hdf5(data: bytes, chance: Random) -> bytes:
    """An HDF5 file with one dataset that is another, or a group in its place."""
    import h5py

    file = io.BytesIO(data)
    with h5py.File(file, "a") as opened:
        (group,) = opened.values()
        while isinstance(next(iter(group.values())), h5py.Group):
            (group,) = group.values()
        name = chance.choice(list(group))
        values = broken_array(group[name][()], chance)
        del group[name]
        if values.dtype.kind in "UM" or chance.random() < 0.1:
            group.create_group(name)
        else:
            group[name] = values
    return file.getvalue()


def broken_parquet(data: bytes, chance: Random) -> bytes:
    """A Parquet file with one column that is of another type, is gone or has nulls."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(data))
    number = chance.randrange(table.num_columns)
    name = table.column_names[number]
    odd = chance.choice((None, "text", 1 << 60, -1, float("nan"), 1e300, b"\xff", [1, 2], True))
    column = pa.array([odd] * len(table))
    table = table.remove_column(number)
    if chance.random() < 0.9:
        table = table.append_column(name, column)
    if chance.random() < 0.3:
        table = table.replace_schema_metadata({"saccade": chance.choice(("", "[]", "{", "1"))})
    file = io.BytesIO()
    pq.write_table(table, file)
    return file.getvalue()


def broken_array(values, chance: Random):
    """An array of another type, shape or content."""
    kind = chance.randrange(5)
    with np.errstate(all="ignore"):
        if kind == 0 and values.dtype.kind in "fiub":
            return np.asarray(values).astype(chance.choice(DTYPES))
        if kind == 1:
            return values.reshape(-1) if values.ndim > 1 else np.expand_dims(values, 0)
        if kind == 2:
            return values[: len(values) // 2] if values.ndim else np.array([])
        if kind == 3 and values.dtype.kind == "f" and values.size:
            changed = np.array(values)
            changed.flat[chance.randrange(values.size)] = chance.choice(ODD_NUMBERS)
            return changed
    if values.dtype.kind in "iu" and values.size:
        limits = np.iinfo(values.dtype)
        changed = np.array(values)
        changed.flat[chance.randrange(values.size)] = chance.choice((limits.min, limits.max))
        return changed
    return np.array(chance.choice(("text", 1.0, True)))
