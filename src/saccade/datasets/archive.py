"""Tables of numbers in one .npz."""

from pathlib import Path

import numpy as np

from saccade.datasets.text import LARGEST, in_order
from saccade.errors import LogError
from saccade.npz import read_arrays
from saccade.types import FloatArray


class Archive:
    """The tables of an .npz, each checked when it is asked for.

    Raises:
        LogError: the file is missing, cut, or no .npz.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.tables = read_arrays(path)
        except OSError as error:
            raise LogError(f"{path}: cannot be read: {error.strerror or error}") from error
        except ValueError as error:
            raise LogError(
                f"{path}: expected an .npz of tables, found another file or a broken one: {error}"
            ) from error

    def __contains__(self, name: str) -> bool:
        return name in self.tables

    def table(self, name: str, columns: tuple[str, ...], stale: float = 0.0) -> FloatArray:
        """The table of a name, (n, len(columns)).

        Args:
            name: of the table.
            columns: what they hold; a first one called "time" must not go backwards.
            stale: see `in_order`.

        Raises:
            LogError: there is none, it has other columns, holds NaN or goes back in time.
        """
        if name not in self.tables:
            raise LogError(
                f"{self.path}: expected the table {name!r}, found {', '.join(sorted(self.tables))}"
            )
        values = self.tables[name]
        if values.dtype.kind not in "iuf" or values.ndim != 2 or values.shape[1] != len(columns):
            raise LogError(
                f"{self.path}, {name}: expected numbers in the columns {', '.join(columns)}, "
                f"found {values.dtype} of shape {values.shape}"
            )
        finite = (np.abs(np.asarray(values, np.float64)) < LARGEST).all(1)
        if not finite.all():
            raise LogError(
                f"{self.path}, {name}, row {int(np.argmin(finite))}: expected finite numbers, "
                f"found {values[np.argmin(finite)].tolist()}"
            )
        table = np.asarray(values, np.float64)
        if columns[0] != "time":
            return table
        return in_order(table, stale, lambda row: f"{self.path}, {name}, row {row}")
