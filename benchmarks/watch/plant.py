"""A controlled arm in MuJoCo, independent of signid, with pushes and changes at known times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ..plants.bodies import Body, Drives
from ..plants.control import STEP, Array, Reference, gains
from ..plants.mujoco_ import build, dofs, inverse, mean_inertia

EVERY = 4  # steps between two samples, which are those of the controller: 1 kHz
PERIOD = EVERY * STEP  # [s]
BANDWIDTH = 2 * np.pi * 4.0  # [rad/s] of the position loop
KNOWN = 0.9  # [1] share of the dynamics in the feed-forward


class Push(NamedTuple):
    """A constant force at the centre of mass of the link of a joint."""

    start: float  # [s]
    duration: float  # [s]
    joint: int
    force: tuple[float, float, float]  # [N] in the world


class Alteration(NamedTuple):
    """A lasting change, sudden, or growing over a time."""

    start: float  # [s]
    effect: str  # payload, viscous_friction, coulomb_friction, torque_gain, torque_offset
    joint: int
    size: float  # [kg, N.m.s/rad, N.m, 1 or N.m]
    ramp: float = 0.0  # [s]

    def at(self, t: float) -> float:
        """Size at a time [s]."""
        share = 1.0 if self.ramp == 0 else min((t - self.start) / self.ramp, 1.0)
        return self.size * share if t >= self.start else 0.0


def record(
    body: Body,
    drives: Drives,
    motion: Reference,
    duration: float,
    events: Sequence[Push | Alteration],
    seed: int,
    noise: float = 0.02,
    bits: int = 17,
) -> dict[str, Array]:
    """Columns t, q_J and tau_J at 1 kHz, with quantised positions and white torque noise over the rms torque."""
    model, known = build(body, drives), build(body, drives, frictionless=True, weigh=False)
    at, data = dofs(model, body.joints), mujoco.MjData(model)
    t = np.arange(round(duration / PERIOD)) * PERIOD
    q_des, v_des, a_des = motion.at(t)
    coarse = slice(None, None, 4)
    forward = inverse(known, body.joints, q_des[coarse], v_des[coarse], a_des[coarse])
    forward = KNOWN * np.column_stack([np.interp(t, t[coarse], x) for x in forward.T])
    stiffness, damping = gains(mean_inertia(known, body.joints, q_des[:: max(len(t) // 20, 1)]), BANDWIDTH)
    data.qpos[at], data.qvel[at] = q_des[0], v_des[0]
    q, tau = np.empty_like(q_des), np.empty_like(q_des)
    plan = _Plan(model, body, at, events)
    before = forward[0]
    for k, now in enumerate(t.tolist()):
        plan.apply(data, now)
        q[k] = data.qpos[at]
        command = forward[k] + stiffness * (q_des[k] - data.qpos[at]) + damping * (v_des[k] - data.qvel[at])
        tau[k], before = (before + command) / 2, command
        data.ctrl[:] = command - np.array(drives.torque_offset)
        mujoco.mj_step(model, data, EVERY)
    return _logged(t, q, tau, [e for e in events if isinstance(e, Alteration)], seed, noise, bits)


class _Plan:
    """Pushes and changes of the bodies and of friction at each sample."""

    def __init__(self, model: Any, body: Body, at: list[int], events: Sequence[Push | Alteration]) -> None:
        self.model, self.at, self.events = model, at, events
        self.bodies = [int(model.joint(name).bodyid[0]) for name in body.joints]
        self.damping, self.dry = model.dof_damping.copy(), model.dof_frictionloss.copy()
        self.loaded = False

    def apply(self, data: Any, t: float) -> None:
        data.xfrc_applied[:] = 0
        for event in self.events:
            if isinstance(event, Push):
                if event.start <= t < event.start + event.duration:
                    data.xfrc_applied[self.bodies[event.joint], :3] += event.force
            elif event.effect == "payload" and t >= event.start and not self.loaded:
                self._load(data, event.size)
            elif event.effect == "viscous_friction":
                self.model.dof_damping[self.at[event.joint]] = self.damping[self.at[event.joint]] + event.at(t)
            elif event.effect == "coulomb_friction":
                self.model.dof_frictionloss[self.at[event.joint]] = self.dry[self.at[event.joint]] + event.at(t)

    def _load(self, data: Any, mass: float) -> None:
        """Add a point mass 0.1 m beside the centre of mass of the last link."""
        i, m = self.bodies[-1], self.model
        whole, shift = m.body_mass[i] + mass, np.array([0.05, 0.0, 0.08])
        m.body_inertia[i] += mass * m.body_mass[i] / whole * 0.005
        m.body_ipos[i] += shift * mass / whole
        m.body_mass[i] = whole
        state = data.qpos.copy(), data.qvel.copy()
        mujoco.mj_setConst(m, mujoco.MjData(m))
        data.qpos[:], data.qvel[:] = state
        self.loaded = True


def _logged(
    t: Array, q: Array, tau: Array, changes: Sequence[Alteration], seed: int, noise: float, bits: int
) -> dict[str, Array]:
    rng, count = np.random.default_rng(seed), 2 * np.pi / 2**bits
    size = np.sqrt(np.mean(tau**2, axis=0))
    for change in changes:
        if change.effect in ("torque_gain", "torque_offset"):
            when = np.array([change.at(x) for x in t.tolist()])
            j = change.joint
            tau[:, j] = tau[:, j] * (1 + when) if change.effect == "torque_gain" else tau[:, j] + when
    zero = rng.uniform(0, count, q.shape[1])
    q = np.round((q - zero) / count) * count + zero
    tau = tau + noise * size * rng.standard_normal(tau.shape)
    columns = {"t": t}
    columns |= {f"q_{j + 1}": x for j, x in enumerate(q.T)}
    return columns | {f"tau_{j + 1}": x for j, x in enumerate(tau.T)}
