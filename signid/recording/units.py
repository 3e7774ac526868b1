"""Units as they are written in the names of columns: `q_1 [rad]`, `tau_2 (Nm)`, `time_ms`."""

from __future__ import annotations

import re

UNITS = {  # unit by its spellings at the end of a name
    "deg/s": ("deg/s", "deg_s", "degs", "dps"),
    "rad/s": ("rad/s", "rad_s", "rads"),
    "rpm": ("rpm",),
    "deg": ("deg", "degree", "degrees", "°", "grad"),
    "mrad": ("mrad",),
    "rad": ("rad", "radian", "radians"),
    "mm": ("mm",),
    "ms": ("ms", "msec", "msecs", "millis", "milliseconds"),
    "us": ("us", "usec", "usecs", "micros", "microseconds"),
    "ns": ("ns", "nsec", "nsecs", "nanos", "nanoseconds"),
    "s": ("s", "sec", "secs", "seconds"),
    "mN.m": ("mnm", "mn.m"),
    "N.cm": ("ncm", "n.cm"),
    "N.m": ("nm", "n.m", "n*m"),
    "mA": ("ma",),
}
BRACKETED = {  # units that only brackets, or a row of units, distinguish from names, by their spelling
    **{"a": "A", "m": "m", "n": "N", "v": "V", "mv": "mV", "c": "C", "degc": "C", "°c": "C", "h": "h"},
    **{"°/s": "deg/s", "m/s": "m/s", "mm/s": "mm/s", "cm": "cm", "um": "um", "µm": "um", "µs": "us", "min": "min"},
    **{"rad/s2": "rad/s2", "rad/s^2": "rad/s2", "rad/s²": "rad/s2", "rad/s/s": "rad/s2"},
    **{"deg/s2": "deg/s2", "deg/s^2": "deg/s2", "deg/s²": "deg/s2", "°/s²": "deg/s2", "°/s^2": "deg/s2"},
    **{"m/s2": "m/s2", "m/s^2": "m/s2", "m/s²": "m/s2", "n·m": "N.m", "n-m": "N.m", "newton": "N", "amp": "A"},
    **{"nmm": "N.mm", "n.mm": "N.mm", "knm": "kN.m", "kn.m": "kN.m", "kn": "kN", "rev": "rev", "mrad/s": "mrad/s"},
}
SPELLINGS = {spelt: unit for unit, known in UNITS.items() for spelt in known}
BRACKETS = re.compile(r"\s*[\[(]\s*([^\[\]()\s](?:[^\[\]()]{0,20}[^\[\]()\s])?)\s*[\])]\s*$")
NONE = ("", "-", "[]", "[-]", "()", "(-)")  # cells of a row of units for columns without one


def bracketed(name: str) -> tuple[str, str]:
    """A name without the unit in brackets at its end, and this unit; the name itself and "" without a known one."""
    inside = BRACKETS.search(name[-60:])
    unit = _known(inside[1]) if inside else ""
    return (name[: inside.start() + max(0, len(name) - 60)], unit) if inside and unit else (name, "")


def unit_row(cells: list[str]) -> list[str] | None:
    """Units of the cells of a row, "" for cells without one; None if it is no row of units."""
    found = ["" if cell.strip() in NONE else _known(cell.strip().strip("[]()")) or None for cell in cells]
    units = [unit for unit in found if unit is not None]
    return units if len(units) == len(found) and any(units) else None


def _known(spelt: str) -> str:
    lower = spelt.strip().lower()
    return SPELLINGS.get(lower) or BRACKETED.get(lower) or ""
