"""Units of logs, with exact factors to the units of recordings."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import NamedTuple

from ..errors import RecordingError, shorten
from ..types import Array, Table
from .table import DerivedTable

Factor = tuple[float, float]  # numerator and denominator of the factor

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
    """Conversion of a unit: value * scale / over + offset."""

    scale: float = 1.0
    over: float = 1.0
    offset: float = 0.0

    def apply(self, values: Array, start: int = 0) -> Array:
        """Convert values (N,) [unit of the source] that begin at row `start`."""
        return values * self.scale / self.over + self.offset


def change_of(unit: str, kind: str, prismatic: bool | None, subject: str) -> Change:
    """Conversion from a unit to that of recordings.

    Args:
        unit: name of the unit, "deg"; "N.m" and "Nm" are equivalent.
        kind: kind of the column: t, q, tau, ...
        prismatic: whether the joint is prismatic; None if unknown.
        subject: subject of the error message.

    Raises:
        RecordingError: unknown unit, or a unit that does not fit the kind of column or joint.
    """
    turning, sliding = OF[kind]
    known = {**sliding, **turning} if prismatic is None else sliding if prismatic else turning
    spelt = {name.replace(".", ""): name for name in known}
    name = unit if unit in known else spelt.get(unit.replace("*", "").replace(" ", ""), "")
    if not name:
        at = (
            "" if prismatic is None or turning is sliding else f" at a {'prismatic' if prismatic else 'revolute'} joint"
        )
        raise RecordingError(f"{subject} has the unit {unit!r}; expected{at} {shorten(list(known), 12)}")
    return Change(*known[name])


def in_units(table: Table, changes: Mapping[str, Change]) -> Table:
    """Table with converted columns."""
    return DerivedTable(table, {name: change.apply for name, change in changes.items()})
