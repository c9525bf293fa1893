"""Tables: dataclasses whose fields are arrays with a row for each item."""

from collections.abc import Sequence
from dataclasses import field, fields
from typing import Any, Self, cast

import numpy as np
import numpy.typing as npt


class Table:
    """Base of dataclasses whose fields are arrays (n, ...); every field has a `column` default."""

    def __len__(self) -> int:
        return len(self._columns()[0])

    def __getitem__(self, index: npt.NDArray[Any]) -> Self:
        """The rows of an index or a mask."""
        return type(self)(*(column[index] for column in self._columns()))

    @classmethod
    def concatenate(cls, tables: Sequence[Self]) -> Self:
        """The rows of all of one or more tables."""
        columns = zip(*(table._columns() for table in tables), strict=True)
        return cls(*(np.concatenate(column) for column in columns))

    @classmethod
    def zeros(cls, n: int, **columns: npt.NDArray[Any]) -> Self:
        """A table of n rows, zero in the columns that are not given."""
        empty = {each.name: getattr(cls(), each.name) for each in fields(cast("Any", cls))}
        blank = {k: np.zeros((n, *each.shape[1:]), each.dtype) for k, each in empty.items()}
        return cls(**blank | columns)

    def _columns(self) -> list[npt.NDArray[Any]]:
        return [getattr(self, each.name) for each in fields(cast("Any", self))]


def column(*shape: int, dtype: npt.DTypeLike = np.float64) -> Any:
    """A field of a `Table` with rows of a shape and type; empty unless given."""
    return field(default_factory=lambda: np.zeros((0, *shape), dtype))
