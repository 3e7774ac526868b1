"""Senseless recordings, made from a good one."""

from __future__ import annotations

import numpy as np

from signid.types import Array

Columns = dict[str, Array]
LEVEL = 2 * np.pi / 256  # [rad] step of an encoder of 8 bits


def senseless(t: Array, q: Array, tau: Array, other: Array, seed: int = 0) -> dict[str, Columns]:
    """Recordings by name, made from a good one: t (N,) [s], q (N, 3) [rad], tau (N, 3) [N.m].

    other: (M, 3) [N.m] torque of another motion.
    """
    rng = np.random.default_rng(seed)
    second, order, m = round(1 / float(np.median(np.diff(t)))), rng.permutation(len(t)), min(len(t), len(other))
    taus = {**_moved_torques(tau, second), **_wrong_torques(tau, rng)}
    made = {name: {"t": t, "q": q, "tau": x} for name, x in taus.items()}
    made |= {name: {"t": t, "q": x, "tau": tau} for name, x in _positions(q, rng).items()}
    return made | {
        "tau_of_another_motion": {"t": t[:m], "q": q[:m], "tau": other[:m]},
        "time_double": {"t": 2 * t, "q": q, "tau": tau},
        "time_half": {"t": t / 2, "q": q, "tau": tau},
        "rows_shuffled": {"t": t, "q": q[order], "tau": tau[order]},
    }


def _moved_torques(tau: Array, second: int) -> dict[str, Array]:
    return {
        "tau_shifted_1s": np.roll(tau, second, axis=0),
        "tau_early_1s": np.roll(tau, -second, axis=0),
        "tau_reversed": tau[::-1],
        "tau_joints_exchanged": tau[:, [1, 0, 2]],
        "tau_joints_rotated": tau[:, [1, 2, 0]],
        "tau_negated": -tau,
        "tau_one_negated": tau * [1, -1, 1],
        "tau_times_1000": 1000 * tau,
    }


def _wrong_torques(tau: Array, rng: np.random.Generator) -> dict[str, Array]:
    size, most = tau.std(axis=0), 0.3 * np.abs(tau).max(axis=0)
    return {
        "tau_white_noise": rng.normal(size=tau.shape) * size,
        "tau_signs_random": tau * rng.choice([-1, 1], size=tau.shape),
        "tau_three_levels": np.sign(tau) * (np.abs(tau) > size / 2) * size,
        "tau_spikes": spiked(tau, 20 * float(tau.std()), rng),
        "tau_saturated": np.clip(tau, -most, most),
        "tau_stuck": stuck(tau, 1),
        "tau_signed_sqrt": np.sign(tau) * np.sqrt(np.abs(tau)),
        "tau_squared": np.sign(tau) * tau**2,
        "tau_dropouts": np.where(rng.random((len(tau), 1)) < 0.1, 0.0, tau),
        "tau_constant_plus_noise": tau.mean(axis=0) + 0.01 * rng.normal(size=tau.shape),
        "tau_random_walk": 0.02 * np.cumsum(rng.normal(size=tau.shape), axis=0),
    }


def _positions(q: Array, rng: np.random.Generator) -> dict[str, Array]:
    return {
        "q_random_walk": np.cumsum(0.01 * rng.normal(size=q.shape), axis=0),
        "q_joints_exchanged": q[:, [1, 0, 2]],
        "q_reversed": q[::-1],
        "q_negated": -q,
        "q_spikes": spiked(q, 1.0, rng),
        "q_stuck": stuck(q, 1),
        "q_off_90": q + [0, np.pi / 2, 0],
        "q_halved": q * [1, 0.5, 1],
        "q_doubled": q * [1, 2, 1],
        "q_8bit": LEVEL * np.round(q / LEVEL),
        "q_dropouts": np.where(rng.random((len(q), 1)) < 0.1, 0.0, q),
        "q_degrees": np.degrees(q),
    }


def spiked(x: Array, size: float, rng: np.random.Generator) -> Array:
    """Signals (N, n) with 5 % spikes."""
    return np.asarray(x + size * (rng.random(x.shape) < 0.05) * rng.choice([-1, 1], size=x.shape))


def stuck(x: Array, joint: int) -> Array:
    """Signals (N, n) of which one keeps its value after a third."""
    out = x.copy()
    out[len(x) // 3 :, joint] = x[len(x) // 3, joint]
    return out
