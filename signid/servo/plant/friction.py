"""Speeds after a substep with dry friction, by the exact proximal step, in compiled code.

The speeds minimise kinetic energy and friction together: by a Cholesky factor while no joint starts, stops or turns,
else by Gauss-Seidel over coupled joints.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...servos import SERVO_NUMBERS

ARMATURE = SERVO_NUMBERS.index("armature")
SWEEPS, SETTLED = 60, 1e-11  # of Gauss-Seidel; largest relative change of a speed that ends it


@njit(cache=True, error_model="numpy")
def kick(v, mass, r, force, numbers, c, act, h, b, room, known):  # type: ignore[no-untyped-def]
    """Advance speeds (n,) by h in place: (mass + armature) dv/dt = force - damping v - friction sign v.

    mass (R, n, n) at row r; numbers (C, n, P) of copy c; act (4, n) as `actuate` leaves it; b (n,), room (n, n + 2);
    known (2 n + 1,): row, inertias and moving joints of the factor in `room`; its first entry is -1 without one.
    """
    n = len(v)
    for i in range(n):
        inertia, half = numbers[c, i, ARMATURE], 0.5 * h * act[1, i]
        total = (inertia - half) * v[i] + h * force[i]
        for j in range(n):
            total += mass[r, i, j] * v[j]
        b[i], room[i, n] = total, inertia + half
    if n > 1 and slide(v, mass, r, act, h, b, room, known):
        return
    for _ in range(SWEEPS):
        change, size = 0.0, 0.0
        for i in range(n):
            rest = b[i] + mass[r, i, i] * v[i]
            for j in range(n):
                rest -= mass[r, i, j] * v[j]
            bound = h * act[2, i]
            new = (max(rest - bound, 0.0) + min(rest + bound, 0.0)) / (mass[r, i, i] + room[i, n])
            change = max(change, abs(new - v[i]))
            size = max(size, abs(new))
            v[i] = new
        if n == 1 or change <= SETTLED * size:
            break


@njit(cache=True, error_model="numpy")
def factor(v, mass, r, room, known):  # type: ignore[no-untyped-def]
    """Cholesky factor in room[:, :n], with the inverse of its diagonal; joints at rest are left out.

    It is kept while row, inertias and the joints that move stay the same.
    """
    n, same = len(v), known[0] == r
    for i in range(n):
        moves = 1.0 if v[i] != 0.0 else 0.0
        same = same and known[1 + i] == room[i, n] and known[1 + n + i] == moves
        known[1 + i], known[1 + n + i] = room[i, n], moves
    known[0] = r
    if same:
        return
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            if v[i] != 0.0 and v[j] != 0.0:
                total = mass[r, i, j]
                for k in range(j):
                    total -= room[i, k] * room[j, k]
            if i == j:
                room[i, i] = 1.0 / np.sqrt(total + room[i, n]) if v[i] != 0.0 else 1.0
            else:
                room[i, j] = total * room[j, j]


@njit(cache=True, error_model="numpy")
def slide(v, mass, r, act, h, b, room, known):  # type: ignore[no-untyped-def]
    """Solve for speeds in place if no joint starts, stops or turns: whether that is so; else v is not changed."""
    n = len(v)
    factor(v, mass, r, room, known)
    for i in range(n):
        total = b[i] - h * act[2, i] * np.sign(v[i]) if v[i] != 0.0 else 0.0
        for k in range(i):
            total -= room[i, k] * room[k, n + 1]
        room[i, n + 1] = total * room[i, i]
    for i in range(n - 1, -1, -1):
        total = room[i, n + 1]
        for k in range(i + 1, n):
            total -= room[k, i] * room[k, n + 1]
        room[i, n + 1] = total * room[i, i]
    for i in range(n):
        new = room[i, n + 1]
        if v[i] != 0.0:
            if new * v[i] <= 0.0:
                return False
        else:
            rest = b[i]
            for k in range(n):
                rest -= mass[r, i, k] * room[k, n + 1]
            if abs(rest) > h * act[2, i]:
                return False
    for i in range(n):
        v[i] = room[i, n + 1]
    return True
