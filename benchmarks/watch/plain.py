"""The momentum observer as textbooks have it, with constant thresholds: what any watch should beat.

De Luca, Albu-Schaeffer, Haddadin, Hirzinger, IEEE/RSJ IROS 2006: r = K (momentum - integral of
the known torque and r), with friction by the model and one threshold a joint.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.signal import savgol_filter

from signid.model import Model
from signid.robot import configuration

from ..plants.control import Array

GAIN = 50.0  # [1/s]
WINDOW, ORDER = 17, 2  # rows and order of the polynomial whose slope is the velocity
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


def largest(r: Array, t: Array, first: float, last: float) -> Array:
    """Largest magnitude (n,) [N.m or N] of a residual between two times [s]."""
    return np.asarray(np.abs(r[(t >= first) & (t < last)]).max(axis=0))
