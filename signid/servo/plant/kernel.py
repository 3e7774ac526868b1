"""Closed loop of drives and a robot that is linear about a motion: all windows and all copies, in compiled code.

Positions by leapfrog, damping by the trapezium rule (it adds no armature), dry friction by the exact proximal step:
the speed after a substep minimises kinetic energy and friction together, by Gauss-Seidel over coupled joints.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...servos import DRIVE_LAWS, SERVO_NUMBERS, Servo
from ...types import Array

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
SWEEPS, SETTLED = 60, 1e-11  # of Gauss-Seidel; largest relative change of a speed that ends it


def numbers(servo: Servo) -> Array:
    """Numbers of a drive in the order of SERVO_NUMBERS."""
    return np.array([getattr(servo, name) for name in SERVO_NUMBERS], float)


@njit(cache=True)
def drive_torque(p, law, error, v, v_ref, forward, voltage, gain):  # type: ignore[no-untyped-def]
    """Torque of a drive that is on: (constant, damping, torque, saturated); torque = constant - damping v."""
    if error > p[DEAD]:
        error -= p[DEAD]
    elif error < -p[DEAD]:
        error += p[DEAD]
    else:
        error = 0.0
    limit, damping, saturated = p[EFFORT], p[KD], False
    constant = gain * p[KP] * error
    if law == DUTY:
        saturated = abs(constant) > limit
        constant = voltage * min(max(constant, -limit), limit) + damping * v_ref
    else:
        constant += damping * v_ref + forward
        torque = constant - damping * v
        bound = limit
        along = law == TORQUE_SPEED and torque * v > 0.0
        if along:
            bound = limit * max(1.0 - abs(v) / p[SPEED], 0.0)
        if abs(torque) > bound:
            saturated = True
            constant = np.sign(torque) * limit if bound > 0.0 else 0.0
            damping = limit / p[SPEED] if along and bound > 0.0 else 0.0
    torque = constant - damping * v
    if p[DROOP] > 0.0:
        share = 1.0 / (1.0 + p[DROOP] * abs(torque))
        constant, damping, torque = share * constant, share * damping, share * torque
    return constant, damping, torque, saturated


@njit(cache=True)
def kick(v, mass, force, inertia, damping, friction, h):  # type: ignore[no-untyped-def]
    """Advance speeds (n,) by h in place: (mass + inertia) dv/dt = force - damping v - friction sign v."""
    n = len(v)
    b = np.empty(n)
    for i in range(n):
        total = (inertia[i] - 0.5 * h * damping[i]) * v[i] + h * force[i]
        for j in range(n):
            total += mass[i, j] * v[j]
        b[i] = total
    for _ in range(SWEEPS):
        change, size = 0.0, 0.0
        for i in range(n):
            rest = b[i]
            for j in range(n):
                if j != i:
                    rest -= mass[i, j] * v[j]
            slip = abs(rest) - h * friction[i]
            new = 0.0
            if slip > 0.0:
                new = np.sign(rest) * slip / (mass[i, i] + inertia[i] + 0.5 * h * damping[i])
            change = max(change, abs(new - v[i]))
            size = max(size, abs(new))
            v[i] = new
        if n == 1 or change <= SETTLED * size:
            break


@njit(cache=True)
def actuate(numbers, laws, q, v, command, reference, forward, on, voltage, gain, out):  # type: ignore[no-untyped-def]
    """Drives of n joints: out (4, n) = constant torque, damping, friction bound, saturated."""
    for i in range(len(q)):
        p = numbers[i]
        constant, damping, torque, saturated = 0.0, 0.0, 0.0, False
        if on[i] > 0.5:
            constant, damping, torque, saturated = drive_torque(
                p, laws[i], command[i] - q[i], v[i], reference[i], forward[i], voltage[i], gain[i]
            )
        out[0, i] = constant - p[OFFSET]
        out[1, i] = damping + p[VISCOUS]
        out[2, i] = p[COULOMB] + p[LOAD] * abs(torque)
        out[3, i] = 1.0 if saturated else 0.0


@njit(cache=True)
def simulate(  # type: ignore[no-untyped-def]
    starts, rows, parts, h, mass, bias, by_q, by_v, qs, vs, wave, commands, variant, on, voltage, gain, numbers, laws,
    q0, v0, out, saturated,
):  # fmt: skip
    """Positions out (C, W, rows + 1, n) of C copies over W windows; saturated (C, W, n) counts saturated substeps.

    starts (W,) first rows; parts substeps of a row, of h [s]; along R rows: mass (R, n, n) in the middle of a row,
    bias, qs, vs (R, n), by_q, by_v (R, n, n), wave (n, 2) torque of sin q and cos q; commands (3, V, R parts): command,
    reference speed and feed-forward of each variant; variant (C, n); on, voltage (R, n); gain (n,); numbers (C, n, P);
    laws (n,); q0, v0 (C, W, n).
    """
    copies, windows, n = q0.shape
    q, v, half, force = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    u, reference, forward, act = np.empty(n), np.empty(n), np.empty(n), np.empty((4, n))
    for c in range(copies):
        inertia = numbers[c, :, ARMATURE].copy()
        for w in range(windows):
            for i in range(n):
                q[i], v[i] = q0[c, w, i], v0[c, w, i]
                out[c, w, 0, i] = q[i]
                saturated[c, w, i] = 0
            for row in range(rows):
                r = starts[w] + row
                for part in range(parts):
                    far = (part + 0.5) / parts
                    near, step = 1.0 - far, r * parts + part
                    for i in range(n):
                        half[i] = q[i] + 0.5 * h * v[i]
                        u[i] = commands[0, variant[c, i], step]
                        reference[i] = commands[1, variant[c, i], step]
                        forward[i] = commands[2, variant[c, i], step]
                    actuate(numbers[c], laws, half, v, u, reference, forward, on[r], voltage[r], gain, act)
                    for i in range(n):
                        load = near * bias[r, i] + far * bias[r + 1, i]
                        load += wave[i, 0] * np.sin(half[i]) + wave[i, 1] * np.cos(half[i])
                        for j in range(n):
                            load += by_q[r, i, j] * (half[j] - near * qs[r, j] - far * qs[r + 1, j])
                            load += by_v[r, i, j] * (v[j] - near * vs[r, j] - far * vs[r + 1, j])
                        force[i] = act[0, i] - load
                        saturated[c, w, i] += act[3, i]
                    kick(v, mass[r], force, inertia, act[1], act[2], h)
                    for i in range(n):
                        q[i] = half[i] + 0.5 * h * v[i]
                for i in range(n):
                    out[c, w, row + 1, i] = q[i]
