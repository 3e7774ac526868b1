"""Units that logs come in, as exact factors to those of recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import NamedTuple

from ..errors import RecordingError, shorten
from ..types import Array, Table

Factor = tuple[float, float]  # numerator and denominator: a value times the one, over the other

TIME: Mapping[str, Factor] = {
    "s": (1, 1),
    "ms": (1, 1e3),
    "us": (1, 1e6),
    "ns": (1, 1e9),
    "min": (60, 1),
    "h": (3600, 1),
}
ANGLE: Mapping[str, Factor] = {"rad": (1, 1), "mrad": (1, 1e3), "deg": (pi, 180), "rev": (2 * pi, 1)}
LENGTH: Mapping[str, Factor] = {"m": (1, 1), "cm": (1, 100), "mm": (1, 1e3), "um": (1, 1e6)}
TORQUE: Mapping[str, Factor] = {
    "N.m": (1, 1),
    "mN.m": (1, 1e3),
    "N.cm": (1, 100),
    "N.mm": (1, 1e3),
    "kN.m": (1e3, 1),
    "kgf.m": (9.80665, 1),
    "kgf.cm": (9.80665, 100),
}
FORCE: Mapping[str, Factor] = {"N": (1, 1), "mN": (1, 1e3), "kN": (1e3, 1), "kgf": (9.80665, 1)}
CURRENT: Mapping[str, Factor] = {"A": (1, 1), "mA": (1, 1e3)}


def _rates(units: Mapping[str, Factor], power: str) -> dict[str, Factor]:
    return {f"{unit}/s{power}": factor for unit, factor in units.items()}


OF: Mapping[str, tuple[Mapping[str, Factor], Mapping[str, Factor]]] = {  # at revolute and at prismatic joints
    "t": (TIME, TIME),
    "q": (ANGLE, LENGTH),
    "q_des": (ANGLE, LENGTH),
    "dq": ({**_rates(ANGLE, ""), "rpm": (pi, 30)}, _rates(LENGTH, "")),
    "ddq": (_rates(ANGLE, "2"), _rates(LENGTH, "2")),
    "tau": (TORQUE, FORCE),
    "abs_tau": (TORQUE, FORCE),
    "current": (CURRENT, CURRENT),
    "abs_current": (CURRENT, CURRENT),
}


class Change(NamedTuple):
    """value * scale / over + offset."""

    scale: float = 1.0
    over: float = 1.0
    offset: float = 0.0


def change_of(unit: str, kind: str, prismatic: bool | None, what: str) -> Change:
    """What makes a unit that of recordings.

    Args:
        unit: as it is written, "deg"; a dot or nothing stands between "N" and "m".
        kind: of the column: t, q, tau, ...
        prismatic: whether its joint is; None where that is not known.
        what: begins the sentence about a unit that does not fit.

    Raises:
        RecordingError: there is no such unit, or not for this kind of column or joint.
    """
    turning, sliding = OF[kind]
    known = {**sliding, **turning} if prismatic is None else sliding if prismatic else turning
    spelt = {name.replace(".", ""): name for name in known}
    name = unit if unit in known else spelt.get(unit.replace("*", "").replace(" ", ""), "")
    if not name:
        at = (
            "" if prismatic is None or turning is sliding else f" at a {'prismatic' if prismatic else 'revolute'} joint"
        )
        raise RecordingError(f"{what} is said to be in {unit!r}; expected{at} {shorten(list(known), 12)}")
    return Change(*known[name])


class Changed:
    """A table that shows some columns in other units."""

    def __init__(self, table: Table, changes: Mapping[str, Change]) -> None:
        self._table, self._changes = table, changes
        self.columns, self.rows = table.columns, table.rows

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Rows start..stop of the columns named, (stop - start, len(names)), in the units of recordings."""
        values = self._table.read(names, start, stop).copy()
        for k, name in enumerate(names):
            if change := self._changes.get(name):
                values[:, k] = values[:, k] * change.scale / change.over + change.offset
        return values
