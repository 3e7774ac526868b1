"""Closed loop of drives and a robot that is linear about a motion: all windows and all copies, in compiled code.

Positions by leapfrog, damping by the trapezium rule (it adds no armature), dry friction by the step of `friction`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...servos import DRIVE_LAWS, LOOP_NUMBERS
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
    STRIBECK,
    STRIBECK_VELOCITY,
    AMPLITUDE,
    PHASE,
    FREQUENCY,
    STIFFNESS,
    REST,
    GAP,
) = range(len(LOOP_NUMBERS))  # columns of the numbers of a drive and its joint, in the order of LOOP_NUMBERS
DUTY, TORQUE_SPEED = DRIVE_LAWS.index("duty"), DRIVE_LAWS.index("torque_speed")
HALF, SIDE, DEFLECTION, LINK_SPEED, LOAD_OF_LINK = range(5)  # rows of `State.play`
BEGIN = 2.0  # side of a gap at which a window begins: where the motor pushes
SHORT = 5e-4  # [s] longest substep with backlash: 2 ms shift the meeting of a link by mrad
ROTOR = 1e-3  # [1] least inertia of a motor with backlash over that of its link
EDGE = 1e-3  # [1] share of a substep at its ends, in which a turn is not looked for
PASSES = 5  # of a substep, until it is consistent which drives are at their limits


class Drives(NamedTuple):
    """C copies of the drives of n joints on the substeps of R rows, `parts` of each row."""

    numbers: Array  # (C, n, 21) [LOOP_UNITS]
    laws: Indices  # (C, n) index in DRIVE_LAWS
    variant: Indices  # (C, n) which of the V commands acts
    commands: Array  # (7, V, S) [any] on S = R parts substeps, as `commands_at` gives them
    on: Array  # (R, n) [1]
    voltage: Array  # (R, n) relative to the nominal supply [1]
    gain: Array  # (R, n) relative to the nominal one [1]
    parts: int
    step: float  # [s] of a substep


class LoopBodies(NamedTuple):
    """Torque of the bodies of n joints, linear about a motion of R rows: those of the drives, or a multiple of them.

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

    Numbers p (21,); at: position and speed; command: command, its speed and feed-forward; supply: voltage and gain.
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
        dry = p[COULOMB] + p[LOAD] * abs(torque)
        if p[STRIBECK] != 0.0:
            dry += p[STRIBECK] * np.exp(-((v[i] / p[STRIBECK_VELOCITY]) ** 2))
        if p[AMPLITUDE] != 0.0:
            dry += p[AMPLITUDE] * np.sin(p[FREQUENCY] * q[i] + p[PHASE])
        out[0, i] = constant - p[OFFSET] - p[STIFFNESS] * (q[i] - p[REST])
        out[1, i] = damping + p[VISCOUS]
        out[2, i] = max(dry, 0.0)
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
def advance(drives, c, step, mass, state, h):  # type: ignore[no-untyped-def]
    """Advance the speeds of a state by h [s] in a substep, at `state.half` under `state.loads`; mass (n, n)."""
    limits = False
    for i in range(len(state.v)):
        state.before[i] = state.v[i]
        limits = limits or (drives.laws[c, i] != DUTY and drives.numbers[c, i, EFFORT] < np.inf)
    actuate(drives, c, step, state.half, state.v, state.act)
    for _ in range(PASSES):
        advance_speeds(state, mass, h)
        if not limits or not change_limits(drives, c, step, state):
            break


@LOOP
def advance_links(drives, c, step, mass, state, h):  # type: ignore[no-untyped-def]
    """Advance by h [s] where joints have backlash: play (5, n) half the gap, side, deflection, link speed and load.

    A link at a side of its gap moves with its motor as long as the motor pushes it; then it flies, and the motor turns
    alone, until the link meets a side of the gap, without rebound. A side of 0 is flight, 2 the beginning.
    """
    play, act, n = state.play, state.act, len(state.v)
    if play[SIDE, 0] == BEGIN:
        actuate(drives, c, step, state.half, state.v, act)
    for i in range(n):
        if play[HALF, i] > 0.0 and play[SIDE, i] == BEGIN:
            push = act[0, i] - act[1, i] * state.v[i] - act[2, i] * np.sign(state.v[i])
            play[SIDE, i] = -1.0 if push >= 0.0 else 1.0
            play[DEFLECTION, i] = play[SIDE, i] * play[HALF, i]
        elif play[SIDE, i] == BEGIN:
            play[SIDE, i] = 0.0
        play[LOAD_OF_LINK, i] = state.loads[i]
    for i in range(n):
        for j in range(n):
            flies = (play[HALF, i] > 0.0 and play[SIDE, i] == 0.0) or (play[HALF, j] > 0.0 and play[SIDE, j] == 0.0)
            state.mass[i, j] = 0.0 if flies else mass[i, j]
        if play[HALF, i] > 0.0:
            state.armature[i] = max(drives.numbers[c, i, ARMATURE], ROTOR * mass[i, i])
            if play[SIDE, i] == 0.0:
                state.loads[i] = 0.0
    state.of[0] = 0.0
    advance(drives, c, step, state.mass, state, h)
    for i in range(n):
        if play[HALF, i] == 0.0:
            continue
        if play[SIDE, i] != 0.0:
            push = play[LOAD_OF_LINK, i]
            for j in range(n):
                push += state.mass[i, j] * (state.v[j] - state.before[j]) / h
            if push * play[SIDE, i] > 0.0:  # the motor would have to pull
                play[SIDE, i], play[LINK_SPEED, i] = 0.0, state.v[i]
            continue
        play[LINK_SPEED, i] -= h * play[LOAD_OF_LINK, i] / mass[i, i]
        play[DEFLECTION, i] += h * (play[LINK_SPEED, i] - state.v[i])
        if abs(play[DEFLECTION, i]) >= play[HALF, i]:
            side, rotor = np.sign(play[DEFLECTION, i]), state.armature[i]
            play[SIDE, i], play[DEFLECTION, i] = side, side * play[HALF, i]
            state.v[i] = (rotor * state.v[i] + mass[i, i] * play[LINK_SPEED, i]) / (rotor + mass[i, i])


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


@LOOP
def load_links(bodies, r, rest, waves, state):  # type: ignore[no-untyped-def]
    """Torque of the bodies in row r at the links' positions; rest (n,) of it does not depend on position and speed."""
    link, v, before, n = state.link, state.v, state.before, len(state.v)
    by_q, by_v = bodies.by_q[r], bodies.by_v[r]
    for i in range(n):
        load = rest[i]
        if waves:
            load += bodies.wave[i, 0] * np.sin(link[i]) + bodies.wave[i, 1] * np.cos(link[i])
        for j in range(n):
            load += by_q[i, j] * link[j] + by_v[i, j] * (1.5 * v[j] - 0.5 * before[j])  # the middle of the substep
        state.loads[i] = load


@LOOP
def first_turn(state, mass, h):  # type: ignore[no-untyped-def]
    """Share of a substep of h after which the first joint stops or turns, and that joint; -1 if none does.

    Dry friction changes its sign there: a substep across it would shift each reversal by a part of the substep.
    """
    v, before, n = state.v, state.before, len(state.v)
    share, first = 1.0 - EDGE, -1
    for i in range(n):
        if before[i] * v[i] < 0.0 or (v[i] == 0.0 and before[i] != 0.0):
            rest = state.right[i]
            for j in range(n):
                if j != i:
                    rest -= mass[i, j] * v[j]
            friction = h * state.act[2, i] * np.sign(before[i])
            on = (rest - friction) / (mass[i, i] + state.inertia[i])  # speed if friction kept its sign
            at = before[i] / (before[i] - on)
            if EDGE < at < share:
                share, first = at, i
    return share, first


@LOOP
def substep(bodies, drives, place, loads, state, how):  # type: ignore[no-untyped-def]
    """Advance positions and speeds by a substep, in two parts where a joint stops or turns within it.

    place: copy, substep and row of the bodies; loads: mass matrix (n, n), and torque (n,) without its parts along
    position and speed; how: length [s], whether joints have backlash, whether `bodies` has waves.
    """
    (c, step, row), (mass, rest), (h, loose, waves) = place, loads, how
    q, v, half, n = state.q, state.v, state.half, len(state.v)
    left, part, turns = h, h, -1
    while left > 0.0:
        for i in range(n):
            half[i] = q[i] + 0.5 * part * v[i]
            state.link[i] = half[i] + state.play[DEFLECTION, i]
        load_links(bodies, row, rest, waves, state)
        if loose:
            advance_links(drives, c, step, mass, state, part)
        else:
            advance(drives, c, step, mass, state, part)
        if not loose and turns < 0:
            share, turns = first_turn(state, mass, h)
            if turns >= 0:  # once again, up to where that joint turns
                part = share * h
                for i in range(n):
                    v[i] = state.before[i]
                continue
        for i in range(n):
            q[i] = half[i] + 0.5 * part * v[i]
        left -= part
        if left > 0.0:
            v[turns], part = 0.0, left


@njit(cache=True, error_model="numpy")
def simulate(bodies, drives, starts):  # type: ignore[no-untyped-def]
    """Positions (C, W, longest + 1, n), zero after the rows of a window, and saturated substeps (C, W, n).

    Arguments: `LoopBodies`, `Drives` and `Starts`.
    """
    copies, windows, n = starts.q.shape
    out = np.zeros((copies, windows, starts.longest + 1, n))
    saturated = np.zeros((copies, windows, n))
    state, parts = new_state(n), drives.parts
    q, v, act = state.q, state.v, state.act
    finer = len(bodies.q) // len(drives.on)  # rows of the bodies in a row of the drives
    rest, waves = constant_torque(bodies, parts // finer), np.any(bodies.wave != 0.0)
    sides, misfit, last = np.empty(n), np.zeros((3, n)), len(bodies.q) - 1
    for c in range(copies):
        loose = False
        for i in range(n):
            state.armature[i] = drives.numbers[c, i, ARMATURE]
            loose = loose or drives.numbers[c, i, GAP] > 0.0
        pieces = int(np.ceil(drives.step / SHORT - 1e-9)) if loose else 1
        h, held = drives.step / pieces, parts * pieces // finer  # substeps of a row of the bodies
        for w in range(windows):
            follows = w > 0 and starts.first[w] == starts.first[w - 1] + starts.rows[w - 1]
            tries = 3 if loose and not follows else 1  # both sides of each gap, and the better ones
            for attempt in range(tries):
                if not follows:  # else links are where the window before left them
                    for i in range(n):
                        gap, side = 0.5 * drives.numbers[c, i, GAP], sides[i] if attempt == 2 else 2.0 * attempt - 1.0
                        state.play[HALF, i], state.play[SIDE, i], state.play[DEFLECTION, i] = gap, side, side * gap
                for i in range(n):
                    q[i], v[i] = starts.q[c, w, i], starts.v[c, w, i]
                    state.before[i] = v[i]
                    out[c, w, 0, i] = q[i]
                    saturated[c, w, i] = 0.0
                    misfit[attempt, i] = 0.0
                for row in range(starts.rows[w]):
                    r = starts.first[w] + row
                    for k in range(r * parts * pieces, (r + 1) * parts * pieces):
                        step, place = k // pieces, k // held
                        if k % held == 0:
                            mass = bodies.mass[place]
                            state.of[0] = 0.0
                        substep(bodies, drives, (c, step, place), (mass, rest[step]), state, (h, loose, waves))
                        for i in range(n):
                            saturated[c, w, i] += 1.0 / pieces if act[3, i] != 0.0 or act[4, i] != 0.0 else 0.0
                    for i in range(n):
                        out[c, w, row + 1, i] = q[i]
                        misfit[attempt, i] += (q[i] - bodies.q[min((r + 1) * finer, last), i]) ** 2
                for i in range(n):
                    sides[i] = -1.0 if misfit[0, i] <= misfit[1, i] else 1.0
    return out, saturated
