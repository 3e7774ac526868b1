"""Deflection of a link along a motion: on a damped spring, or in free flight and contact between two stops."""

from __future__ import annotations

from math import copysign, exp, sqrt

import numpy as np
from scipy.linalg.blas import dtbsv

from ..types import Array, View

SETTLING_PERIODS = 6.0  # duration of the additional initial damping [periods of oscillation]
MAX_EVENTS = 50  # maximum number of impacts and departures within one sample
MIN_LOOK_AHEAD, MAX_LOOK_AHEAD = 64, 4096  # [samples] look-ahead on a stop; doubles while contact lasts


def oscillate(x: View, stiffness: float, damping: float) -> Array:
    """Deflection (N, 1) [rad or m] of a link from its motor, exact for a load linear between samples.

    The deflection changes the load through the stiffness and damping of the rigid bodies. The oscillation before the
    first sample is unknown, so the link starts in equilibrium with the load, critically damped; this additional
    damping fades over the first oscillations.

    Args:
        x: one joint along a motion.
        stiffness: stiffness of the spring [N.m/rad or N/m].
        damping: damping of the spring [N.m.s/rad or N.s/m].

    Source: first-order hold: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 1998, chapter 6.
    """
    j, dt = x.joints[0], x.dt
    along = x.whole.sensitivity
    m, c, k = (
        np.asarray((signal[1:] + signal[:-1]) / 2)  # at midpoints between samples
        for signal in (x.inertia[:, 0], damping + along.velocity[:, j, j], stiffness + along.position[:, j, j])
    )
    if m.min() <= 0:  # a description without inertia cannot oscillate
        return np.zeros((len(m) + 1, 1))
    turns = np.arange(len(m)) * dt * np.sqrt(abs(k / m)) / (2 * np.pi)
    c = c + 2 * np.sqrt(m * abs(k)) * np.clip(1 - turns / SETTLING_PERIODS, 0, 1) ** 2
    force = -x.load[:, 0]
    rate = np.diff(force) / dt
    start, drift = force[:-1] / k - c * rate / k**2, rate / k  # the particular solution start + drift t
    decay, swing = -c / (2 * m), np.sqrt((c / (2 * m)) ** 2 - k / m + 0j)
    grown, faded = np.exp((decay + swing) * dt), np.exp((decay - swing) * dt)
    even = ((grown + faded) / 2).real
    odd = ((grown - faded) / np.where(abs(swing) * dt < 1e-6, np.inf, 2 * swing)).real
    odd = np.where(abs(swing) * dt < 1e-6, dt * np.exp(decay * dt), odd)
    own = np.array([[even - decay * odd, odd], [-k / m * odd, even + decay * odd]])  # (2, 2, N - 1)
    begin, end = np.array([start, drift]), np.array([start + drift * dt, drift])
    return chain(own, end - np.einsum("ijt,jt->it", own, begin), begin[:, 0])[:, :1]


def chain(own: Array, added: Array, first: Array) -> Array:
    """States (N, 2) of the recursion state' = own @ state + added, solved as one banded triangular system.

    Args:
        own: (2, 2, N - 1) transition matrices [any unit].
        added: (2, N - 1) added terms [any unit].
        first: (2,) first state [any unit].
    """
    band = np.zeros((4, 2 * added.shape[1] + 2))
    band[2, 0:-2:2], band[1, 1:-1:2], band[3, 0:-2:2], band[2, 1:-1:2] = -own.reshape(4, -1)
    return np.asarray(dtbsv(3, band, np.append(first, added.T.ravel()), lower=1, diag=1)).reshape(-1, 2)


def fly(x: View, gap: float, stop: float) -> Array:
    """Deflection (N, 1) [rad or m] of a link from its motor, free within a gap.

    Exact for a load constant over each sample; impacts and departures are located within the sample.

    Args:
        x: one joint along a motion.
        gap: distance between the stops [rad or m].
        stop: natural frequency of the link on a critically damped stop [rad/s].
    """
    half, inertia, load = gap / 2, x.inertia[:, 0], x.load[:, 0]
    along, j = x.whole.sensitivity, x.joints[0]
    force, pull, drag = -load / inertia, along.position[:, j, j] / inertia, along.velocity[:, j, j] / inertia
    push, pull, drag = (force[1:] + force[:-1]) / 2, pull[:-1], drag[:-1]
    z, w = copysign(half, force[0]) + force[0] / stop**2, 0.0
    (own, taken), out, dt, i, ahead = _on_stop(pull, drag, x.dt, stop), np.empty_like(force), x.dt, 0, MIN_LOOK_AHEAD
    out[0] = z
    while i < len(push):
        side = 1.0 if z > 0 else -1.0
        if side * z > half:  # on a stop, usually for many samples
            some = slice(i, i + ahead)
            added = np.outer(taken, side * push[some] - half * pull[some])
            y, u = chain(own[:, :, some], added, np.array([side * z - half, side * w])).T
            leaves = ~(y[1:] >= 0)
            count = int(leaves.argmax()) if leaves.any() else len(leaves)
            out[i + 1 : i + 1 + count] = side * (half + y[1 : count + 1])
            z, w, i = side * (half + float(y[count])), side * float(u[count]), i + count
            if count == len(leaves):
                ahead = min(2 * ahead, MAX_LOOK_AHEAD)
                continue
            ahead = MIN_LOOK_AHEAD
        z, w = _stop_response(z, w, float(push[i] - pull[i] * z - drag[i] * w), dt, half, stop)
        out[i + 1], i = z, i + 1
    return out[:, None]


def _on_stop(pull: Array, drag: Array, dt: float, stop: float) -> tuple[Array, Array]:
    """Transition matrices (2, 2, N - 1) of penetration depth and rate on a stop, and input vector (2,) of the force.

    Solution of `_stop_depth` over one sample; `pull` and `drag` reduce the force by the deflection and its rate.
    """
    fade, one = exp(-stop * dt), np.ones_like(pull)
    taken = np.array([(1 - fade * (1 + stop * dt)) / stop**2, fade * dt])
    kept = np.array([[fade * (1 + stop * dt), fade * dt], [-(stop**2) * fade * dt, fade * (1 - stop * dt)]])
    return kept[..., None] * one - taken[:, None, None] * np.array([pull, drag]), taken


def _stop_response(z: float, w: float, f: float, left: float, half: float, stop: float) -> tuple[float, float]:
    """Deflection and its rate after the time `left` under a constant force per inertia."""
    for _ in range(MAX_EVENTS):
        side = copysign(1.0, z)
        outward = side * w if w else side * f
        if abs(z) > half or (abs(z) == half and outward > 0):
            h = _departure(side * z - half, side * w, side * f, left, stop)
            y, u = _stop_depth(side * z - half, side * w, side * f, h, stop)
            z, w = side * half if h < left else side * (half + y), side * u
        else:
            h, end = _arrival(z, w, f, left, half)
            z, w = z + w * h + f * h * h / 2 if end == 0 else end, w + f * h
        left -= h
        if left <= 0:
            break
    return z, w


def _stop_depth(y: float, w: float, f: float, h: float, stop: float) -> tuple[float, float]:
    """Depth and rate on a critically damped stop after the time h."""
    rest = f / stop**2
    a, b = y - rest, w + stop * (y - rest)
    fade = exp(-stop * h)
    return rest + (a + b * h) * fade, (b - stop * (a + b * h)) * fade


def _departure(y: float, w: float, f: float, left: float, stop: float) -> float:
    """Time at which the link leaves a stop, at most `left`."""
    if _stop_depth(y, w, f, left, stop)[0] >= 0:
        return left
    low, high = 0.0, left
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if _stop_depth(y, w, f, middle, stop)[0] < 0 else (middle, high)
    return high


def _arrival(z: float, w: float, f: float, left: float, half: float) -> tuple[float, float]:
    """Time and position at which a free link reaches a stop, or `left` and 0."""
    found = (left, 0.0)
    for end in (-half, half):
        # z + w h + f h2 / 2 = end, in the form without cancellation
        root = w * w - 2 * f * (z - end)
        if root < 0:
            continue
        s = -(w + copysign(sqrt(root), w))
        times = [2 * (z - end) / s] if s else []
        times += [s / f] if f else []
        found = min([found, *((h, end) for h in times if 1e-12 < h < found[0])])
    return found
