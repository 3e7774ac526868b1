"""Units of columns, noticed from their numbers, each with the reason; a guess for the user to check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..types import Array, Robot
from .columns import UNSTATED
from .names.vocabulary import OF, TURN, Change, Units, signed_register
from .sampling.clock import FASTEST, SLOWEST

EPOCH = 1.0e9, 2.5e9  # [s] time stamps since 1970 of the years 2001 to 2049
SLACK = {False: 0.35, True: 0.02}  # [rad], [m] accepted distance beyond the limits, by whether a joint is prismatic
FREE = {False: 60.0, True: 10.0}  # [rad], [m] largest plausible position without limits
USUAL = {False: ("rad", "deg", "mrad"), True: ("m", "mm", "um")}  # units of positions, the most usual first
COUNTS = 400.0  # smallest size of whole numbers that are counts of an encoder [1]
TURNS = (1024, 4096, 16384, 65536)  # usual counts of a turn
DRIFT = 0.1  # [s] intervals over which velocity is compared with position
ALIKE = 0.3  # largest logarithm of the ratio of both for a unit
STRONG = 20.0  # torque over the limit of the description beyond which the unit is smaller than N.m
DUTY, REGISTERS = 1.01, (100.0, 885.0, 1000.0, 1023.0)  # largest duty; registers of a full one: %, XL330, STS, AX
VOLTS, MILLIVOLTS = 60.0, 1000.0  # [V] larger voltages are in tenths, or in thousandths, of a volt
LOAD = "a load may be in per mille of the largest torque"
PERCENT = "the names state per cent; write scale = rated torque / 100"
NAMELESS = "no name states that these are positions"
MILLIAMPERES = 60.0  # [A] larger currents are in milliamperes


class Noticed(NamedTuple):
    """Unit of a column, or its scale and offset, and why."""

    unit: str | Change
    why: str

    def with_caveat(
        self, nameless: bool = False, percent: bool = False, load: bool = False, unstated: bool = False
    ) -> Noticed:
        """The same unit, with the first caveat that holds, for the user to check."""
        caveats = {UNSTATED: unstated, NAMELESS: nameless, PERCENT: percent, LOAD: load}
        caveat = next((text for text, holds in caveats.items() if holds), "")
        return Noticed(self.unit, f"{self.why}; {caveat}: CHECK") if caveat else self


def time_unit(t: Array, named: str) -> Noticed:
    """Unit of time stamps t (N,) [any unit]; `named` is the unit in the name of the column, "" without one."""
    known = t[np.isfinite(t)]
    steps = np.diff(known)
    steps = steps[steps > 0]
    if named or not len(steps):
        return Noticed(named or "s", "named in the column" if named else "assumed")
    step, last = float(np.median(steps)), float(np.abs(known).max())
    for unit, (scale, over) in OF["t"][0].items():
        if EPOCH[0] <= last * scale / over <= EPOCH[1] and FASTEST <= step * scale / over <= SLOWEST:
            since = "" if unit == "s" else f" of {unit}"
            return Noticed(unit, f"begins at {known[0]:.10g}: a count{since} since 1970, in steps of {step:.4g}")
    whole = step >= 0.5 and bool(np.all(known == np.rint(known)))
    if FASTEST <= step <= SLOWEST and not whole:
        return Noticed("s", f"steps by {step:.4g}")
    found = next((unit for unit, most in (("ms", 500.0), ("us", 5e5), ("ns", np.inf)) if step <= most), "ns")
    return Noticed(found, f"steps by {step:.4g}, which cannot be seconds")


def position_units(
    values: Mapping[int, Array], named: Mapping[int, str], counts: bool, robot: Robot
) -> dict[int, Noticed]:
    """Units of position columns by index of the joint; `counts`: they are named as counts.

    values: (N,) [any unit] of each joint.
    """
    found: dict[int, Noticed] = {}
    for slides, units in ((False, OF["q"][0]), (True, OF["q"][1])):
        mine = {j: x[np.isfinite(x)] for j, x in values.items() if bool(robot.prismatic[j]) == slides}
        ends = {j: (float(x.min()), float(x.max())) for j, x in mine.items() if len(x)}
        whole = all(bool(np.all(x == np.rint(x))) for x in mine.values())
        most = max((abs(end) for both in ends.values() for end in both), default=0.0)
        if ends and whole and not slides and not any(named.get(j) for j in mine) and (counts or most > COUNTS):
            found |= _counts(ends)
            continue
        base = next(iter(units))
        unit = next((unit for unit in USUAL[slides] if _fits(ends, units[unit], slides, robot)), "")
        worst = max(ends, key=lambda j: max(ends[j][1] - robot.upper[j], robot.lower[j] - ends[j][0]), default=-1)
        why = _reach(worst, ends[worst], base, robot) if ends else "the column has no values"
        for j in mine:
            own = named.get(j, "")
            caveat = "; assumed" if unit == base else "" if unit else "; no usual unit fits: CHECK"
            found[j] = Noticed(own, "named in the column") if own else Noticed(unit or base, why + caveat)
    return found


def _reach(j: int, ends: tuple[float, float], base: str, robot: Robot) -> str:
    limits = f"its limits are {robot.lower[j]:.4g} to {robot.upper[j]:.4g} {base}"
    return f"{robot.joints[j]} goes from {ends[0]:.4g} to {ends[1]:.4g}, {limits}"


def _fits(ends: Mapping[int, tuple[float, float]], factor: tuple[float, float], slides: bool, robot: Robot) -> bool:
    """Whether positions between their ends [any unit] are within the limits of their joints."""
    scale, slack = factor[0] / factor[1], SLACK[slides]
    for j, (low, high) in ends.items():
        lower, upper = robot.lower[j], robot.upper[j]
        if not (np.isfinite(lower) and np.isfinite(upper) and lower < upper):
            lower, upper = -FREE[slides], FREE[slides]
        if low * scale < lower - slack or high * scale > upper + slack:
            return False
    return True


def _counts(ends: Mapping[int, tuple[float, float]]) -> dict[int, Noticed]:
    """Scale and offset of counts of encoders; half a turn is zero if all counts are of one turn."""
    low, high = min(a for a, _ in ends.values()), max(b for _, b in ends.values())
    turn = next((n for n in TURNS if low >= 0 and high < n), 0)
    size = turn or 4096
    change = Change(2 * np.pi / size, 1.0, -np.pi if turn else 0.0)
    zero = f"zero at {turn // 2}" if turn else "zero at 0"
    why = f"whole numbers from {low:.0f} to {high:.0f}: encoder counts; {size} a turn and {zero} are assumed, CHECK"
    return {j: Noticed(change, why) for j in ends}


def velocity_unit(pairs: Sequence[tuple[Array, Array]], t: Array, slides: bool) -> Noticed:
    """Unit of velocities from pairs of positions (N,) [rad or m] and velocities (N,) [any unit] at t (N,) [s]."""
    units: Units = OF["dq"][slides]
    base, up, down = next(iter(units)), 0.0, 0.0
    period = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    step = max(1, round(DRIFT / period)) if period > 0 else 1
    for q, v in pairs:
        moved = q[step::step] - q[:-step:step]
        area = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t))])
        swept = area[step::step] - area[:-step:step]
        known = np.isfinite(moved) & np.isfinite(swept)
        up, down = up + float(moved[known] @ swept[known]), down + float(swept[known] @ swept[known])
    if up <= 0 or down <= 0:
        return Noticed(base, "assumed")
    ratio = up / down
    off = {unit: abs(float(np.log(ratio * over / scale))) for unit, (scale, over) in units.items()}
    best = min(off, key=lambda unit: off[unit])
    if off[best] > ALIKE:
        return Noticed(base, f"positions change by {ratio:.3g} of it, which fits no usual unit: CHECK")
    return Noticed(best, f"positions change by {ratio:.3g} of it")


def torque_unit(values: Mapping[int, Array], robot: Robot, slides: bool) -> Noticed:
    """Unit of torque columns by index of the joint; values: (N,) [any unit] of each."""
    base, small = ("N", "mN") if slides else ("N.m", "mN.m")
    for j, x in values.items():
        limit, most = float(robot.effort_limit[j]), float(np.nanmax(np.abs(x), initial=0.0))
        if 0 < limit < np.inf and STRONG * limit < most < STRONG * limit * 1e3:
            return Noticed(small, f"{robot.joints[j]} reaches {most:.4g}, its limit is {limit:.4g} {base}")
    return Noticed(base, "assumed")


def drive_unit(kind: str, values: Mapping[int, Array]) -> Noticed:
    """Unit of what drives record, by index of the joint.

    kind: on, pwm, volt or temp; values: (N,) [any unit] of each.
    """
    sizes = [float(np.nanmax(np.abs(signed_register(x)), initial=0.0)) for x in values.values()]
    most = max(sizes, default=0.0)
    wrapped = any(bool(np.any(x > TURN / 2)) for x in values.values())
    if kind == "pwm" and most > DUTY:
        scale = next((full for full in REGISTERS if most <= full * (1 + 1e-9)), most)
        how = ", read as unsigned numbers of 16 bits" if wrapped else ""
        why = f"reaches {most:.4g}{how}: a full duty of {scale:.4g} is assumed, CHECK"
        return Noticed("%" if scale == 100 else Change(1.0 / scale), why)
    if kind == "volt" and most > VOLTS:
        return Noticed("mV" if most > MILLIVOLTS else "dV", f"reaches {most:.4g}")
    return Noticed("C" if kind == "temp" else "V" if kind == "volt" else "1", f"assumed; reaches {most:.4g}")


def current_unit(values: Mapping[int, Array]) -> Noticed:
    """Unit of current columns by index of the joint; values: (N,) [any unit] of each."""
    most = max((float(np.nanmax(np.abs(x), initial=0.0)) for x in values.values()), default=0.0)
    return Noticed("mA", f"reaches {most:.4g}") if most > MILLIAMPERES else Noticed("A", f"assumed; reaches {most:.4g}")
