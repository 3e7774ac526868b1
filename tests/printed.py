"""A law as its card prints it, evaluated sample by sample without any code of the law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from signid.effects.base import FUNCTIONS, Effect, RecordingLaw
from signid.regression.motion import Motion
from signid.types import Array

NUMPY = {name: getattr(np, name) for name in FUNCTIONS}
FINE, EVERY, TINY = 8, 23, 1e-6  # parts of a sample, samples between those looked at, [rad or m]


def known(effect: Effect) -> dict[str, Any]:
    """Names that an equation may use: functions and the usual parameters."""
    return NUMPY | {"norm": np.linalg.norm} | dict(effect.example)


def printed(effect: Effect, motion: Motion, joints: tuple[int, ...]) -> tuple[int, Array]:
    """The equation at every k-th sample of a motion: k and (N / k, rows); k is 1 where samples are connected."""
    first, _, rate = effect.equation.partition("; dz/dt = ")
    text, names = compile(first, effect.name, "eval"), known(effect)
    if rate:
        names["z"] = _remembered(effect, motion, joints, rate)
        return 1, np.broadcast_to(np.asarray(eval(first, names)), (len(motion), len(joints)))
    alone = effect.scope in ("joint", "link") or "torque_at" in first
    rows: list[Array] = []
    for i in range(0, len(motion), EVERY):
        here = {key: getattr(motion, key)[i] for key in ("q", "v", "a", "load")}
        here["torque"] = here["load"]
        bodies = _bodies(effect, motion, i, joints[0])
        parts = [[j] for j in joints] if alone else [list(joints)]
        values = []
        for j in parts:
            values_at = {key: signal[j[0]] if alone else signal[j] for key, signal in here.items()}
            values_at["torque_at"] = lambda now, j=j: np.interp(now, motion.t, motion.load[:, j[0]])
            values.append(eval(text, names | values_at | bodies | {"t": motion.t[i]}))
        rows.append(np.concatenate([np.atleast_1d(value) for value in values]))
    return EVERY, np.array(rows)


def _remembered(effect: Effect, motion: Motion, joints: tuple[int, ...], rate: str) -> Array:
    """z of the rate in the text, by many small steps between samples, (N, m)."""
    code, names, own = compile(rate, effect.name, "eval"), known(effect), list(joints)
    signals = {"v": motion.v[:, own], "torque": motion.load[:, own]}
    z = signals["torque"][0] if isinstance(effect, RecordingLaw) else np.zeros(len(own))
    out = [z]
    for i in range(1, len(motion)):
        for k in range(FINE):
            share = (k + 0.5) / FINE
            now = {key: (1 - share) * s[i - 1] + share * s[i] for key, s in signals.items()}
            z = z + motion.dt / FINE * eval(code, names | now | {"z": z})
        out.append(z)
    return np.array(out)


def _bodies(effect: Effect, motion: Motion, i: int, joint: int) -> dict[str, Any]:
    """Jacobian, regressor and gravity torque, by differences of forward kinematics and of inverse dynamics."""
    model, q, v, a = motion.robot.model, motion.q[i], motion.v[i], motion.a[i]
    found: dict[str, Any] = {"gravity": model.gravity.linear.copy()}
    steps = [q + sign * TINY * axis for axis in np.eye(len(q)) for sign in (1, -1)]
    if "jacobian" in effect.equation:
        at = np.array([_centres(model, step)[-1] for step in steps])
        found["jacobian"] = ((at[::2] - at[1::2]) / (2 * TINY)).T
    if "gravity_torque" in effect.equation:
        masses = [body.mass for body in list(model.inertias)[1:]]
        at = np.array([masses @ _centres(model, step) for step in steps])
        found["gravity_torque"] = lambda g: -((at[::2] - at[1::2]) / (2 * TINY)) @ g
    if "body" in effect.equation:
        found["body"] = np.column_stack([_added(model, joint + 1, k, (q, v, a)) for k in range(10)])
    return found


def _centres(model: pin.Model, q: Array) -> Array:
    """Centres of mass of the bodies in the world, (nb, 3) [m]."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return np.array([data.oMi[k].act(model.inertias[k].lever) for k in range(1, model.njoints)])


def _added(model: pin.Model, body: int, k: int, state: tuple[Array, Array, Array]) -> Array:
    """Torque (n,) that one more unit of an inertial parameter takes."""
    other = model.copy()
    other.inertias[body] = pin.Inertia.FromDynamicParameters(model.inertias[body].toDynamicParameters() + np.eye(10)[k])
    return np.asarray(pin.rnea(other, other.createData(), *state) - pin.rnea(model, model.createData(), *state))
