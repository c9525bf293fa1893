"""Checkpoints: an interrupted run resumes where it last saved its state.

A checkpoint is one .npz of plain arrays, named after the part of the run and the array in it:
`ekf.state`, `candidates.xy`, `step`. Nothing in it is executed when it is read.
"""

import hashlib
import logging
import time
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from saccade.errors import ConfigError, LogError
from saccade.io.files import FORMATS, atomic_write, written_at_once
from saccade.io.npz import read_arrays, save_arrays
from saccade.types import Table

FORMAT = FORMATS["checkpoint"]
"""Of the file; another one is not read."""
Arrays: TypeAlias = dict[str, npt.NDArray[Any]]
SCALARS = bool | int | float | str | np.generic
"""What a checkpoint holds beside arrays."""

_logger = logging.getLogger(__name__)


@runtime_checkable
class Stateful(Protocol):
    """A part of a run that changes from pose to pose."""

    def to_arrays(self) -> Arrays:
        """Its state as named arrays of numbers or text."""

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` of a part with the same settings gave."""


class Checkpointed:
    """Base of parts of a run whose state is their attributes.

    These are what `attribute_arrays` saves, tables, lists of tables, and parts of their own;
    anything else follows from the settings.
    """

    not_state: ClassVar[tuple[str, ...]] = ()
    """Attributes that are the state of another part."""

    def to_arrays(self) -> Arrays:
        """The state as named arrays."""
        parts: dict[str, Arrays] = {}
        for name, value in self._state().items():
            if isinstance(value, list) and value and isinstance(value[0], Table):
                parts[name] = attribute_arrays(value[0].concatenate(value))
            elif isinstance(value, Table):
                parts[name] = attribute_arrays(value)
            elif isinstance(value, Stateful):
                parts[name] = value.to_arrays()
        return attribute_arrays(self) | merge(parts)

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore the state from the arrays of `to_arrays`."""
        restore_attributes(self, arrays)
        for name, value in self._state().items():
            saved = select(arrays, name)
            if isinstance(value, list) and value and isinstance(value[0], Table):
                setattr(self, name, [type(value[0])(**saved)])
            elif isinstance(value, Table):
                setattr(self, name, type(value)(**saved))
            elif isinstance(value, Stateful):
                value.from_arrays(saved)

    def _state(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if name not in self.not_state}


class StoredArrays:
    """Arrays as a part of a run: saved by their names, restored in place."""

    def __init__(self, arrays: Arrays) -> None:
        self._arrays = arrays

    def to_arrays(self) -> Arrays:
        """The arrays."""
        return self._arrays

    def from_arrays(self, arrays: Arrays) -> None:
        """Fill them with what `to_arrays` gave."""
        for name, array in self._arrays.items():
            array[...] = arrays[name]


class Checkpoint:
    """Where a run saves its state, and how often.

    Args:
        path: the file, an .npz.
        every: seconds from one save to the next; None saves whenever it is possible: after every
            pose, or every hundredth of the poses where the run takes many at once.
    """

    def __init__(self, path: str | Path, every: float | None = 10.0) -> None:
        self.path = Path(path)
        self.every = every
        self.step = 0
        """Poses that the file has behind it."""
        self.resumed = 0
        """Poses that this run did not repeat."""
        self._identity = ""
        self._last = time.monotonic()

    def resume(self, identity: object, parts: Mapping[str, Stateful | None]) -> int:
        """Restore the state of a run that is about to begin, if it was interrupted.

        Args:
            identity: whatever distinguishes the run from others: its data, settings and models.
            parts: of the run, restored in place; None for those that it does not have.

        Returns:
            The number of poses that are done; 0, with a warning, for a file that is broken, or
            of another log, other settings or another version, and 0 if there is none.
        """
        self._identity = _digest((version("saccade"), identity)).hex()
        self._last = time.monotonic()
        if not self.path.exists():
            return 0
        try:
            arrays = self._read()
            for name, part in parts.items():
                saved = select(arrays, name)
                if part is not None and saved:
                    part.from_arrays(saved)
        except LogError as error:
            _logger.warning("%s; beginning anew", error)
            return 0
        self.step = self.resumed = int(arrays["step"])
        _logger.info("%s: resuming after pose %d", self.path, self.step)
        return self.resumed

    def save(self, step: int, parts: Mapping[str, Stateful | None]) -> None:
        """Save a run if it is time to.

        Args:
            step: poses that are done.
            parts: as for `resume`.

        Raises:
            ConfigError: a part has a state that is no array of numbers or text.
            OutputError: the file cannot be written.
        """
        if self.every is not None and time.monotonic() - self._last < self.every:
            return
        arrays = merge({name: arrays_of(name, part) for name, part in parts.items() if part})
        for name, value in (("format", FORMAT), ("step", step), ("identity", self._identity)):
            arrays[name] = np.array(value)
        arrays["checksum"] = np.array(checksum(arrays))
        with written_at_once(), atomic_write(self.path) as temporary:
            save_arrays(temporary, arrays, compressed=False)
        self.step = step
        self._last = time.monotonic()

    def remove(self) -> None:
        """Remove the file: the run is done."""
        self.path.unlink(missing_ok=True)

    def _read(self) -> Arrays:
        broken = LogError(f"{self.path}: no checkpoint, or a broken one")
        try:
            arrays = read_arrays(self.path)
        except (OSError, ValueError) as error:
            raise broken from error
        saved = str(arrays.pop("checksum", ""))
        known = str(arrays.get("format")) == str(FORMAT)
        if known and saved != checksum(arrays):  # kernels trust the shapes of arrays
            raise broken
        if not known or str(arrays["identity"]) != self._identity:
            raise LogError(f"{self.path}: of another log, other settings or another version")
        return arrays


def arrays_of(name: str, part: Stateful) -> Arrays:
    """The state of a part of a run.

    Raises:
        ConfigError: it cannot be saved; names the part.
    """
    if not isinstance(part, Stateful):
        raise ConfigError(f"checkpoint: expected {name} to have to_arrays, found {type(part)}")
    arrays = part.to_arrays()
    for key, array in arrays.items():
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "biufU":
            raise ConfigError(f"checkpoint: expected {name}.{key} to be numbers, found {array!r}")
    return arrays


def merge(parts: Mapping[str, Arrays]) -> Arrays:
    """The arrays of several parts, their names preceded by that of the part and a dot."""
    return {
        f"{part}.{name}": array for part, arrays in parts.items() for name, array in arrays.items()
    }


def select(arrays: Arrays, part: str) -> Arrays:
    """The arrays of one part of what `merge` gave."""
    return {
        name.removeprefix(f"{part}."): array
        for name, array in arrays.items()
        if name.startswith(f"{part}.")
    }


def attribute_arrays(part: object, *names: str) -> Arrays:
    """The attributes of an object that are numbers, text, arrays, or lists or dicts of such.

    Others, and those that are None or empty, are left out; with names, all but these.
    """
    arrays: Arrays = {}
    for name, value in vars(part).items():
        if names and name not in names:
            continue
        if isinstance(value, dict):
            arrays[f"{name}.keys"] = np.array(list(value))
            arrays[f"{name}.values"] = np.array(list(value.values()))
        elif isinstance(value, SCALARS | np.ndarray) or _is_stackable(value):
            arrays[name] = np.asarray(value)
    return arrays


def restore_attributes(part: object, arrays: Arrays) -> None:
    """Set the attributes of an object with the same settings to what `attribute_arrays` gave."""
    for key, array in arrays.items():
        name, _, item = key.partition(".")
        value = getattr(part, name, None)
        if item == "keys":
            values = arrays[f"{name}.values"].tolist()
            vars(part)[name] = dict(zip(array.tolist(), values, strict=True))
        elif item == "" and isinstance(value, list):
            vars(part)[name] = list(array) if array.ndim > 1 else array.tolist()
        elif item == "":
            is_scalar = array.ndim == 0 and not isinstance(value, np.ndarray)
            vars(part)[name] = array.item() if is_scalar else array


def _is_stackable(value: object) -> bool:
    return isinstance(value, list) and len(value) > 0 and isinstance(value[0], SCALARS | np.ndarray)


def checksum(arrays: Arrays) -> str:
    """A hash of names, types, shapes and contents."""
    return _digest(dict(sorted(arrays.items()))).hex()


def _digest(value: object) -> bytes:
    """A hash of a value's contents; of functions, and other objects, by name."""
    kind = type(value)
    content: list[bytes]
    if isinstance(value, np.ndarray):
        content = [f"{value.dtype}{value.shape}".encode(), np.ascontiguousarray(value).tobytes()]
    elif isinstance(value, dict):
        content = [_digest(each) for item in value.items() for each in item]
    elif isinstance(value, (list, tuple)):
        content = [_digest(each) for each in value]
    elif is_dataclass(value) and not isinstance(value, type):
        content = [_digest(getattr(value, each.name)) for each in fields(value)]
    elif hasattr(value, "__qualname__"):
        content = [f"{value.__module__}:{value.__qualname__}".encode()]
    elif hasattr(value, "__dict__"):
        content = [_digest(vars(value))]
    else:
        content = [repr(value).encode()]
    digest = hashlib.sha256(f"{kind.__module__}:{kind.__qualname__}".encode())
    for each in content:
        digest.update(len(each).to_bytes(8))
        digest.update(each)
    return digest.digest()
