"""Torque and dry friction of drives in a substep, in compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...servos import DRIVE_LAWS, LOOP_NUMBERS
from ...types import Array, Indices

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
    ZERO,
    GEAR_EXPONENT,
    GEAR_VELOCITY,
    GEAR_LEVEL,
    GEAR_LOAD,
    GEAR_EXTERNAL,
    GEAR_LOAD_AT_REST,
    GEAR_EXTERNAL_AT_REST,
    GEAR_QUADRATIC_MOTOR,
    GEAR_QUADRATIC_EXTERNAL,
    LINK_ENCODER,
) = range(len(LOOP_NUMBERS))  # columns of the numbers of a drive and its joint, in the order of LOOP_NUMBERS
DUTY, TORQUE_SPEED = DRIVE_LAWS.index("duty"), DRIVE_LAWS.index("torque_speed")
# Inlined, and without counts of references: a call would copy the seventeen arrays of a state; five times as fast
FAST = {"contract", "reassoc", "arcp", "nsz"}  # what may change rounding alone; values that are not finite stay so
LOOP = njit(  # type: ignore[call-overload]
    cache=True, error_model="numpy", fastmath=FAST, forceinline=True, _nrt=False
)
SWEEPS, SPEED_TOLERANCE = 60, 1e-11  # of Gauss-Seidel; largest relative change of a speed that ends it
ROUNDS = 8  # of joints that stop or start, before that


class Drives(NamedTuple):
    """C copies of the drives of n joints on the substeps of R rows, `parts` of each row."""

    numbers: Array  # (C, n, 32) [LOOP_UNITS]
    laws: Indices  # (C, n) index in DRIVE_LAWS
    variant: Indices  # (C, n) which of the V commands acts
    commands: Array  # (7, V, S) [any] on S = R parts substeps, as `commands_at` gives them
    on: Array  # (R, n) [1]
    voltage: Array  # (R, n) relative to the nominal supply [1]
    gain: Array  # (R, n) relative to the nominal one [1]
    parts: int
    step: float  # [s] of a substep


@LOOP
def drive_torque(p, law, at, command, supply):  # type: ignore[no-untyped-def]
    """Constant torque, damping, torque and kind of limit of a drive that is on.

    Numbers p (32,); at: position and speed; command: command, its speed and feed-forward; supply: voltage and gain.
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
def gear_bound(p, torque, load, v):  # type: ignore[no-untyped-def]
    """Bound of the friction of a gear under the torque of its motor and the load of the bodies, at speed v.

    Source: Duclusaud et al., arXiv 2410.08650, model M6; their external torque is minus the load.
    """
    rest = p[GEAR_LEVEL] + p[GEAR_LOAD_AT_REST] * abs(torque + p[GEAR_EXTERNAL_AT_REST] * load)
    if torque * load > 0.0:
        if abs(torque) > abs(load):
            rest += p[GEAR_QUADRATIC_EXTERNAL] * load**2
        else:
            rest += p[GEAR_QUADRATIC_MOTOR] * torque**2
    decay = np.exp(-(abs(v / p[GEAR_VELOCITY]) ** p[GEAR_EXPONENT])) if rest != 0.0 else 0.0
    return p[GEAR_LOAD] * abs(torque + p[GEAR_EXTERNAL] * load) + decay * rest


@LOOP
def actuate(drives, c, step, at, out):  # type: ignore[no-untyped-def]
    """Drives of copy c in a substep: out (5, n) constant torque, damping, friction bound, two limits.

    at: position, speed and torque of the bodies, (n,) each.

    The torque is constant - damping v. A kind of limit is 0 or, with the sign of the torque: 1 a fixed torque, 2 a
    torque that falls with speed, 3 none beyond the largest speed. Where a command changes within a substep, a drive
    that is not linear in it counts with both commands, by their shares of the substep: out[3] is the kind with the
    command after the change, out[4] with the one before, 0 without a change.
    """
    r, (q, v, loads) = step // drives.parts, at
    for i in range(len(q)):
        p = drives.numbers[c, i]
        constant, damping, torque, kind, first, gear = 0.0, 0.0, 0.0, 0.0, 0.0, p[GEAR_EXPONENT] > 0.0
        t0, earlier = 0.0, 0.0
        if drives.on[r, i] > 0.5:
            law, moves, supply = drives.laws[c, i], (q[i], v[i]), (drives.voltage[r, i], drives.gain[r, i])
            held, j = drives.commands, drives.variant[c, i]
            a, b, f, share = held[0, j, step], held[1, j, step], held[2, j, step], held[6, j, step]
            da, db, df = held[3, j, step], held[4, j, step], held[5, j, step]
            bent = p[EFFORT] < np.inf or p[DEAD] > 0.0 or p[DROOP] > 0.0 or p[LOAD] > 0.0 or gear
            if bent and share > 0.0 and (da != 0.0 or db != 0.0 or df != 0.0):
                rest = 1.0 - share
                after = (a - share * da, b - share * db, f - share * df)
                before = (a + rest * da, b + rest * db, f + rest * df)
                constant, damping, torque, kind = drive_torque(p, law, moves, after, supply)
                c0, d0, t0, first = drive_torque(p, law, moves, before, supply)
                constant, damping = share * c0 + rest * constant, share * d0 + rest * damping
                earlier = share
            else:
                constant, damping, torque, kind = drive_torque(p, law, moves, (a, b, f), supply)
        dry = p[COULOMB] + p[LOAD] * (earlier * abs(t0) + (1.0 - earlier) * abs(torque))
        if gear:
            dry += (1.0 - earlier) * gear_bound(p, torque, loads[i], v[i])
            if earlier > 0.0:
                dry += earlier * gear_bound(p, t0, loads[i], v[i])
        if p[STRIBECK] != 0.0:
            dry += p[STRIBECK] * np.exp(-((v[i] / p[STRIBECK_VELOCITY]) ** 2))
        if p[AMPLITUDE] != 0.0:
            dry += p[AMPLITUDE] * np.sin(p[FREQUENCY] * q[i] + p[PHASE])
        out[0, i] = constant - p[OFFSET] - p[STIFFNESS] * (q[i] - p[REST])
        out[1, i] = damping + p[VISCOUS]
        out[2, i] = max(dry, 0.0)
        out[3, i] = kind
        out[4, i] = first


class State(NamedTuple):
    """State of n joints in a substep, and the memory that its steps use."""

    q: Array  # (n,) [rad or m]
    v: Array  # (n,) [rad/s or m/s]
    half: Array  # (n,) [rad or m] positions in the middle of the substep
    before: Array  # (n,) [rad/s or m/s] speeds at its start
    middle: Array  # (n,) [rad/s or m/s] speeds in its middle
    loads: Array  # (n,) [N.m or N] torque of the bodies
    armature: Array  # (n,) [kg.m2 or kg]
    act: Array  # (5, n) [any] of the drives, as `actuate` leaves it
    again: Array  # (5, n) [any] the same in the middle of the substep
    right: Array  # (n,) [N.m.s or N.s] right-hand side of the equation of the speeds
    inertia: Array  # (n,) [kg.m2 or kg] that armature and damping add to the mass
    new: Array  # (n,) [rad/s or m/s] speeds if no joint starts, stops or turns
    side: Array  # (n,) [1] sign of the speeds, 0 at rest
    factor: Array  # (n, n) [any] Cholesky factor with the inverse of its diagonal
    link: Array  # (n,) [rad or m] positions of the links in the middle of the substep
    seen: Array  # (n,) [rad or m] positions that the drives measure in the middle of the substep
    play: Array  # (6, n) [any] of joints with backlash
    of: Array  # (M,) [any] 2 n + 1 values: 1 if there is a factor, and the inertias and the moving joints that it is of


def new_state(n: int) -> State:
    """State of n joints at rest, without a factor."""
    one, five = np.zeros((13, n)), np.zeros((2, 5, n))
    fields = [*one[:7], *five, *one[7:11], np.zeros((n, n)), *one[11:], np.zeros((6, n)), np.zeros(2 * n + 1)]
    return State(*fields)


@LOOP
def advance_speeds(state, mass, h):  # type: ignore[no-untyped-def]
    """Advance the speeds by h in place: (mass + armature) dv/dt = torque - damping v - friction sign v.

    mass (n, n). The factor is kept while `state.of` allows it: set its first entry to 0 where the mass changes.
    """
    v, right, act, inertia = state.v, state.right, state.act, state.inertia
    n = len(v)
    for i in range(n):
        half = 0.5 * h * act[1, i]
        total = (state.armature[i] - half) * v[i] + h * (act[0, i] - state.loads[i])
        for j in range(n):
            total += mass[i, j] * v[j]
        right[i], inertia[i] = total, state.armature[i] + half
    if n > 1 and slide(state, mass, h):
        return
    for _ in range(SWEEPS):
        change, size = 0.0, 0.0
        for i in range(n):
            rest = right[i] + mass[i, i] * v[i]
            for j in range(n):
                rest -= mass[i, j] * v[j]
            bound = h * act[2, i]
            new = (max(rest - bound, 0.0) + min(rest + bound, 0.0)) / (mass[i, i] + inertia[i])
            change = max(change, abs(new - v[i]))
            size = max(size, abs(new))
            v[i] = new
        if n == 1 or change <= SPEED_TOLERANCE * size:
            break


@LOOP
def factorise(state, mass):  # type: ignore[no-untyped-def]
    """Cholesky factor of mass and inertia; joints at rest, whose side is 0, are left out.

    It is kept while mass, inertias and the joints that move stay the same.
    """
    side, factor, of, inertia = state.side, state.factor, state.of, state.inertia
    n, same = len(side), of[0] == 1.0
    for i in range(n):
        moves = 1.0 if side[i] != 0.0 else 0.0
        same = same and of[1 + i] == inertia[i] and of[1 + n + i] == moves
        of[1 + i], of[1 + n + i] = inertia[i], moves
    of[0] = 1.0
    if same:
        return
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            if side[i] != 0.0 and side[j] != 0.0:
                total = mass[i, j]
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
            if i == j:
                factor[i, i] = 1.0 / np.sqrt(total + inertia[i]) if side[i] != 0.0 else 1.0
            else:
                factor[i, j] = total * factor[j, j]


@LOOP
def slide(state, mass, h):  # type: ignore[no-untyped-def]
    """Solve for speeds in place, once it is known which joints rest and how the others turn: whether it is, in time.

    Joints first rest or turn as before; those for which this is wrong stop or start, and all are solved for again.
    """
    v, right, act, new, factor, side = state.v, state.right, state.act, state.new, state.factor, state.side
    n = len(v)
    for i in range(n):
        side[i] = np.sign(v[i])
    for _ in range(ROUNDS):
        factorise(state, mass)
        for i in range(n):
            total = right[i] - h * act[2, i] * side[i] if side[i] != 0.0 else 0.0
            for k in range(i):
                total -= factor[i, k] * new[k]
            new[i] = total * factor[i, i]
        for i in range(n - 1, -1, -1):
            total = new[i]
            for k in range(i + 1, n):
                total -= factor[k, i] * new[k]
            new[i] = total * factor[i, i]
        wrong = False
        for i in range(n):
            rest = right[i]
            if side[i] != 0.0:
                if new[i] * side[i] <= 0.0 and act[2, i] > 0.0:
                    side[i], wrong = 0.0, True
                continue
            for k in range(n):
                rest -= mass[i, k] * new[k]
            if abs(rest) > h * act[2, i]:
                side[i], wrong = np.sign(rest), True
        if not wrong:
            for i in range(n):
                v[i] = new[i]
            return True
    return False
