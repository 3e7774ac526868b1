"""Caches of the evidence, which hold results beyond one linear model."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from ...types import Array
from ..data.column_groups import Group
from ..data.normal_equations import Fitted
from ..data.whitened_rows import Gram
from .components import Component
from .prior import CoefficientPrior

FITS, COMPONENT_FITS, GRAMS = 64, 256, 32  # entries of the caches of columns
Value = TypeVar("Value")


class LRUCache(Generic[Value]):
    """Cache that drops the least recently used entry.

    Unlike functools.lru_cache, the key need not be the arguments: they are arrays and rows, which have no hash.
    """

    def __init__(self, size: int) -> None:
        self.size, self.entries = size, dict[Hashable, Value]()

    def __call__(self, key: Hashable, compute: Callable[[], Value]) -> Value:
        """The entry of a key, computed if it is missing."""
        value = self.entries.pop(key) if key in self.entries else compute()
        self.entries[key] = value
        if len(self.entries) > self.size:
            del self.entries[next(iter(self.entries))]
        return value


class ColumnCache:
    """Results that depend on some columns only, and stay valid when the rows get more columns."""

    def __init__(self) -> None:
        self.coefficient_priors = dict[Group, CoefficientPrior | None]()
        self.precisions = dict[Group, Array]()
        self.imitated = dict[Group, float]()
        self.fits = LRUCache[Fitted](FITS)
        self.component_fits = LRUCache[Fitted](COMPONENT_FITS)
        self.components = LRUCache[tuple[Component, ...]](FITS)
        self.grams = LRUCache[Gram](GRAMS)
        self.stated_precisions = LRUCache[Array](GRAMS)
