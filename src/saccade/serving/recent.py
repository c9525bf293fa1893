"""Most recently used photographs and sessions of the server."""

import secrets
from collections import OrderedDict
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Recent(Generic[T]):
    """The most recently used values, by token.

    Args:
        size: maximum number of values.
        name: kind of the values, for error messages.
    """

    def __init__(self, size: int, name: str) -> None:
        self._size, self._name = size, name
        self._values: OrderedDict[str, T] = OrderedDict()

    def add(self, value: T) -> str:
        """Stores a value, evicting the least recently used; returns its token."""
        token = secrets.token_urlsafe(12)
        self._values[token] = value
        if len(self._values) > self._size:
            self._values.popitem(last=False)
        return token

    def __getitem__(self, token: Any) -> T:
        """The value of a token; raises `KeyError` if it was evicted."""
        if not isinstance(token, str) or token not in self._values:
            raise KeyError(f"the {self._name} is no longer in memory; start again")
        self._values.move_to_end(token)
        return self._values[token]

    def remove(self, token: str) -> None:
        """Removes a value."""
        del self._values[token]

    def clear(self) -> None:
        """Removes all values."""
        self._values.clear()
