"""Tables of numbers in one .npz."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.datasets.text import LARGEST, require_ascending
from saccade.errors import LogError
from saccade.npz import read_arrays
from saccade.types import FloatArray


class Archive:
    """The arrays of an .npz, each validated when it is requested.

    Raises:
        LogError: the file is missing, truncated, or no .npz.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.arrays = read_arrays(path)
        except OSError as error:
            raise LogError(f"{path}: cannot be read: {error.strerror or error}") from error
        except ValueError as error:
            raise LogError(
                f"{path}: expected an .npz of tables, found another file or a broken one: {error}"
            ) from error

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def array(
        self,
        name: str,
        shape: tuple[int | None, ...] | None = None,
        kinds: str = "iuf",
        description: str | None = None,
    ) -> npt.NDArray[Any]:
        """The array of a name.

        Args:
            name: of the array.
            shape: expected lengths, None for any; None for any shape.
            kinds: NumPy's codes of the accepted types: i, u, f.
            description: of what is expected, for the message; None for the shape.

        Raises:
            LogError: it is missing, has another type or shape, or holds numbers that are not
                finite or beyond `LARGEST`.
        """
        lengths = ", ".join("n" if n is None else str(n) for n in shape or ())
        expected = f"{name}: expected {description or f'numbers of shape ({lengths})'}"
        if name not in self.arrays:
            found = ", ".join(sorted(self.arrays)) or "nothing"
            raise LogError(f"{self.path}, {expected}, found only {found[:80]}")
        values = self.arrays[name]
        fits = shape is None or (
            values.ndim == len(shape)
            and all(n in (None, m) for n, m in zip(shape, values.shape, strict=True))
        )
        if values.dtype.kind not in kinds or not fits:
            raise LogError(f"{self.path}, {expected}, found {values.dtype} of shape {values.shape}")
        finite = np.abs(values.astype(np.float64)) < LARGEST
        if not finite.all():
            row = int(np.argwhere(~np.atleast_1d(finite))[0, 0])
            raise LogError(
                f"{self.path}, {name}, row {row}: expected finite numbers, "
                f"found {np.atleast_1d(values)[row].tolist()}"
            )
        return values

    def table(self, name: str, columns: tuple[str, ...], stale_limit: float = 0.0) -> FloatArray:
        """The table of a name, (n, len(columns)).

        Args:
            name: of the table.
            columns: names of the columns; a first column "time" must not go backwards.
            stale_limit: see `require_ascending`.

        Raises:
            LogError: see `array`; or the time goes backwards.
        """
        description = f"numbers in the columns {', '.join(columns)}"
        values = self.array(name, (None, len(columns)), description=description)
        table = np.asarray(values, np.float64)
        if columns[0] != "time":
            return table
        return require_ascending(table, lambda i: f"{self.path}, {name}, row {i}", stale_limit)
