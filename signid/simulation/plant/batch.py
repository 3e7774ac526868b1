"""Simulated motions of a batch of initial states under arrays of torque or of commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from ...effects.drive import DriveLaw
from ...errors import OptionError
from ...model import Model, torque_model
from ...regression.joint_dynamics import Simulated, numbers_of, rows_of
from ...types import Array, Frozen
from .control import Plan, Torques
from .plant import simulate_many

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Commands(Frozen):
    """Commanded positions of the drives of a model, each held until the next."""

    t: Array  # (K,) [s]
    desired: Array  # (K, n) [rad or m]
    q: Array  # (n,) initial position [rad or m]
    v: Array  # (n,) initial velocity [rad/s or m/s]

    def start(self) -> tuple[Array, Array]:
        """Initial position and velocity, (n,) each [rad, rad/s]."""
        return self.q, self.v

    def plan(self, t: Array) -> Plan:
        """Commands in force at t (K,) [s], and their speeds from row to row, without gains of a controller."""
        row = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, None)
        rates = np.diff(self.desired, axis=0) / np.diff(self.t)[:, None]
        speed = np.concatenate([np.zeros((1, len(self.q))), rates])[row]
        none = np.zeros_like(speed)
        return Plan(none, self.desired[row], speed, none[0], none[0])


def simulate_batch(
    model: Model,
    t: ArrayLike,
    start: tuple[ArrayLike, ArrayLike],
    torque: ArrayLike | None,
    commands: ArrayLike | None,
    step: float,
) -> Simulated:
    """Simulate motions, as `Model.simulate` documents; start: q and v (..., n) [rad, rad/s].

    Raises:
        OptionError: see there.
    """
    t = numbers_of("simulate", "t", t)
    if t.ndim != 1 or len(t) < 2 or not np.all(np.diff(t) > 0):
        raise OptionError(f"simulate: t has the shape {t.shape}, or does not increase; give instants (K,) in s")
    if torque is not None and commands is not None:
        raise OptionError("simulate: torque and commands both drive the joints; give one of them")
    n = len(model.robot.joints)
    given = np.zeros((len(t), n)) if torque is None else numbers_of("simulate", "torque", torque)
    given = given if commands is None else numbers_of("simulate", "commands", commands)
    if given.shape[-2:] != (len(t), n):
        name = "torque" if commands is None else "commands"
        raise OptionError(f"simulate: {name} has the shape {given.shape}; give (..., {len(t)}, {n}), a row per instant")
    driven = {law.joints[0] for law in model.of(DriveLaw)}
    if commands is not None and (free := [x for j, x in enumerate(model.robot.joints) if j not in driven]):
        raise OptionError(f"simulate: {free[0]} of the model has no position drive; give torque, or identify drives")
    states, own = rows_of(model.robot, "simulate", q=start[0], v=start[1])
    try:
        batch = np.broadcast_shapes(own, given.shape[:-2])
    except ValueError:
        raise OptionError(f"simulate: q has the rows {own}, and the input {given.shape[:-2]}; give the same") from None
    q, v = (np.broadcast_to(x.reshape(*own, n), (*batch, n)).reshape(-1, n) for x in states)
    inputs = np.broadcast_to(given, (*batch, len(t), n)).reshape(-1, len(t), n)
    kind, acting = (Torques, torque_model(model)) if commands is None else (Commands, model)
    drives = [kind(t - t[0], *each) for each in zip(inputs, q, v, strict=True)]
    shape = (*batch, len(t), n)
    if not drives:
        return Simulated(*np.zeros((3, *shape)))
    moved = simulate_many(acting, drives, float(t[-1] - t[0]) + 2 * step, step=step)
    q, v, applied = (np.stack([getattr(x, key) for x in moved]) for key in ("true_q", "true_v", "applied"))
    at = moved[0].t
    found = (CubicHermiteSpline(at, q, v, axis=1), *(make_interp_spline(at, x, k=1, axis=1) for x in (v, applied)))
    return Simulated(*(curve(t - t[0]).reshape(shape) for curve in found))
