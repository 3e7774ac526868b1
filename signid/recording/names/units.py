"""Units of columns, with exact factors to those of recordings."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError, shorten
from ...types import Array

Units = Mapping[str, tuple[float, float]]  # numerator and denominator of the factor by unit
TIME: Units = {"s": (1, 1), "ms": (1, 1e3), "us": (1, 1e6), "ns": (1, 1e9), "min": (60, 1), "h": (3600, 1)}
ANGLE: Units = {"rad": (1, 1), "mrad": (1, 1e3), "deg": (pi, 180), "rev": (2 * pi, 1)}
LENGTH: Units = {"m": (1, 1), "cm": (1, 100), "mm": (1, 1e3), "um": (1, 1e6)}
FORCE: Units = {"N": (1, 1), "mN": (1, 1e3), "kN": (1e3, 1), "kgf": (9.80665, 1)}
TORQUE: Units = {
    "N.m": (1, 1),
    "mN.m": (1, 1e3),
    "N.cm": (1, 100),
    "N.mm": (1, 1e3),
    "kN.m": (1e3, 1),
    "kgf.m": (9.80665, 1),
    "kgf.cm": (9.80665, 100),
}
CURRENT: Units = {"A": (1, 1), "mA": (1, 1e3)}
DUTY: Units = {"1": (1, 1), "%": (1, 100)}
VOLTAGE: Units = {"V": (1, 1), "mV": (1, 1e3), "dV": (1, 10)}
TEMPERATURE: Units = {"C": (1, 1), "degC": (1, 1)}


def _rates(units: Units, power: str) -> Units:
    return {f"{unit}/s{power}": factor for unit, factor in units.items()}


OF: Mapping[str, tuple[Units, Units]] = {  # at revolute and at prismatic joints
    "t": (TIME, TIME),
    "q": (ANGLE, LENGTH),
    "q_des": (ANGLE, LENGTH),
    "dq": ({**_rates(ANGLE, ""), "rpm": (pi, 30)}, _rates(LENGTH, "")),
    "ddq": (_rates(ANGLE, "2"), _rates(LENGTH, "2")),
    "tau": (TORQUE, FORCE),
    "abs_tau": (TORQUE, FORCE),
    "current": (CURRENT, CURRENT),
    "abs_current": (CURRENT, CURRENT),
    "dq_des": ({**_rates(ANGLE, ""), "rpm": (pi, 30)}, _rates(LENGTH, "")),
    "tau_ff": (TORQUE, FORCE),
    "on": ({"1": (1, 1)}, {"1": (1, 1)}),
    "pwm": (DUTY, DUTY),
    "volt": (VOLTAGE, VOLTAGE),
    "temp": (TEMPERATURE, TEMPERATURE),
}
TURN = 65536.0  # values of a register of 16 bits


class Change(NamedTuple):
    """Conversion of a unit: value * scale / over + offset."""

    scale: float = 1.0
    over: float = 1.0
    offset: float = 0.0

    def apply(self, values: Array, start: int = 0) -> Array:
        """Convert values (N,) [unit of the source]; `start` is not used."""
        return values * self.scale / self.over + self.offset


def signed_register(values: Array, start: int = 0) -> Array:
    """Duties whose signed numbers were read as unsigned ones of 16 bits, with their sign.

    values: (N,) [any unit] of a register; `start` is not used.
    """
    return np.where(values > TURN / 2 - 1, values - TURN, values)


def change_of(unit: str, kind: str, prismatic: bool | None, subject: str) -> Change:
    """Conversion from a unit ("N.m" and "Nm" are equivalent) of a kind of column (q, tau, ...) to that of recordings.

    `prismatic` is None if the type of the joint is unknown; `subject` begins the error message.

    Raises:
        RecordingError: unknown unit, or a unit that does not fit the kind of column or joint.
    """
    turning, sliding = OF[kind]
    known = {**sliding, **turning} if prismatic is None else sliding if prismatic else turning
    spelt = {name.replace(".", ""): name for name in known}
    name = unit if unit in known else spelt.get(unit.replace("*", "").replace(" ", ""), "")
    if not name:
        joint = "prismatic" if prismatic else "revolute"
        at = "" if prismatic is None or turning is sliding else f" at a {joint} joint"
        raise RecordingError(f"{subject} has the unit {unit!r}; expected{at} {shorten(list(known), 12)}")
    return Change(*known[name])
