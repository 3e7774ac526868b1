"""Base classes of frozen types and of results, with their display in a Python session.

`signid.output.display` renders results. It comes after every result, so it is imported when it is first used.
"""

from __future__ import annotations

from dataclasses import fields
from importlib import import_module
from reprlib import Repr
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import OptionError, named_for_caller

if TYPE_CHECKING:
    import polars as pl

DISPLAY = ".output.display"
MAX_VALUE_CHARACTERS, MAX_SHOWN_ITEMS = 120, 4  # of a container, in a repr


class Frozen:
    """Base class of frozen types: copies every array and sets it read-only; the repr has one line."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]  # else a dataclass makes one of all numbers

    def __post_init__(self) -> None:
        for item in fields(self):  # type: ignore[arg-type]
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                copy = value.copy()
                copy.setflags(write=False)
                object.__setattr__(self, item.name, copy)

    def __repr__(self) -> str:
        shown = (f"{item.name}={FIELD_REPR.repr(getattr(self, item.name))}" for item in fields(self))  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(shown)})"


class WithSentences:
    """Base class of frozen types whose sentences name arguments of Python; on the command line, options."""

    def __post_init__(self) -> None:
        for name in vars(self).keys() & {"flags", "notes", "sentence"}:
            said = getattr(self, name)
            named = named_for_caller(said) if isinstance(said, str) else tuple(map(named_for_caller, said))
            object.__setattr__(self, name, named)


class Result(Frozen, WithSentences):
    """Base class of results: a repr of at most 40 lines, HTML in notebooks and tables by name.

    Its `flags` and `notes` name arguments of Python; on the command line, options.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        WithSentences.__post_init__(self)

    def __repr__(self) -> str:
        return str(show_with("text", self))

    def _repr_html_(self) -> str:
        return str(show_with("html", self))

    def to_frame(self, name: str | None = None) -> pl.DataFrame:
        """Return a table of the result as a polars frame.

        Args:
            name: name of the table, as the last line of the repr lists them; None: the first one.

        Raises:
            OptionError: the result has no such table; the sentence lists the names.
        """
        frame: pl.DataFrame = show_with("frame", self, name)
        return frame

    def to_pandas(self, name: str | None = None) -> Any:
        """Return a table of the result as a pandas frame.

        Args:
            name: name of the table, as the last line of the repr lists them; None: the first one.

        Raises:
            OptionError: the result has no such table, or pandas is not installed.
        """
        try:
            pandas = import_module("pandas")
        except ImportError:
            raise OptionError("pandas is not installed; install it, or use to_frame(), which gives polars") from None
        return pandas.DataFrame({column.name: column.to_list() for column in self.to_frame(name)})


class _FieldRepr(Repr):
    """Short repr of the values of fields: shapes of arrays, names of results, the first items of containers."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = MAX_VALUE_CHARACTERS
        self.maxtuple = self.maxlist = self.maxdict = MAX_SHOWN_ITEMS

    def repr1(self, x: Any, level: int) -> str:
        """Repr of a value, nested up to `level`."""
        return f"<{type(x).__name__}>" if isinstance(x, Result) else super().repr1(x, level)

    def repr_ndarray(self, x: Any, level: int) -> str:
        """Numbers of a short vector, else the shape."""
        short = x.ndim == 1 and x.size <= 2 * MAX_SHOWN_ITEMS
        return np.array2string(x, precision=4, max_line_width=10_000) if short else f"<array {x.shape}>"


FIELD_REPR = _FieldRepr()


def show_with(name: str, *given: Any) -> Any:
    """Call a function of `signid.output.display`."""
    return getattr(import_module(DISPLAY, __package__), name)(*given)
