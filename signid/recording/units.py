"""Units of columns, noticed from their names and numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..types import Array, Robot
from .names.match import Guess
from .names.vocabulary import OF, TURN, Change, Units, signed_register
from .sampling.clock import MAX_STEP, MIN_STEP

EPOCH = 1.0e9, 2.5e9  # [s] time stamps since 1970 of the years 2001 to 2049
LIMIT_MARGIN = {False: 0.35, True: 0.02}  # [rad], [m] accepted distance beyond limits, by whether a joint is prismatic
FREE = {False: 60.0, True: 10.0}  # [rad], [m] largest plausible position without limits
Q_UNITS = {False: ("rad", "deg", "mrad"), True: ("m", "mm", "um")}  # units of positions, the most usual first
COUNTS = 400.0  # smallest size of whole numbers that are counts of an encoder [1]
TURNS = (1024, 4096, 16384, 65536)  # usual counts of a turn
DRIFT = 0.1  # [s] intervals over which velocity is compared with position
MAX_LOG_RATIO = 0.3  # largest logarithm of the ratio of both for a unit
STRONG = 20.0  # torque over the limit of the description beyond which the unit is smaller than N.m
DUTY, REGISTERS = 1.01, (100.0, 885.0, 1000.0, 1023.0)  # largest duty; registers of a full one: %, XL330, STS, AX
UNIT_LIMITS = {  # [V], [A] beyond which numbers are in a smaller unit
    "volt": (("mV", 1000.0), ("dV", 60.0)),
    "current": (("mA", 60.0),),
}
LOAD = "a load may be in per mille of the largest torque"
PERCENT = "the names state per cent; write scale = rated torque / 100"
NAMELESS = "no name states that these are positions"
UNSTATED = (
    "LeRobot datasets do not say whether numbers are degrees or per cent of the calibrated range, and a gripper's are "
    "0 to 100 % in any case; give the calibration file (--calibration), or write scale and offset"
)


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
        if EPOCH[0] <= last * scale / over <= EPOCH[1] and MIN_STEP <= step * scale / over <= MAX_STEP:
            since = "" if unit == "s" else f" of {unit}"
            return Noticed(unit, f"begins at {known[0]:.10g}: a count{since} since 1970, in steps of {step:.4g}")
    whole = step >= 0.5 and bool(np.all(np.abs(known - np.rint(known)) < 1e-6))
    if MIN_STEP <= step <= MAX_STEP and not whole:
        return Noticed("s", f"steps by {step:.4g}")
    found = next((unit for unit, most in (("ms", 500.0), ("us", 5e5), ("ns", np.inf)) if step <= most), "ns")
    return Noticed(found, f"steps by {step:.4g}, which cannot be seconds")


def _position_units(
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
        unit = next((unit for unit in Q_UNITS[slides] if _fits(ends, units[unit], slides, robot)), "")
        worst = max(ends, key=lambda j: max(ends[j][1] - robot.upper[j], robot.lower[j] - ends[j][0]), default=-1)
        why = "the column has no values"
        if ends:
            limits = f"its limits are {robot.lower[worst]:.4g} to {robot.upper[worst]:.4g} {base}"
            why = f"{robot.joints[worst]} goes from {ends[worst][0]:.4g} to {ends[worst][1]:.4g}, {limits}"
        for j in mine:
            own = named.get(j, "")
            caveat = "; assumed" if unit == base else "" if unit else "; no usual unit fits: CHECK"
            found[j] = Noticed(own, "named in the column") if own else Noticed(unit or base, why + caveat)
    return found


def _fits(ends: Mapping[int, tuple[float, float]], factor: tuple[float, float], slides: bool, robot: Robot) -> bool:
    """Whether positions between their ends [any unit] are within the limits of their joints."""
    scale, slack = factor[0] / factor[1], LIMIT_MARGIN[slides]
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


def _velocity_unit(pairs: Sequence[tuple[Array, Array]], t: Array, slides: bool) -> Noticed:
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
    if off[best] > MAX_LOG_RATIO:
        return Noticed(base, f"positions change by {ratio:.3g} of it, which fits no usual unit: CHECK")
    return Noticed(best, f"positions change by {ratio:.3g} of it")


def _torque_unit(values: Mapping[int, Array], base: str, robot: Robot) -> Noticed:
    """Unit of torques, N.m or N, or a thousandth where they are far beyond a limit of the description."""
    for j, x in values.items():
        limit, most = float(robot.effort_limit[j]), _most(x)
        if 0 < limit < np.inf and STRONG * limit < most < STRONG * limit * 1e3:
            return Noticed(f"m{base}", f"{robot.joints[j]} reaches {most:.4g}, its limit is {limit:.4g} {base}")
    return Noticed(base, "assumed")


def _duty_unit(values: Iterable[Array]) -> Noticed | None:
    """Scale of the registers of duties; None where they are duties themselves."""
    most = max((_most(signed_register(x)) for x in values), default=0.0)
    if most <= DUTY:
        return None
    scale = next((full for full in REGISTERS if most <= full * (1 + 1e-9)), most)
    how = ", read as unsigned numbers of 16 bits" if any(bool(np.any(x > TURN / 2)) for x in values) else ""
    why = f"reaches {most:.4g}{how}: a full duty of {scale:.4g} is assumed, CHECK"
    return Noticed("%" if scale == 100 else Change(1.0 / scale), why)


def _most(x: Array) -> float:
    return float(np.nanmax(np.abs(x), initial=0.0))


def noticed_units(
    kind: str,
    guesses: Mapping[int, Guess],
    columns: Mapping[int, Array],
    positions: Mapping[int, Array],
    seconds: Array,
    robot: Robot,
) -> dict[int, Noticed]:
    """Unit of each column of a kind, by index of the joint.

    columns: (N,) [any unit] of each joint; positions: (N,) [rad or m] of those that have them, at seconds (N,) [s].
    """
    if kind in ("q", "q_des"):
        counts = any(one.counts for one in guesses.values())
        units = _position_units(columns, {j: one.unit for j, one in guesses.items()}, counts, robot)
        return {j: unit.with_caveat(nameless=guesses[j].bare and not guesses[j].unit) for j, unit in units.items()}
    found: dict[int, Noticed] = {}
    for slides in (False, True):
        mine = {j: columns[j] for j in guesses if bool(robot.prismatic[j]) == slides}
        base, most = next(iter(OF[kind][slides])), max(map(_most, mine.values()), default=0.0)
        smaller = next((unit for unit, limit in UNIT_LIMITS.get(kind.removeprefix("abs_"), ()) if most > limit), "")
        unit = Noticed(smaller, f"reaches {most:.4g}") if smaller else Noticed(base, f"assumed; reaches {most:.4g}")
        if kind in ("dq", "dq_des"):
            pairs = [(positions[j], x) for j, x in mine.items() if j in positions and len(seconds)]
            unit = _velocity_unit(pairs, seconds, slides)
        elif kind == "ddq":
            unit = Noticed(base, "assumed")
        elif kind == "pwm":
            unit = _duty_unit(mine.values()) or unit
        elif "tau" in kind:
            percent, load = any("%" in guesses[j].column for j in mine), any(guesses[j].load for j in mine)
            unit = _torque_unit(mine, base, robot).with_caveat(percent=percent, load=load)
        for j in mine:
            found[j] = Noticed(guesses[j].unit, "named in the column") if guesses[j].unit else unit
    return found
