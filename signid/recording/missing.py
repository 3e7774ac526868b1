"""Missing values and positions: short holes are bridged from the rows beside them, and speeds integrated; both said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..errors import RecordingError, shorten
from ..robot import configuration
from ..robot.dynamics import rigid_torque
from ..types import Array, Indices, Recording, Robot, Table
from .columns import Assignment
from .formats.base import MemoryTable
from .mapping import DerivedTable, Signal
from .sampling.clock import CHUNK, GAP, GAP_SECONDS, MAX_STEP, MIN_STEP, repair_stamps
from .vocabulary import INTEGRAL

SIGNALS = ("t", "q", "tau", "dq", "ddq", "q_des")
PERIODS, SECONDS = 6.5, 0.05  # [periods], [s] holes that are no longer than both are short, too
WRAP = 3.0  # [rad or m] change of a position across a hole that may be a wrap of its encoder, which is left alone
MIN_SLOPE_PERIODS = 0.2  # [periods] distance of rows below which they state no slope
STATES, TORQUE_CHANGE = 8, 1e-9  # random states; [1] relative change of torque that is rounding
MUCH = 0.1  # [1] bridged share of a column from which results are flagged
DISORDER = 0.7  # [1] mean square step of positions over twice their variance, above which rows jump; 1: white noise
STANDSTILL = 0.05  # [rad or m] largest range of positions that are noise of joints at rest
MIN_POSTURE_PERIOD = 0.2  # [s] smallest time between rows of postures
SWEEP = 1.0  # [s] smallest time between rows of a smooth sweep of postures
SLOWEST_SWEEP = 4e-3  # [rad/s or m/s] its smallest speed; stamps in ms would make it 4 rad/s, which few robots keep
APPROACH = 1e-3  # [rad/s or m/s] velocity that stands for the direction of approach; its inertial torque is negligible
MAX_EXAMINED_ROWS, MIN_EXAMINED_ROWS = 65_536, 8  # rows that are examined, and that are needed


def with_repaired_stamps(recording: Recording) -> Recording:
    """The recording with times in place of stamps that go back a little, or have too few digits; both noted."""
    table, (time, *_) = recording.table, recording.columns["t"]
    stamps = table.read([time], 0, table.rows)[:, 0]
    finite = np.isfinite(stamps)
    if not (np.diff(stamps if finite.all() else stamps[finite]) <= 0).any():
        return recording
    known = np.flatnonzero(finite)
    positions = [column for column in recording.columns["q"] if column]
    repaired = repair_stamps(stamps[known], np.array(table.read(positions, 0, table.rows)[known]))
    if repaired is None:
        return recording
    added, order = {time: stamps.copy()}, np.arange(table.rows)
    if repaired.order is not None:
        order[known] = known[repaired.order]
        used = dict.fromkeys(name for group in recording.columns.values() for name in group if name)
        added = {name: np.array(table.read([name], 0, table.rows)[order, 0]) for name in used}
    added[time][known] = repaired.times
    notes = (*recording.notes, repaired.note)
    return replace(recording, table=DerivedTable(table, {}, added), notes=notes)


def bridge(recording: Recording) -> Recording:
    """The recording with short holes of time, positions, their derivatives, torques and commands bridged, and said.

    A hole is short if the known values beside it are at most 3.5 periods or 10 ms apart, as for rows that are missing
    altogether, or 6.5 periods that are at most 50 ms. Its values are those of the cubic through two known values on
    either side; of the line for time, commands and unsigned torques, which stay nonnegative.
    """
    table, columns = recording.table, recording.columns
    names = tuple(dict.fromkeys(c for key in SIGNALS for c in columns.get(key, ()) if c))
    stamps = table.read(names[:1], 0, CHUNK)[:, 0]
    steps = np.diff(stamps[np.isfinite(stamps)])
    period = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if not MIN_STEP <= period <= MAX_STEP:
        return recording
    longest = max(GAP * period, GAP_SECONDS, min(PERIODS * period, SECONDS)) * (1 + 1e-6)
    positions, reach = {*columns["q"], *columns.get("q_des", ())}, 4 * int(longest / period) + 4
    straight = {names[0], *columns.get("q_des", ()), *np.array(columns["tau"])[~recording.signed].tolist()}
    holes: dict[str, list[tuple[Indices, Array]]] = {}
    for start in range(0, table.rows, CHUNK):
        low = max(0, start - reach)
        values = np.array(table.read(names, low, min(table.rows, start + CHUNK + reach)))
        lost = np.array(np.isnan(values).any(axis=0))
        lost[0], t = lost.any(), np.asarray(np.arange(len(values)) * period)
        for k in np.flatnonzero(lost).tolist():  # first the stamps, by their rows; then the others, by their stamps
            max_change = WRAP if names[k] in positions else np.inf if k else longest
            rows, filled = _bridged(t, values[:, k], (period, longest, max_change), names[k] in straight)
            values[rows, k], t = filled, t if k else values[:, 0]
            inside = (rows >= start - low) & (rows < start - low + CHUNK)
            holes.setdefault(names[k], []).append((rows[inside] + low, filled[inside]))
    parts = {
        name: (np.concatenate([r for r, _ in pieces]), np.concatenate([x for _, x in pieces]))
        for name, pieces in holes.items()
    }
    counts = {name: len(rows) for name, (rows, _) in parts.items() if len(rows)}
    if not counts:
        return recording
    where = shorten([f"{count} in {name}" for name, count in counts.items()], 6)
    apart, total = f"at most {longest * 1e3:.3g} ms apart", sum(counts.values())
    note = (
        f"{total} missing {'value is' if total == 1 else 'values are'} bridged from the rows beside, {apart} ({where})"
    )
    much = [f"{count / table.rows:.0%} of {name}" for name, count in counts.items() if count > MUCH * table.rows]
    flag = f"values are missing and bridged from the rows beside, {shorten(much, 6)}: intervals do not hold this"
    bridged = DerivedTable(table, {name: partial(_filled, *parts[name]) for name in counts})
    flags = (*recording.flags, flag) if much else recording.flags
    return replace(recording, table=bridged, notes=(*recording.notes, note), flags=flags)


def without_torque(recording: Recording, joints: Sequence[str]) -> Recording:
    """The recording without the torques or currents of some joints."""
    lost = [joint in joints for joint in recording.joints]
    tau = tuple("" if out else column for out, column in zip(lost, recording.columns["tau"], strict=True))
    known = None if recording.scaled is None or (recording.scaled | lost).all() else recording.scaled | lost
    return replace(recording, columns={**recording.columns, "tau": tau}, signed=recording.signed | lost, scaled=known)


def without_dead_torques(recording: Recording) -> Recording:
    """The recording without torques that are zero throughout of joints that stand still, as of grippers; a note."""
    table, dead = recording.table, list[str]()
    for joint, *names in zip(recording.joints, recording.columns["q"], recording.columns["tau"], strict=True):
        starts = range(0, table.rows if names[1] else 0, CHUNK)
        pieces = (table.read(names, start, start + CHUNK) - [*table.read(names[:1], 0, 1)[0], 0] for start in starts)
        dead += [joint] if names[1] and not any(np.nan_to_num(piece).any() for piece in pieces) else []
    if not dead or not any(without_torque(recording, dead).columns["tau"]):
        return recording
    note = f"torque that is zero throughout is left out: {shorten(dead)} stands still"
    return replace(without_torque(recording, dead), notes=(*recording.notes, note))


def with_positions(assigned: Assignment, robot: Robot) -> Assignment:
    """An assignment with positions of joints that have velocities alone, where no torque depends on the position.

    They are the integral of the velocities, from 0.
    """
    bare = [j for kind, j in assigned.signals if kind == "dq" and ("q", j) not in assigned.signals]
    free = [j for j in bare if ("t", 0) in assigned.signals and not _depends(robot, j)]
    if not free:
        return assigned
    names = (assigned.column("t", 0), *(assigned.column("dq", j) for j in free))
    t, *speeds = assigned.table.read(names, 0, assigned.table.rows).T
    added, signals = dict[str, Array](), dict(assigned.signals)
    for j, v in zip(free, speeds, strict=True):
        known = np.isfinite(t) & np.isfinite(v)
        steps = np.diff(t[known]) * (v[known][1:] + v[known][:-1]) / 2
        name = f"{INTEGRAL}{assigned.column('dq', j)}"
        added[name] = np.full(len(t), np.nan)
        added[name][known] = np.concatenate([[0.0], np.cumsum(steps)])[: int(known.sum())]
        signals["q", j] = Signal(f"q_{robot.joints[j]}", name, True)
    joints = shorten([robot.joints[j] for j in free])
    note = f"positions of {joints} are integrated from velocities, from 0: no weight depends on them"
    return replace(
        assigned, signals=signals, notes=(*assigned.notes, note), table=DerivedTable(assigned.table, {}, added)
    )


def _depends(robot: Robot, joint: int) -> bool:
    """Whether a torque depends on the position of a joint, by the description's bodies in random states."""
    states = np.random.default_rng(0).uniform(-1, 1, (3, STATES, len(robot.joints)))
    moved = states[0] + np.eye(len(robot.joints))[joint]
    v, a = (x @ robot.drive.T for x in states[1:])
    here, there = (rigid_torque(robot, configuration(robot, q), v, a) for q in (states[0], moved))
    return bool(np.abs(here - there).max() > TORQUE_CHANGE * max(float(np.abs(here).max()), 1e-300))


def _bridged(t: Array, x: Array, limits: tuple[float, float, float], straight: bool) -> tuple[Indices, Array]:
    """Indices (k,) of short holes of a column x (N,) at t (N,) [s], and their values (k,) [unit of x].

    Limits: the period [s], the longest time between known values [s] and the largest difference [unit of x] of them.
    """
    (period, longest, most), measured = limits, np.isfinite(t)
    known, lost = np.flatnonzero(np.isfinite(x) & measured), np.flatnonzero(np.isnan(x) & measured)
    if len(known) < 2:
        return lost[:0], x[:0]
    after = np.searchsorted(known, lost)
    four = known[np.clip(after[:, None] + np.arange(-2, 2), 0, len(known) - 1)]
    steps, rises = np.diff(t[four], axis=1), np.abs(np.diff(x[four], axis=1))
    short = (after > 0) & (after < len(known)) & (steps[:, 1] > 0) & (steps[:, 1] <= longest) & (rises[:, 1] < most)
    lost, four, steps, rises = lost[short], four[short], steps[short], rises[short]
    share = (t[lost] - t[four[:, 1]]) / steps[:, 1]
    line = (1 - share) * x[four[:, 1]] + share * x[four[:, 2]]
    smooth = ((steps > MIN_SLOPE_PERIODS * period) & (steps <= longest) & (rises < most)).all(axis=1) & (not straight)
    at, cubic = four[smooth], np.zeros(int(smooth.sum()))
    for i in range(4):
        rest = t[np.delete(at, i, axis=1)]
        cubic += ((t[lost[smooth], None] - rest) / (t[at[:, i], None] - rest)).prod(axis=1) * x[at[:, i]]
    line[smooth] = cubic
    return lost, line


def _filled(rows: Indices, filled: Array, values: Array, start: int) -> Array:
    low, high = np.searchsorted(rows, [start, start + len(values)])
    values = values.copy()
    values[rows[low:high] - start] = filled[low:high]
    return values


def disorder(q: Array) -> float:
    """Mean square step of positions over twice their variance [1], of the smoothest joint that moves.

    q: (N, n) [rad or m].
    """
    spread = np.var(q, axis=0) if len(q) >= MIN_EXAMINED_ROWS else np.zeros(1)
    moves = spread > 1e-6 * max(float(spread.max(initial=0.0)), 1e-300)
    return (
        float((np.mean(np.diff(q[:, moves], axis=0) ** 2, axis=0) / (2 * spread[moves])).min()) if moves.any() else 0.0
    )


def are_postures(table: Table, positions: tuple[str, ...], time: str) -> bool:
    """Whether positions jump from row to row, and rows of a column `time` [s], if any, are at least 0.2 s apart.

    A smooth sweep counts from 1 s on, if its steps would be too fast for stamps that are milliseconds.
    """
    values = table.read([*([time] if time else []), *positions], 0, MAX_EXAMINED_ROWS)
    values = values[np.isfinite(values).all(axis=1)]
    if len(values) < MIN_EXAMINED_ROWS:
        return False
    q, period = values[:, -len(positions) :], float(np.median(np.diff(values[:, 0]))) if time else np.inf
    step = float(np.median(np.abs(np.diff(q, axis=0)).max(axis=1)))
    jumps = disorder(q) > DISORDER or (np.isfinite(period) and period >= SWEEP and step > SLOWEST_SWEEP * period)
    return period >= MIN_POSTURE_PERIOD and np.ptp(q, axis=0).max() >= STANDSTILL and jumps


def at_rest(recording: Recording) -> Recording:
    """The recording with a posture a row: rows count the time, and velocities are zero, or of the size of an approach.

    The sign of a recorded velocity is the direction from which the joint came to the posture. Rows without a position
    or torque are left out.

    Raises:
        RecordingError: no row is complete.
    """
    wanted = {kind: recording.columns[kind] for kind in ("q", "tau", "dq")}
    names = tuple(dict.fromkeys(c for group in wanted.values() for c in group if c))
    values = recording.table.read(names, 0, recording.table.rows)
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        raise RecordingError(f"{recording.path or 'the recording'} has no row with all positions and torques")
    columns = {name: np.ascontiguousarray(x) for name, x in zip(names, values.T, strict=True)}
    known = all(wanted["dq"]) and all(columns[name].any() for name in wanted["dq"])
    rates = tuple(f"approach of {c}" for c in wanted["dq"]) if known else ("at rest",) * len(wanted["q"])
    columns |= {f"approach of {c}": np.sign(columns[c]) * APPROACH for c in wanted["dq"] if known}
    columns |= {"row": np.arange(len(values), dtype=float), "at rest": np.zeros(len(values))}
    kept = {"t": ("row",), "q": wanted["q"], "tau": wanted["tau"], "dq": rates, "ddq": ("at rest",) * len(rates)}
    absent = {kind: ("",) * len(rates) for kind in recording.columns if kind not in kept}
    how = "their velocities give the direction of approach" if known else "the direction of approach is not known"
    lost = recording.table.rows - len(values)
    note = f"each row is read as a posture at rest, without velocity and acceleration; {how}"
    note += f"; {lost} incomplete rows are left out" if lost else ""
    table = MemoryTable(columns, {}, recording.path or "the recording")
    return replace(recording, table=table, columns={**kept, **absent}, notes=(*recording.notes, note), static=True)
