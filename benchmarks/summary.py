"""Shared output of benchmarks: tables and JSON-compatible numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table


def frame(title: str, names: Sequence[str], left: int = 1) -> Table:
    """Empty table whose first `left` columns are left-aligned text."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title=title)
    for k, name in enumerate(names):
        table.add_column(name, justify="left" if k < left else "right", no_wrap=True)
    return table


def print_targets(console: Console, targets: Iterable[tuple[str, bool]]) -> bool:
    """Print each target, missed ones in red; return whether all are met."""
    listed = list(targets)
    for sentence, met in listed:
        console.print(sentence, style="" if met else "red", highlight=False)
    return all(met for _, met in listed)


def finite(x: Any) -> Any:
    """Replace numbers that JSON cannot represent by None."""
    if isinstance(x, dict):
        return {key: finite(value) for key, value in x.items()}
    if isinstance(x, list | tuple):
        return [finite(value) for value in x]
    return None if isinstance(x, float) and not math.isfinite(x) else x
