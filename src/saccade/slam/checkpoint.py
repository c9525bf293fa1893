"""A run that was interrupted goes on where it last saved itself.

A checkpoint is one .npz: the arrays of the run as they are in memory, and as JSON how they hang
together. Nothing in it is executed when it is read. It holds what objects keep to themselves too,
so that the rest of a run is the same to the last bit.
"""

import hashlib
import json
import logging
import sys
import time
from importlib.metadata import version
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any, Protocol

import numpy as np

from saccade.errors import ConfigError, LogError
from saccade.files import atomic_write
from saccade.formats import FORMATS
from saccade.npz import read_arrays
from saccade.types import FloatArray

FORMAT = FORMATS["checkpoint"]
"""Of the file; another one is not read."""
_SCALARS = (bool, int, float, str)
_PLAIN = (FunctionType, BuiltinFunctionType, MethodType, type)
"""What a run is made with again, and is not saved."""

_logger = logging.getLogger(__name__)


class Recorded(Protocol):
    """What a run goes through from its first pose to its last: a log, a drive."""

    @property
    def time(self) -> FloatArray:
        """(t,) of each pose."""


class Checkpoint:
    """Where a run saves itself, and how often.

    Args:
        path: the file, an .npz.
        every: seconds between one saving and the next; 0 saves as often as a run looks up: at
            every pose, or every hundredth of them where the association is known.
    """

    def __init__(self, path: str | Path, every: float = 10.0) -> None:
        self.path = Path(path)
        self.every = every
        self.step = 0
        """Poses that the file has behind it."""
        self.resumed = 0
        """Poses that this run did not do again."""
        self._identity = ""
        self._log: Recorded | None = None
        self._last = time.monotonic()

    def resume(self, log: Recorded, identity: tuple[object, ...], state: dict[str, Any]) -> int:
        """Bring a run that is about to begin to where it was interrupted.

        Args:
            log: of the run; where the state points at it, it is not saved.
            identity: what makes the run this one and no other: its data, settings, and models.
            state: objects and arrays of the run, changed in place.

        Returns:
            The number of poses that are done; 0 where there is no checkpoint, or one that is
            broken, or of another log, other settings or another version, which is said.
        """
        self._identity, self._log = _identity(identity), log
        self._last = time.monotonic()
        if not self.path.exists():
            return 0
        try:
            saved, arrays = _read(self.path, self._identity)
        except LogError as error:
            _logger.warning("%s; beginning anew", error)
            return 0
        decoder = _Decoder(arrays)
        for name, value in state.items():
            found = decoder.decode(saved["state"][name], value)
            if isinstance(value, np.ndarray):
                value[...] = found
        self.step = self.resumed = int(saved["step"])
        _logger.info("%s: going on after pose %d of %d", self.path, self.step, len(log.time))
        return self.resumed

    def save(self, step: int, state: dict[str, Any]) -> None:
        """Save a run if it is time to.

        Args:
            step: poses that are done.
            state: as for `resume`.

        Raises:
            ConfigError: something in the state is of a kind that cannot be saved.
            OutputError: the file cannot be written.
        """
        if time.monotonic() - self._last < self.every:
            return
        encoder = _Encoder(self._log)
        text = json.dumps(
            {
                "format": FORMAT,
                "identity": self._identity,
                "step": step,
                "state": {name: encoder.encode(value) for name, value in state.items()},
            }
        )
        arrays = {str(number): array for number, array in enumerate(encoder.arrays)}
        with atomic_write(self.path) as temporary:
            seal = np.array(_seal(text, arrays))
            np.savez(temporary, allow_pickle=False, text=np.array(text), seal=seal, **arrays)
        self.step = step
        self._last = time.monotonic()

    def remove(self) -> None:
        """Forget the run: it is done."""
        self.path.unlink(missing_ok=True)


class _Encoder:
    """Objects as JSON, their arrays apart; what is met again is only pointed at.

    Args:
        given: an object that is left out, as the run is made with it again.
    """

    def __init__(self, given: object = None) -> None:
        self.arrays: list[np.ndarray[Any, Any]] = []
        self._given = given
        self._met: dict[int, int] = {}

    def encode(self, value: object) -> Any:
        if value is None or type(value) in _SCALARS:
            return value
        if isinstance(value, _PLAIN) or value is self._given:
            return {"again": _name(value if isinstance(value, _PLAIN) else type(value))}
        if id(value) in self._met:
            return {"met": self._met[id(value)]}
        number = self._met[id(value)] = len(self._met)
        return {"number": number, **self._describe(value)}

    def _describe(self, value: Any) -> dict[str, Any]:
        if isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in "biufU":
            self.arrays.append(np.asanyarray(value))
            return {"array": len(self.arrays) - 1, "scalar": isinstance(value, np.generic)}
        if type(value) is dict:
            return {"dict": [[self.encode(k), self.encode(v)] for k, v in value.items()]}
        if type(value) is list and self._alike(value):
            for each in value:
                self._met[id(each)] = len(self._met)
            self.arrays.append(np.stack(value))
            return {"stack": len(self.arrays) - 1}
        if type(value) in (list, set):
            return {type(value).__name__: [self.encode(each) for each in value]}
        if isinstance(value, tuple):
            return {"tuple": [self.encode(each) for each in value], "class": _name(type(value))}
        if not hasattr(value, "__dict__"):
            raise ConfigError(f"checkpoint: expected arrays and numbers, found {type(value)}")
        held = {name: self.encode(each) for name, each in vars(value).items()}
        return {"object": held, "class": _name(type(value))}

    def _alike(self, value: list[Any]) -> bool:
        """Whether these are arrays that make one, of which none was met before."""
        kinds = {(each.dtype, each.shape) if type(each) is np.ndarray else None for each in value}
        apart = {id(each) for each in value}
        new = len(apart) == len(value) and apart.isdisjoint(self._met)
        return new and len(kinds) == 1 and None not in kinds and value[0].dtype.kind in "biuf"


class _Decoder:
    """Objects from JSON and arrays; where the run has one already, that one is changed."""

    def __init__(self, arrays: dict[str, Any]) -> None:
        self.arrays = arrays
        self._met: dict[int, Any] = {}

    def decode(self, saved: Any, like: object) -> Any:
        if not isinstance(saved, dict):
            return saved
        if "again" in saved:
            return like
        if "met" in saved:
            return self._met[saved["met"]]
        if "object" in saved:
            return self._object(saved, like)
        if "stack" in saved:
            rows = self._met[saved["number"]] = list(self.arrays[str(saved["stack"])])
            self._met |= {saved["number"] + 1 + i: row for i, row in enumerate(rows)}
            return rows
        made = self._met[saved["number"]] = self._value(saved)
        return made

    def _value(self, saved: dict[str, Any]) -> Any:
        if "array" in saved:
            array = self.arrays[str(saved["array"])]
            return array[()] if saved["scalar"] else array
        if "dict" in saved:
            return {self.decode(k, None): self.decode(v, None) for k, v in saved["dict"]}
        for kind in (list, set):
            if kind.__name__ in saved:
                return kind(self.decode(each, None) for each in saved[kind.__name__])
        items = [self.decode(each, None) for each in saved["tuple"]]
        own = _class(saved["class"])
        return own(items) if own is tuple else own(*items)

    def _object(self, saved: dict[str, Any], like: object) -> Any:
        if like is None or _name(type(like)) != saved["class"]:
            kind = _class(saved["class"])
            like = kind.__new__(kind)
        self._met[saved["number"]] = like
        for name, each in saved["object"].items():
            vars(like)[name] = self.decode(each, getattr(like, name, None))
        return like


def _identity(run: object) -> str:
    encoder = _Encoder()
    digest = hashlib.sha256(f"{version('saccade')} {json.dumps(encoder.encode(run))}".encode())
    for array in encoder.arrays:
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _read(path: Path, identity: str) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        arrays = read_arrays(path)
        text = str(arrays.pop("text"))
        saved = json.loads(text)
        known = (saved["format"], saved["identity"])
        whole = saved["format"] != FORMAT or str(arrays.pop("seal")) == _seal(text, arrays)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise LogError(f"{path}: no checkpoint, or a broken one") from error
    if known != (FORMAT, identity):
        raise LogError(f"{path}: of another log, other settings or another version")
    if not whole:
        raise LogError(f"{path}: no checkpoint, or a broken one")
    return saved, arrays


def _seal(text: str, arrays: dict[str, Any]) -> str:
    """What tells that nothing was changed: kernels trust the shapes of what goes on."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()


def _name(value: Any) -> str:
    return f"{value.__module__}:{value.__qualname__}"


def _class(name: str) -> Any:
    """One of our own classes by its name, or the tuple."""
    if name == "builtins:tuple":
        return tuple
    module, _, qualified = name.partition(":")
    found = getattr(sys.modules.get(module), qualified, None)
    if module.split(".")[0] != "saccade" or not isinstance(found, type):
        raise LogError(f"checkpoint: {name} is in it, which this run does not have")
    return found
