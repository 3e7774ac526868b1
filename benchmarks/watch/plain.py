"""The momentum observer as textbooks have it, with constant thresholds: what any watch should beat.

De Luca, Albu-Schaeffer, Haddadin, Hirzinger, IEEE/RSJ IROS 2006: r = K (momentum - integral of
the known torque and r), with friction by the model and one threshold a joint.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.signal import savgol_filter

from signid.model import Model
from signid.robot import configuration

from ..plants.control import Array
from .plant import Push

GAIN = 50.0  # [1/s]
WINDOW, ORDER = 17, 2  # rows and order of the polynomial whose slope is the velocity
SETTLED = 3.0  # [s] after which the observer has settled
SLOW = 0.02  # [rad/s or m/s] over which the sign of dry friction is smoothed


def residual(model: Model, t: Array, q: Array, tau: Array) -> Array:
    """External torque (N, n) [N.m or N] of rows at times t (N,) [s] with positions and torques (N, n)."""
    step = float(np.median(np.diff(t)))
    v = savgol_filter(q, WINDOW, ORDER, deriv=1, delta=step, axis=0)
    bodies = model.bodies()
    rotors, bodies.armature = bodies.armature.copy(), np.zeros(bodies.nv)
    data, drive = bodies.createData(), model.robot.drive
    friction = np.zeros_like(q)
    for law in model.laws:
        j, known = law.joints[0], law.parameters
        if law.effect.name == "viscous_friction":
            friction[:, j] += known["coefficient"] * v[:, j]
        elif law.effect.name == "coulomb_friction":
            friction[:, j] += known["level"] * np.tanh(v[:, j] / SLOW)
        elif law.effect.name == "torque_offset":
            friction[:, j] += known["offset"]
    r, total, begun = np.zeros_like(q), np.zeros(q.shape[1]), np.zeros(q.shape[1])
    for k, (position, rate) in enumerate(zip(configuration(model.robot, q), v @ drive.T, strict=True)):
        mass = pin.crba(bodies, data, position)
        mass = np.triu(mass) + np.triu(mass, 1).T + np.diag(rotors)
        momentum = drive.T @ mass @ rate
        coriolis = pin.computeCoriolisMatrix(bodies, data, position, rate)
        known = drive.T @ (coriolis.T @ rate - pin.computeGeneralizedGravity(bodies, data, position))
        if k == 0:
            begun = momentum
        total += step * (tau[k] - friction[k] + known + r[k - 1])
        r[k] = GAIN * (momentum - begun - total)
    return -r


def plain_hits(model: Model, pushed: dict[str, Array], calm: dict[str, Array], planned: Sequence[Push]) -> int:
    """Pushes in which the residual exceeds the largest one of the same stream without pushes.

    These thresholds are the lowest ones without a false alarm; no watch can know them in advance.
    """
    n = len(model.robot.joints)

    def of(columns: dict[str, Array]) -> Array:
        q, tau = (np.column_stack([columns[f"{key}_{j + 1}"] for j in range(n)]) for key in ("q", "tau"))
        return residual(model, columns["t"], q, tau)

    late = calm["t"] > SETTLED
    over = (np.abs(of(pushed)) > np.abs(of(calm)[late]).max(axis=0)).any(axis=1)
    t = pushed["t"]
    return sum(bool(over[(t >= one.start) & (t < one.start + one.duration)].any()) for one in planned)
