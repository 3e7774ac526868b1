"""Deflection of a link on a damped spring along a motion."""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dtbsv

from ..types import Array, View

SETTLING_PERIODS = 6.0  # duration of the additional initial damping [periods of oscillation]


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
