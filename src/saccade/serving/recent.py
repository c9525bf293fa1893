"""Most recently used photographs and sessions of the server."""

import secrets
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Recent(Generic[T]):
    """The most recently used values, by token.

    Args:
        capacity: maximum sum of the sizes of all values; the last value is kept whatever its size.
        name: kind of the values, for error messages.
        size: size of a value, by default 1.
    """

    def __init__(self, capacity: int, name: str, size: Callable[[T], int] = lambda _: 1) -> None:
        self._capacity, self._name, self._size = capacity, name, size
        self._values: OrderedDict[str, T] = OrderedDict()

    def add(self, value: T) -> str:
        """Stores a value, evicting the least recently used; returns its token."""
        token = secrets.token_urlsafe(12)
        self._values[token] = value
        total = sum(map(self._size, self._values.values()))
        while total > self._capacity and len(self._values) > 1:
            total -= self._size(self._values.popitem(last=False)[1])
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
