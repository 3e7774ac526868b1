"""Closed loop of drives and a robot that is linear about a motion: all windows and all copies, in compiled code.

Positions by leapfrog, damping by the trapezium rule (it adds no armature), dry friction by the step of `friction`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...servos import DRIVE_LAWS, SERVO_NUMBERS, Servo
from ...types import Array
from .friction import kick

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


def numbers(servo: Servo) -> Array:
    """Numbers of a drive in the order of SERVO_NUMBERS."""
    return np.array([getattr(servo, name) for name in SERVO_NUMBERS], float)


@njit(cache=True, error_model="numpy")
def pull(p, law, q, v, u, reference, forward, volt, gain):  # type: ignore[no-untyped-def]
    """Constant torque, damping, torque and kind of limit of a drive that is on, at a command u.

    Numbers p (P,); reference: speed of the command; forward: feed-forward.
    """
    limit, dead, damping, kind = p[EFFORT], p[DEAD], p[KD], 0.0
    error = max(u - q - dead, 0.0) + min(u - q + dead, 0.0)
    constant = gain * p[KP] * error
    if law == DUTY:
        kind = 1.0 if abs(constant) > limit else 0.0
        constant = volt * min(max(constant, -limit), limit) + damping * reference
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


@njit(cache=True, error_model="numpy")
def actuate(numbers, c, laws, q, v, commands, variant, step, on, voltage, r, gain, out):  # type: ignore[no-untyped-def]
    """Drives of n joints at speeds v (n,): out (4, n) = constant torque, damping, friction bound, kind of limit.

    The torque is constant - damping v. A kind of limit is 0 or, with the sign of the torque: 1 a fixed torque, 2 a
    torque that falls with speed, 3 none beyond the largest speed. numbers (C, n, P) and variant (C, n) of copy c;
    commands (7, V, S) at substep `step`; on and voltage (R, n) at row r; gain (n,). Where a command changes within a
    substep, a drive that is not linear in it counts with both commands, by their shares of the substep.
    """
    for i in range(len(q)):
        constant, damping, torque, kind = 0.0, 0.0, 0.0, 0.0
        if on[r, i] > 0.5:
            p, j, volt = numbers[c, i], variant[c, i], voltage[r, i]
            a, b, f, share = commands[0, j, step], commands[1, j, step], commands[2, j, step], commands[6, j, step]
            da, db, df = commands[3, j, step], commands[4, j, step], commands[5, j, step]
            bent = p[EFFORT] < np.inf or p[DEAD] > 0.0 or p[DROOP] > 0.0 or p[LOAD] > 0.0
            if bent and share > 0.0 and (da != 0.0 or db != 0.0 or df != 0.0):
                rest = 1.0 - share
                constant, damping, torque, kind = pull(
                    p, laws[i], q[i], v[i], a - share * da, b - share * db, f - share * df, volt, gain[i]
                )
                c0, d0, t0, k0 = pull(
                    p, laws[i], q[i], v[i], a + rest * da, b + rest * db, f + rest * df, volt, gain[i]
                )
                constant, damping = share * c0 + rest * constant, share * d0 + rest * damping
                torque, kind = share * abs(t0) + rest * abs(torque), 8.0 * k0 + kind
            else:
                constant, damping, torque, kind = pull(p, laws[i], q[i], v[i], a, b, f, volt, gain[i])
        out[0, i] = constant - numbers[c, i, OFFSET]
        out[1, i] = damping + numbers[c, i, VISCOUS]
        out[2, i] = numbers[c, i, COULOMB] + numbers[c, i, LOAD] * abs(torque)
        out[3, i] = kind


@njit(cache=True, error_model="numpy")
def limited(v, before, numbers, c, laws, half, commands, variant, step, on, voltage, r, gain, act, again):  # type: ignore[no-untyped-def]  # fmt: skip # noqa: E501
    """Whether limits of torque were wrong in a substep that led from speeds `before` to v; if so, mend them in `act`.

    A drive is at its limit if its torque in the middle of the substep would be beyond: positions are then continuous
    in every number. `act` (4, n) as `actuate` left it; again (5, n): scratch.
    """
    n = len(v)
    for i in range(n):
        again[4, i] = 0.5 * (v[i] + before[i])
    actuate(numbers, c, laws, half, again[4], commands, variant, step, on, voltage, r, gain, again)
    wrong = False
    for i in range(n):
        if again[3, i] != act[3, i]:
            wrong = True
            act[0, i], act[1, i], act[3, i] = again[0, i], again[1, i], again[3, i]
    if wrong:
        for i in range(n):
            v[i] = before[i]
    return wrong


@njit(cache=True, error_model="numpy")
def steady(bias, by_q, by_v, qs, vs, parts):  # type: ignore[no-untyped-def]
    """Torque of the bodies (R parts, n) in the middle of each substep, without its parts along position and speed."""
    rows, n = bias.shape
    out = np.empty((rows * parts, n))
    for r in range(rows - 1):
        for part in range(parts):
            far = (part + 0.5) / parts
            near = 1.0 - far
            for i in range(n):
                load = near * bias[r, i] + far * bias[r + 1, i]
                for j in range(n):
                    load -= by_q[r, i, j] * (near * qs[r, j] + far * qs[r + 1, j])
                    load -= by_v[r, i, j] * (near * vs[r, j] + far * vs[r + 1, j])
                out[r * parts + part, i] = load
    return out


@njit(cache=True, error_model="numpy")
def carry(loads, half, v, rest, step, by_q, by_v, wave, waves, r):  # type: ignore[no-untyped-def]
    """Torque of the bodies (n,) at positions `half`, in a substep of row r; rest (R parts, n) as `steady` gives it."""
    for i in range(len(v)):
        load = rest[step, i]
        if waves:
            load += wave[i, 0] * np.sin(half[i]) + wave[i, 1] * np.cos(half[i])
        for j in range(len(v)):
            load += by_q[r, i, j] * half[j] + by_v[r, i, j] * v[j]
        loads[i] = load


@njit(cache=True, error_model="numpy")
def simulate(  # type: ignore[no-untyped-def]
    starts, rows, parts, h, mass, bias, by_q, by_v, qs, vs, wave, commands, variant, on, voltage, gain, numbers, laws,
    q0, v0, out, saturated,
):  # fmt: skip
    """Positions out (C, W, rows + 1, n) of C copies over W windows; saturated (C, W, n) counts saturated substeps.

    starts (W,) first rows; parts substeps of a row, of h [s]; along R rows: mass (R, n, n) in the middle of a row,
    bias, qs, vs (R, n), by_q, by_v (R, n, n), wave (n, 2) torque of sin q and cos q; commands (7, V, R parts) of each
    variant as `commands_at` gives them; variant (C, n); on, voltage (R, n); gain (n,);
    numbers (C, n, P); laws (n,); q0, v0 (C, W, n).
    """
    copies, windows, n = q0.shape
    q, v, half, force, act = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty((4, n))
    b, room, waves = np.empty(n), np.empty((n, n + 2)), np.any(wave != 0.0)
    loads, before, again, known = np.empty(n), np.empty(n), np.empty((5, n)), np.empty(2 * n + 1)
    rest = steady(bias, by_q, by_v, qs, vs, parts)
    for c in range(copies):
        limits, known[0] = False, -1.0
        for i in range(n):
            limits = limits or (laws[i] != DUTY and numbers[c, i, EFFORT] < np.inf)
        for w in range(windows):
            for i in range(n):
                q[i], v[i] = q0[c, w, i], v0[c, w, i]
                out[c, w, 0, i] = q[i]
                saturated[c, w, i] = 0
            for row in range(rows):
                r = starts[w] + row
                for step in range(r * parts, (r + 1) * parts):
                    for i in range(n):
                        half[i], before[i] = q[i] + 0.5 * h * v[i], v[i]
                    actuate(numbers, c, laws, half, v, commands, variant, step, on, voltage, r, gain, act)
                    carry(loads, half, v, rest, step, by_q, by_v, wave, waves, r)
                    for _ in range(PASSES):
                        for i in range(n):
                            force[i] = act[0, i] - loads[i]
                        kick(v, mass, r, force, numbers, c, act, h, b, room, known)
                        if not limits or not limited(
                            v, before, numbers, c, laws, half, commands, variant, step, on, voltage, r, gain, act,
                            again,
                        ):  # fmt: skip
                            break
                    for i in range(n):
                        saturated[c, w, i] += 1.0 if act[3, i] != 0.0 else 0.0
                    for i in range(n):
                        q[i] = half[i] + 0.5 * h * v[i]
                out[c, w, row + 1] = q
