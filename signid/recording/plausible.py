"""Columns of drives whose numbers cannot be meant."""

from __future__ import annotations

import numpy as np

from ..types import Table
from .sampling.clock import CHUNK

PLAUSIBLE = {  # smallest and largest accepted value of columns of drives
    "pwm": (-1.01, 1.01, 'duties from -1 to 1: state [units] pwm = "%" or a scale in a column map (--columns)'),
    "on": (0.0, 1.0, "1 while the drive holds and 0 while it does not"),
    "volt": (0.0, 1e3, 'volts: state [units] volt = "mV" or "dV" in a column map (--columns)'),
}

MIDDLE = 0.1  # share of the largest value below, or beside, which duties lie that were read as unsigned numbers
UNWRAP = (
    "it holds signed numbers of 16 bits that were read as unsigned and then scaled: give the register itself and its "
    "scale in a column map (--columns)"
)


def drop_implausible(table: Table, chosen: dict[str, tuple[str, ...]]) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """Columns without those of drives whose numbers cannot be meant, and a note for each of these."""
    chosen, said = dict(chosen), []
    for key, (low, high, expected) in PLAUSIBLE.items():
        names = [name for name in chosen[key] if name]
        pieces = (table.read(names, start, start + CHUNK) for start in range(0, table.rows if names else 0, CHUNK))
        ends = [(np.nanmin(x, axis=0, initial=0.0), np.nanmax(x, axis=0, initial=0.0)) for x in pieces]
        for k, name in enumerate(names):
            least, most = min(float(a[k]) for a, _ in ends), max(float(b[k]) for _, b in ends)
            if least < low or most > high:
                chosen[key] = tuple("" if each == name else each for each in chosen[key])
                wrapped = key == "pwm" and least >= 0 and _wrapped(table, name, most)
                fact = f"column {name!r} goes from {least:.4g} to {most:.4g} and is ignored"
                said.append(f"{fact}; {UNWRAP if wrapped else f'expected {expected}'}")
    return chosen, said


def _wrapped(table: Table, name: str, most: float) -> bool:
    """Whether values are small or nearly the largest: negative numbers that were read as unsigned ones."""
    values = table.read([name], 0, min(table.rows, CHUNK))[:, 0]
    known = values[np.isfinite(values)]
    small = known[known <= MIDDLE * most]
    large = known >= (1 - MIDDLE) * most
    return bool(len(small) and large.any() and len(small) + large.sum() == len(known) and small.max() <= 1.01)
