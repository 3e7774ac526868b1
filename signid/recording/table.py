"""Tables whose columns are computed from those of another table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ..types import Array, Table


class DerivedTable:
    """A table that applies a function to some columns of another one as they are read."""

    def __init__(self, table: Table, functions: Mapping[str, Callable[[Array, int], Array]]) -> None:
        """Functions map the values (N,) of a column and the number of their first row to new values (N,)."""
        self._table, self._functions = table, functions
        self.columns, self.rows = table.columns, table.rows

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Rows start..stop of the named columns, (stop - start, len(names))."""
        values = self._table.read(names, start, stop).copy()
        for k, name in enumerate(names):
            if name in self._functions:
                values[:, k] = self._functions[name](values[:, k], start)
        return values
