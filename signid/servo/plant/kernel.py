"""Closed loop of drives and a robot that is linear about a motion: all windows and all copies, in compiled code.

Positions by leapfrog, damping by the trapezium rule (it adds no armature), dry friction by the step of `friction`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...types import Array, Indices
from .torque import (
    ARMATURE,
    DUTY,
    EFFORT,
    FAST,
    GAP,
    LINK_ENCODER,
    LOOP,
    VISCOUS,
    ZERO,
    Drives,
    actuate,
    advance_speeds,
    new_state,
)

# rows of `State.play`: half the gap, side of the link, link minus motor and its speed, new speed of the motor, and the
# momentum that links which were met add to the joints
HALF, SIDE, DEFLECTION, RELATIVE, MOTOR, IMPULSE = range(6)
BEGIN = 2.0  # side of a gap at which a window begins: where the motor pushes
BACKLASH_STEP = 5e-4  # [s] longest substep, also with gears: 2 ms shift the meeting of a link, and stops, by mrad
ROTOR = 1e-3  # [1] least inertia of a motor with backlash over that of its link
EDGE = 1e-3  # [1] share of a substep at its ends, in which a turn is not looked for
PASSES = 5  # of a substep, until it is consistent which drives are at their limits


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
def change_limits(drives, c, step, state):  # type: ignore[no-untyped-def]
    """Whether limits of torque were wrong in a substep; if so, mend them in `state.act` and set the speeds back.

    A drive is at its limit if its torque in the middle of the substep would be beyond: positions are then continuous
    in every number.
    """
    act, again, wrong = state.act, state.again, False
    for i in range(len(state.v)):
        state.middle[i] = 0.5 * (state.v[i] + state.before[i])
    actuate(drives, c, step, (state.seen, state.middle, state.loads), again)
    release(state, again)
    for i in range(len(state.v)):
        if again[3, i] != act[3, i] or again[4, i] != act[4, i]:
            wrong = True
            act[0, i], act[1, i], act[3, i], act[4, i] = again[0, i], again[1, i], again[3, i], again[4, i]
    if wrong:
        for i in range(len(state.v)):
            state.v[i] = state.before[i]
    return wrong


@LOOP
def release(state, act):  # type: ignore[no-untyped-def]
    """Take torque, damping and friction of the motors from links in flight."""
    for i in range(len(state.v)):
        if state.play[HALF, i] > 0.0 and state.play[SIDE, i] == 0.0:
            act[0, i], act[1, i], act[2, i] = 0.0, 0.0, 0.0


@LOOP
def advance(drives, c, step, mass, state, h):  # type: ignore[no-untyped-def]
    """Advance the speeds of a state by h [s] in a substep, at `state.half` under `state.loads`; mass (n, n)."""
    limits = False
    for i in range(len(state.v)):
        state.before[i] = state.v[i]
        limits = limits or (drives.laws[c, i] != DUTY and drives.numbers[c, i, EFFORT] < np.inf)
    actuate(drives, c, step, (state.seen, state.v, state.loads), state.act)
    release(state, state.act)
    for _ in range(PASSES):
        advance_speeds(state, mass, h)
        if not limits or not change_limits(drives, c, step, state):
            break


@LOOP
def turn_motors(drives, c, step, state, h):  # type: ignore[no-untyped-def]
    """Advance motors whose links are in flight by h [s], then put the speeds of their links in their place in `v`.

    A drive that measures its link damps the speed of the link.
    """
    v, play, act, middle = state.v, state.play, state.again, state.middle
    for i in range(len(v)):
        middle[i] = v[i] + drives.numbers[c, i, LINK_ENCODER] * play[RELATIVE, i]
    actuate(drives, c, step, (state.seen, middle, state.loads), act)
    for i in range(len(v)):
        play[MOTOR, i] = v[i]
        if play[HALF, i] > 0.0 and play[SIDE, i] == 0.0:
            damping = act[1, i] - drives.numbers[c, i, VISCOUS]  # of the drive
            pull = act[0, i] - (damping * middle[i] if drives.numbers[c, i, LINK_ENCODER] == 1.0 else 0.0)
            half = 0.5 * h * (drives.numbers[c, i, VISCOUS] if drives.numbers[c, i, LINK_ENCODER] == 1.0 else act[1, i])
            right, bound = (state.armature[i] - half) * v[i] + h * pull, h * act[2, i]
            play[MOTOR, i] = (max(right - bound, 0.0) + min(right + bound, 0.0)) / (state.armature[i] + half)
            v[i] += play[RELATIVE, i]


@LOOP
def advance_links(drives, c, step, mass, state, h):  # type: ignore[no-untyped-def]
    """Advance by h [s] where joints have backlash; `state.play` holds the gaps.

    A link at a side of its gap moves with its motor as long as the motor pushes it; then it flies, and the motor turns
    alone, until the link meets a side of the gap, without rebound. A side of 0 is flight, 2 the beginning.
    """
    v, play, act, n = state.v, state.play, state.act, len(state.v)
    if play[SIDE, 0] == BEGIN:
        actuate(drives, c, step, (state.seen, v, state.loads), act)
    for i in range(n):
        if play[HALF, i] > 0.0 and play[SIDE, i] == BEGIN:
            push = act[0, i] - act[1, i] * v[i] - act[2, i] * np.sign(v[i])
            play[SIDE, i] = -1.0 if push >= 0.0 else 1.0
            play[DEFLECTION, i] = play[SIDE, i] * play[HALF, i]
            state.half[i] -= drives.numbers[c, i, LINK_ENCODER] * play[DEFLECTION, i]
        elif play[SIDE, i] == BEGIN:
            play[SIDE, i] = 0.0
        state.armature[i] = drives.numbers[c, i, ARMATURE]
        if play[HALF, i] > 0.0:
            state.armature[i] = max(state.armature[i], ROTOR * mass[i, i])
    turn_motors(drives, c, step, state, h)
    for i in range(n):
        state.loads[i] -= play[IMPULSE, i] / h
        play[IMPULSE, i] = 0.0
        if play[HALF, i] > 0.0 and play[SIDE, i] == 0.0:
            state.armature[i] = 0.0
    state.of[0] = 0.0
    advance(drives, c, step, mass, state, h)
    for i in range(n):
        if play[HALF, i] > 0.0 and play[SIDE, i] != 0.0:
            push = state.loads[i]
            for j in range(n):
                push += mass[i, j] * (v[j] - state.before[j]) / h
            play[MOTOR, i] = v[i]
            if push * play[SIDE, i] > 0.0:  # the motor would have to pull
                play[SIDE, i] = 0.0
    for i in range(n):
        if play[HALF, i] > 0.0 and play[SIDE, i] == 0.0:
            meet(drives, c, i, mass, state, h)


@LOOP
def meet(drives, c, i, mass, state, h):  # type: ignore[no-untyped-def]
    """Turn the speed of the link of joint i, after a flight of h [s], into that of its motor, and end the flight."""
    v, play = state.v, state.play
    relative = v[i] - play[MOTOR, i]
    play[DEFLECTION, i] += 0.5 * h * (relative + play[RELATIVE, i])
    state.before[i] -= play[RELATIVE, i]
    v[i], play[RELATIVE, i] = play[MOTOR, i], relative
    beyond = abs(play[DEFLECTION, i]) - play[HALF, i]
    side = np.sign(play[DEFLECTION, i])
    if beyond >= 0.0 and relative * side > 0.0:
        rotor = max(drives.numbers[c, i, ARMATURE], ROTOR * mass[i, i])
        share = mass[i, i] / (rotor + mass[i, i])
        play[SIDE, i], play[DEFLECTION, i], play[RELATIVE, i] = side, side * play[HALF, i], 0.0
        state.half[i] += side * beyond * share  # both moved on at one speed since they met
        v[i] += share * relative
        for j in range(len(v)):
            if j != i:  # the link's change of speed acts on the other joints in the next substep
                play[IMPULSE, j] += mass[j, i] * (1.0 - share) * relative


@njit(cache=True, error_model="numpy", fastmath=FAST)
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
    link, v, before, beyond, n = state.link, state.v, state.before, state.play[RELATIVE], len(state.v)
    by_q, by_v = bodies.by_q[r], bodies.by_v[r]
    for i in range(n):
        load = rest[i]
        if waves:
            load += bodies.wave[i, 0] * np.sin(link[i]) + bodies.wave[i, 1] * np.cos(link[i])
        for j in range(n):
            load += by_q[i, j] * link[j] + by_v[i, j] * (
                1.5 * v[j] - 0.5 * before[j] + beyond[j]
            )  # the middle of the substep
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
def substep(bodies, drives, place, how, state, loose):  # type: ignore[no-untyped-def]
    """Advance positions and speeds by a substep, in two parts where a joint stops or turns within it.

    place: copy, substep and row of the bodies; how: mass matrix (n, n), torque (n,) without its parts along position
    and speed, length [s], whether `bodies` has waves; loose: (C,) as in `simulate_copies`.
    """
    (c, step, row), (mass, rest, h, waves) = place, how
    q, v, half, n = state.q, state.v, state.half, len(state.v)
    left, part, turns = h, h, -1
    while left > 0.0:
        for i in range(n):
            half[i] = q[i] + 0.5 * part * v[i]
            beyond = state.play[DEFLECTION, i] + 0.5 * part * state.play[RELATIVE, i]
            state.link[i] = half[i] + beyond - drives.numbers[c, i, ZERO]
            state.seen[i] = half[i] + drives.numbers[c, i, LINK_ENCODER] * beyond
        load_links(bodies, row, rest, waves, state)
        if loose is not None and loose[c]:
            advance_links(drives, c, step, mass, state, part)
        else:
            advance(drives, c, step, mass, state, part)
            if turns < 0:
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


def simulate(bodies: LoopBodies, drives: Drives, starts: Starts) -> tuple[Array, Array]:
    """Positions (C, W, longest + 1, n), zero after the rows of a window, and saturated substeps (C, W, n)."""
    first, rows = (np.ascontiguousarray(x) for x in (starts.first, starts.rows))  # one type: compiled once
    starts, state = starts._replace(first=first, rows=rows), new_state(starts.q.shape[2])
    loose = np.any(drives.numbers[..., GAP] > 0.0, axis=1)
    found = simulate_copies(bodies, drives, starts, state, bool(bodies.wave.any()), loose if loose.any() else None)
    return found[0], found[1]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def simulate_copies(bodies, drives, starts, state, waves, loose):  # type: ignore[no-untyped-def]
    """As `simulate`; waves: whether `bodies` has some; loose: (C,) whether joints of a copy have backlash.

    Where none has, loose is None, and the code for it is not compiled, which would take half of the time.
    """
    copies, windows, n = starts.q.shape
    out = np.zeros((copies, windows, starts.longest + 1, n))
    saturated = np.zeros((copies, windows, n))
    parts = drives.parts
    q, v, act = state.q, state.v, state.act
    finer = len(bodies.q) // len(drives.on)  # rows of the bodies in a row of the drives
    rest = constant_torque(bodies, parts // finer)
    sides, beyond, misfit, last = np.empty(n), np.empty(n), np.zeros((3, n)), len(bodies.q) - 1
    for c in range(copies):
        for i in range(n):
            state.armature[i], beyond[i] = drives.numbers[c, i, ARMATURE], drives.numbers[c, i, LINK_ENCODER]
        pieces, tries = 1, 1
        if loose is not None and loose[c]:
            pieces, tries = int(np.ceil(drives.step / BACKLASH_STEP - 1e-9)), 3  # both sides of gaps, then the better
        h, held = drives.step / pieces, parts * pieces // finer  # substeps of a row of the bodies
        for w in range(windows):
            follows = w > 0 and starts.first[w] == starts.first[w - 1] + starts.rows[w - 1]
            for attempt in range(1 if follows else tries):
                if not follows:  # else links are where the window before left them
                    for i in range(n):
                        gap, side = 0.5 * drives.numbers[c, i, GAP], sides[i] if attempt == 2 else 2.0 * attempt - 1.0
                        state.play[HALF, i], state.play[SIDE, i], state.play[DEFLECTION, i] = gap, side, side * gap
                for i in range(n):
                    q[i] = starts.q[c, w, i] - beyond[i] * state.play[DEFLECTION, i]
                    flies, measured = follows and state.play[RELATIVE, i] != 0.0, starts.v[c, w, i]
                    other = v[i] + (1.0 - beyond[i]) * state.play[RELATIVE, i]  # speed of what is not measured
                    state.play[IMPULSE, i], state.play[RELATIVE, i] = 0.0, 0.0
                    v[i] = measured
                    if flies:
                        v[i] = other if beyond[i] == 1.0 else measured
                        state.play[RELATIVE, i] = measured - other if beyond[i] == 1.0 else other - measured
                    state.before[i] = v[i]
                    out[c, w, 0, i] = starts.q[c, w, i]
                    saturated[c, w, i] = 0.0
                    misfit[attempt, i] = 0.0
                for row in range(starts.rows[w]):
                    r = starts.first[w] + row
                    for k in range(r * parts * pieces, (r + 1) * parts * pieces):
                        step, place = k // pieces, k // held
                        if k % held == 0:
                            mass = bodies.mass[place]
                            state.of[0] = 0.0
                        substep(bodies, drives, (c, step, place), (mass, rest[step], h, waves), state, loose)
                        for i in range(n):
                            saturated[c, w, i] += 1.0 / pieces if act[3, i] != 0.0 or act[4, i] != 0.0 else 0.0
                    for i in range(n):
                        at = q[i] + beyond[i] * state.play[DEFLECTION, i]
                        out[c, w, row + 1, i] = at
                        misfit[attempt, i] += (at - bodies.q[min((r + 1) * finer, last), i]) ** 2
                for i in range(n):
                    sides[i] = -1.0 if misfit[0, i] <= misfit[1, i] else 1.0
    return out, saturated
