"""ROS 1 bags (.bag) and ROS 2 bags (a folder with metadata.yaml), read by rosbags."""

import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import local
from typing import Any

import numpy as np

from saccade.datasets.drives.ros_messages import seconds_of
from saccade.errors import DriveError, ImageError, SaccadeError
from saccade.extras import import_optional
from saccade.files import LARGEST_TEXT, check_file, open_file, reason_of
from saccade.types import FloatArray, IntArray

MAGIC = b"#ROSBAG V2.0\n"
"""First bytes of a ROS 1 bag."""


class Bag:
    """An open bag."""

    def __init__(self, path: Path) -> None:
        self.path, self._thread = path, local()
        self._readers: list[Any] = []
        weakref.finalize(self, _close, self._readers)
        self._open()

    @property
    def _reader(self) -> Any:
        """The reader of this thread: a ROS 2 bag is an SQLite database, bound to one thread."""
        return self._thread.reader if hasattr(self._thread, "reader") else self._open()

    def _open(self) -> Any:
        highlevel = import_optional("rosbags.highlevel", "ros")
        typesys = import_optional("rosbags.typesys", "ros")
        default = typesys.get_typestore(typesys.Stores.LATEST)
        try:
            _check(self.path)
            reader = highlevel.AnyReader([self.path], default_typestore=default)
            reader.open()
            _check_connections(reader.connections)
        except Exception as error:  # rosbags raises what the broken bytes happen to provoke
            raise DriveError(f"{self.path}: expected a ROS bag: {_first_line(error)}") from error
        self._thread.reader = reader
        self._readers.append(reader)
        return reader

    def topics(self, types: Sequence[str]) -> list[str]:
        """Sorted names of the topics of some types that have messages."""
        topics = {c.topic for c in self._reader.connections if c.msgtype in types}
        return sorted(topic for topic in topics if self._reader.topics[topic].msgcount)

    def all_topics(self) -> str:
        """The names of all topics, for messages."""
        return ", ".join(sorted({c.topic for c in self._reader.connections})) or "no topic"

    def messages(
        self, topic: str, start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Time of recording in nanoseconds and message, for every message of a topic."""
        connections = [c for c in self._reader.connections if c.topic == topic]
        kind, stamp = connections[0].msgtype, None
        try:
            for connection, stamp, raw in self._reader.messages(connections, start, stop):
                kind = connection.msgtype
                yield stamp, self._reader.deserialize(raw, kind)
        except Exception as error:
            name = f"{self.path}, {topic}"
            raise DriveError(f"{name}: expected {kind}: {_first_line(error)}") from error
        if stamp is None:
            raise DriveError(f"{self.path}, {topic}: expected messages, found none")

    def stamps(self, topic: str) -> tuple[IntArray, FloatArray]:
        """Times of recording in nanoseconds (n,), and of the headers in seconds (n,)."""
        times = [(stamp, seconds_of(message)) for stamp, message in self.messages(topic)]
        recorded, headers = zip(*times, strict=True)
        return np.array(recorded, np.int64), np.array(headers)

    def at(self, topic: str, stamp: int) -> Any:
        """The message recorded at a time in nanoseconds."""
        try:
            return next(self.messages(topic, stamp, stamp + 1))[1]
        except DriveError as error:
            raise ImageError(str(error)) from error


def _check(path: Path) -> None:
    """Refuse devices, pipes and oversized metadata before rosbags opens them."""
    if path.is_dir():
        for file in path.iterdir():
            check_file(file, LARGEST_TEXT if file.suffix == ".yaml" else None)
        return
    with open_file(path) as opened:
        if opened.read(len(MAGIC)) != MAGIC:
            raise ValueError("it does not begin with the signature of version 2.0")


def _check_connections(connections: Sequence[Any]) -> None:
    """Check the types of metadata.yaml, which rosbags does not."""
    for connection in connections:
        for name, expected in (("topic", str), ("msgtype", str), ("msgcount", int)):
            value = getattr(connection, name)
            if not isinstance(value, expected):
                message = f"{name} of a topic: expected {expected.__name__}, found {value!r}"
                raise TypeError(message)


@contextmanager
def reading(name: str, error_type: type[DriveError | ImageError]) -> Iterator[None]:
    """Context that refuses messages without the fields of their type.

    A bag contains its own message definitions, which may differ from those of ROS.
    """
    try:
        yield
    except SaccadeError:
        raise
    except (AttributeError, LookupError, TypeError, ValueError, OverflowError) as error:
        message = f"{name}: expected messages as ROS defines them: {_first_line(error)}"
        raise error_type(message) from error


def _close(readers: list[Any]) -> None:
    for reader in readers:
        with suppress(Exception):  # SQLite closes a database of another thread on collection
            reader.close()


def _first_line(error: Exception) -> str:
    return reason_of(error).partition("\n")[0]
