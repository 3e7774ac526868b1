"""Speeds after a substep with dry friction, by the exact proximal step, in compiled code.

The speeds minimise kinetic energy and friction together: by a Cholesky factor while no joint starts, stops or turns,
else by Gauss-Seidel over coupled joints.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...types import Array

# Inlined, and without counts of references: a call would copy the seventeen arrays of a state; five times as fast
LOOP = njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[call-overload]
SWEEPS, SPEED_TOLERANCE = 60, 1e-11  # of Gauss-Seidel; largest relative change of a speed that ends it


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
    factor: Array  # (n, n) [any] Cholesky factor with the inverse of its diagonal
    link: Array  # (n,) [rad or m] positions of the links in the middle of the substep
    seen: Array  # (n,) [rad or m] positions that the drives measure in the middle of the substep
    play: Array  # (6, n) [any] of joints with backlash
    of: Array  # (M,) [any] 2 n + 1 values: 1 if there is a factor, and the inertias and the moving joints that it is of


def new_state(n: int) -> State:
    """State of n joints at rest, without a factor."""
    one, five = np.zeros((12, n)), np.zeros((2, 5, n))
    fields = [*one[:7], *five, *one[7:10], np.zeros((n, n)), *one[10:], np.zeros((6, n)), np.zeros(2 * n + 1)]
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
    """Cholesky factor of mass and inertia; joints at rest are left out.

    It is kept while mass, inertias and the joints that move stay the same.
    """
    v, factor, of, inertia = state.v, state.factor, state.of, state.inertia
    n, same = len(v), of[0] == 1.0
    for i in range(n):
        moves = 1.0 if v[i] != 0.0 else 0.0
        same = same and of[1 + i] == inertia[i] and of[1 + n + i] == moves
        of[1 + i], of[1 + n + i] = inertia[i], moves
    of[0] = 1.0
    if same:
        return
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            if v[i] != 0.0 and v[j] != 0.0:
                total = mass[i, j]
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
            if i == j:
                factor[i, i] = 1.0 / np.sqrt(total + inertia[i]) if v[i] != 0.0 else 1.0
            else:
                factor[i, j] = total * factor[j, j]


@LOOP
def slide(state, mass, h):  # type: ignore[no-untyped-def]
    """Solve for speeds in place if no joint starts, stops or turns: whether that is so; else v is not changed."""
    v, right, act, new, factor = state.v, state.right, state.act, state.new, state.factor
    n = len(v)
    factorise(state, mass)
    for i in range(n):
        total = right[i] - h * act[2, i] * np.sign(v[i]) if v[i] != 0.0 else 0.0
        for k in range(i):
            total -= factor[i, k] * new[k]
        new[i] = total * factor[i, i]
    for i in range(n - 1, -1, -1):
        total = new[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * new[k]
        new[i] = total * factor[i, i]
    for i in range(n):
        if v[i] != 0.0:
            if new[i] * v[i] <= 0.0:
                return False
        else:
            rest = right[i]
            for k in range(n):
                rest -= mass[i, k] * new[k]
            if abs(rest) > h * act[2, i]:
                return False
    for i in range(n):
        v[i] = new[i]
    return True
