"""Closed loop of drives and a robot that is linear about a motion: all windows and all copies, in compiled code.

Positions by leapfrog, damping by the trapezium rule (it adds no armature), dry friction by the step of `friction`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...servos import DRIVE_LAWS, SERVO_NUMBERS
from ...types import Array, Indices
from .friction import LOOP, advance_speeds, new_state

(
    KP,
    KD,
    DELAY,
    EFFORT,
    SPEED,
    DEAD,
    PROFILE,
    COULOMB,
    VISCOUS,
    LOAD,
    ARMATURE,
    OFFSET,
    DROOP,
) = range(len(SERVO_NUMBERS))  # columns of the numbers of a drive, in the order of SERVO_NUMBERS
DUTY, TORQUE_SPEED = DRIVE_LAWS.index("duty"), DRIVE_LAWS.index("torque_speed")
PASSES = 5  # of a substep, until it is consistent which drives are at their limits


class Drives(NamedTuple):
    """C copies of the drives of n joints on the substeps of R rows, `parts` of each row."""

    numbers: Array  # (C, n, 13) [SERVO_UNITS]
    laws: Indices  # (C, n) index in DRIVE_LAWS
    variant: Indices  # (C, n) which of the V commands acts
    commands: Array  # (7, V, S) [any] on S = R parts substeps, as `commands_at` gives them
    on: Array  # (R, n) [1]
    voltage: Array  # (R, n) relative to the nominal supply [1]
    gain: Array  # (R, n) relative to the nominal one [1]
    parts: int
    step: float  # [s] of a substep


class LoopBodies(NamedTuple):
    """Torque of the bodies of n joints, linear about a motion of R rows.

    It is mass a + bias + by_q (q - q of the motion) + by_v (v - v of the motion) + wave (sin q, cos q).
    """

    mass: Array  # (R, n, n) [kg.m2 or kg] in the middle of each row
    bias: Array  # (R, n) [N.m or N]
    by_q: Array  # (R, n, n) [N.m/rad]
    by_v: Array  # (R, n, n) [N.m.s/rad]
    q: Array  # (R, n) [rad or m]
    v: Array  # (R, n) [rad/s or m/s]
    wave: Array  # (n, 2) [N.m]


class Starts(NamedTuple):
    """W windows of C copies, and their initial states."""

    first: Indices  # (W,) first row
    rows: Indices  # (W,) rows that are simulated
    longest: int  # of the rows
    q: Array  # (C, W, n) [rad or m]
    v: Array  # (C, W, n) [rad/s or m/s]


@LOOP
def drive_torque(p, law, at, command, supply):  # type: ignore[no-untyped-def]
    """Constant torque, damping, torque and kind of limit of a drive that is on.

    Numbers p (13,); at: position and speed; command: command, its speed and feed-forward; supply: voltage and gain.
    """
    (q, v), (u, reference, forward), (voltage, gain) = at, command, supply
    limit, dead, damping, kind = p[EFFORT], p[DEAD], p[KD], 0.0
    error = max(u - q - dead, 0.0) + min(u - q + dead, 0.0)
    constant = gain * p[KP] * error
    if law == DUTY:
        kind = 1.0 if abs(constant) > limit else 0.0
        constant = voltage * min(max(constant, -limit), limit) + damping * reference
    else:
        constant += damping * reference + forward
        torque = constant - damping * v
        bound = limit
        along = law == TORQUE_SPEED and torque * v > 0.0
        if along:
            bound = limit * max(1.0 - abs(v) / p[SPEED], 0.0)
        if abs(torque) > bound:
            side = 1.0 if torque > 0.0 else -1.0
            kind = (1.0 if not along else 2.0 if bound > 0.0 else 3.0) * side
            constant = side * limit if bound > 0.0 else 0.0
            damping = limit / p[SPEED] if along and bound > 0.0 else 0.0
    torque = constant - damping * v
    if p[DROOP] > 0.0:
        share = 1.0 / (1.0 + p[DROOP] * abs(torque))
        constant, damping, torque = share * constant, share * damping, share * torque
    return constant, damping, torque, kind


@LOOP
def actuate(drives, c, step, q, v, out):  # type: ignore[no-untyped-def]
    """Drives of copy c in a substep at q and v (n,): out (5, n) constant torque, damping, friction bound, two limits.

    The torque is constant - damping v. A kind of limit is 0 or, with the sign of the torque: 1 a fixed torque, 2 a
    torque that falls with speed, 3 none beyond the largest speed. Where a command changes within a substep, a drive
    that is not linear in it counts with both commands, by their shares of the substep: out[3] is the kind with the
    command after the change, out[4] with the one before, 0 without a change.
    """
    r = step // drives.parts
    for i in range(len(q)):
        p = drives.numbers[c, i]
        constant, damping, torque, kind, first = 0.0, 0.0, 0.0, 0.0, 0.0
        if drives.on[r, i] > 0.5:
            law, at, supply = drives.laws[c, i], (q[i], v[i]), (drives.voltage[r, i], drives.gain[r, i])
            held, j = drives.commands, drives.variant[c, i]
            a, b, f, share = held[0, j, step], held[1, j, step], held[2, j, step], held[6, j, step]
            da, db, df = held[3, j, step], held[4, j, step], held[5, j, step]
            bent = p[EFFORT] < np.inf or p[DEAD] > 0.0 or p[DROOP] > 0.0 or p[LOAD] > 0.0
            if bent and share > 0.0 and (da != 0.0 or db != 0.0 or df != 0.0):
                rest = 1.0 - share
                after = (a - share * da, b - share * db, f - share * df)
                before = (a + rest * da, b + rest * db, f + rest * df)
                constant, damping, torque, kind = drive_torque(p, law, at, after, supply)
                c0, d0, t0, first = drive_torque(p, law, at, before, supply)
                constant, damping = share * c0 + rest * constant, share * d0 + rest * damping
                torque = share * abs(t0) + rest * abs(torque)
            else:
                constant, damping, torque, kind = drive_torque(p, law, at, (a, b, f), supply)
        out[0, i] = constant - p[OFFSET]
        out[1, i] = damping + p[VISCOUS]
        out[2, i] = p[COULOMB] + p[LOAD] * abs(torque)
        out[3, i] = kind
        out[4, i] = first


@LOOP
def change_limits(drives, c, step, state):  # type: ignore[no-untyped-def]
    """Whether limits of torque were wrong in a substep; if so, mend them in `state.act` and set the speeds back.

    A drive is at its limit if its torque in the middle of the substep would be beyond: positions are then continuous
    in every number.
    """
    act, again, wrong = state.act, state.again, False
    for i in range(len(state.v)):
        state.middle[i] = 0.5 * (state.v[i] + state.before[i])
    actuate(drives, c, step, state.half, state.middle, again)
    for i in range(len(state.v)):
        if again[3, i] != act[3, i] or again[4, i] != act[4, i]:
            wrong = True
            act[0, i], act[1, i], act[3, i], act[4, i] = again[0, i], again[1, i], again[3, i], again[4, i]
    if wrong:
        for i in range(len(state.v)):
            state.v[i] = state.before[i]
    return wrong


@LOOP
def advance(drives, c, step, mass, state):  # type: ignore[no-untyped-def]
    """Advance the speeds of a state by a substep, at `state.half` under `state.loads`; mass (n, n)."""
    limits = False
    for i in range(len(state.v)):
        state.before[i] = state.v[i]
        limits = limits or (drives.laws[c, i] != DUTY and drives.numbers[c, i, EFFORT] < np.inf)
    actuate(drives, c, step, state.half, state.v, state.act)
    for _ in range(PASSES):
        advance_speeds(state, mass, drives.step)
        if not limits or not change_limits(drives, c, step, state):
            break


@njit(cache=True, error_model="numpy")
def constant_torque(bodies, parts):  # type: ignore[no-untyped-def]
    """Torque of the bodies (R parts, n) in the middle of each substep, without its parts along position and speed."""
    rows, n = bodies.bias.shape
    out = np.empty((rows * parts, n))
    for r in range(rows - 1):
        for part in range(parts):
            far = (part + 0.5) / parts
            near = 1.0 - far
            for i in range(n):
                load = near * bodies.bias[r, i] + far * bodies.bias[r + 1, i]
                for j in range(n):
                    load -= bodies.by_q[r, i, j] * (near * bodies.q[r, j] + far * bodies.q[r + 1, j])
                    load -= bodies.by_v[r, i, j] * (near * bodies.v[r, j] + far * bodies.v[r + 1, j])
                out[r * parts + part, i] = load
    return out


@njit(cache=True, error_model="numpy")
def simulate(bodies, drives, starts):  # type: ignore[no-untyped-def]
    """Positions (C, W, longest + 1, n), zero after the rows of a window, and saturated substeps (C, W, n).

    Arguments: `LoopBodies`, `Drives` and `Starts`.
    """
    copies, windows, n = starts.q.shape
    out = np.zeros((copies, windows, starts.longest + 1, n))
    saturated = np.zeros((copies, windows, n))
    state, parts, h = new_state(n), drives.parts, drives.step
    q, v, half, act = state.q, state.v, state.half, state.act
    rest, waves = constant_torque(bodies, parts), np.any(bodies.wave != 0.0)
    for c in range(copies):
        for i in range(n):
            state.armature[i] = drives.numbers[c, i, ARMATURE]
        for w in range(windows):
            for i in range(n):
                q[i], v[i] = starts.q[c, w, i], starts.v[c, w, i]
                out[c, w, 0, i] = q[i]
            for row in range(starts.rows[w]):
                r = starts.first[w] + row
                mass, by_q, by_v = bodies.mass[r], bodies.by_q[r], bodies.by_v[r]
                state.of[0] = 0.0
                for step in range(r * parts, (r + 1) * parts):
                    for i in range(n):
                        half[i] = q[i] + 0.5 * h * v[i]
                    for i in range(n):
                        load = rest[step, i]
                        if waves:
                            load += bodies.wave[i, 0] * np.sin(half[i]) + bodies.wave[i, 1] * np.cos(half[i])
                        for j in range(n):
                            load += by_q[i, j] * half[j] + by_v[i, j] * v[j]
                        state.loads[i] = load
                    advance(drives, c, step, mass, state)
                    for i in range(n):
                        saturated[c, w, i] += 1.0 if act[3, i] != 0.0 or act[4, i] != 0.0 else 0.0
                        q[i] = half[i] + 0.5 * h * v[i]
                for i in range(n):
                    out[c, w, row + 1, i] = q[i]
    return out, saturated
