"""Roll-outs of a robot with one joint in compiled code, for whole recordings and for fits that need many of them.

Positions by leapfrog, viscous and quadratic friction by the trapezium rule, dry friction by the exact proximal step. A
model whose laws are not among those below is simulated by the plant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numba import njit

from ...effects.base import ActuatorLaw, BodyLaw
from ...model import Model
from ...robot import configuration
from ...robot.dynamics import joint_inertia
from ...types import Array
from .windows import Windows

(
    INERTIA,
    CONSTANT,
    SINE,
    COSINE,
    FORWARD,
    BACKWARD,
    DRY_FORWARD,
    DRY_BACKWARD,
    QUADRATIC,
    STRIBECK,
    SPEED,
    STIFFNESS,
    WAVE_SINE,
    WAVE_COSINE,
    WAVE,
    RIPPLE_SINE,
    RIPPLE_COSINE,
    RIPPLE,
    COUNT,
) = range(19)  # numbers of a joint, in SI units
# where the coefficients of a law are added, each to one number or several, and its shape parameters
SLOTS: Mapping[str, tuple[tuple[tuple[int, ...], ...], Mapping[str, int]]] = {
    "viscous_friction": (((FORWARD, BACKWARD),), {}),
    "coulomb_friction": (((DRY_FORWARD, DRY_BACKWARD),), {}),
    "asymmetric_friction": (((FORWARD,), (BACKWARD,), (DRY_FORWARD,), (DRY_BACKWARD,)), {}),
    "torque_offset": (((CONSTANT,),), {}),
    "quadratic_friction": (((QUADRATIC,),), {}),
    "spring": (((STIFFNESS,), (CONSTANT,)), {}),
    "stribeck_friction": (((STRIBECK,),), {"velocity": SPEED}),
    "position_friction": (((WAVE_SINE,), (WAVE_COSINE,)), {"frequency": WAVE}),
    "torque_ripple": (((RIPPLE_SINE,), (RIPPLE_COSINE,)), {"frequency": RIPPLE}),
}


def one_joint_numbers(model: Model) -> Array | None:
    """Numbers (COUNT,) of a model with one plain joint whose laws are all known here; else None."""
    robot = model.robot
    if len(robot.joints) != 1 or np.count_nonzero(robot.drive) != 1:
        return None
    laws = [law for law in model.laws if not isinstance(law.effect, BodyLaw | ActuatorLaw)]
    shaped = [law.effect.name for law in laws if law.effect.name in SLOTS and SLOTS[law.effect.name][1]]
    if any(law.effect.name not in SLOTS for law in laws) or len(set(shaped)) < len(shaped):
        return None
    out = _bodies(model)
    out[SPEED] = 1.0
    for law in laws:
        places, shapes = SLOTS[law.effect.name]
        for slots, value in zip(places, law.effect.coefficients(law.parameters), strict=True):
            out[list(slots)] += value
        for key, slot in shapes.items():
            out[slot] = law.parameters[key]
    return out


def _bodies(model: Model) -> Array:
    """Numbers of the bodies: inertia, and gravity as a constant or a wave of the angle."""
    bodies, out = model.bodies(), np.zeros(COUNT)
    data, drive = bodies.createData(), model.robot.drive[:, 0]
    at = configuration(model.robot, np.array([[0.0], [np.pi / 2], [np.pi], [-np.pi / 2]]))
    out[INERTIA] = joint_inertia(replace(model.robot, model=bodies), pin.crba(bodies, data, at[0]))[0, 0]
    torque = [float(pin.computeGeneralizedGravity(bodies, data, q) @ drive) for q in at]
    if model.robot.prismatic[0]:
        out[CONSTANT] = torque[0]
    else:
        out[SINE], out[COSINE] = (torque[1] - torque[3]) / 2, (torque[0] - torque[2]) / 2
    return out


def one_joint_errors(numbers: Array, windows: Windows) -> Array:
    """Simulated minus measured positions (W, S, 1) [rad or m] after each sample.

    Args:
        numbers: (COUNT,) [SI] of `one_joint_numbers`.
        windows: of the joint.
    """
    out = np.empty((len(windows.t), windows.torque.shape[1]))
    _simulate(
        numbers,
        windows.step,
        np.ascontiguousarray(windows.q[:, 0, 0]),
        np.ascontiguousarray(windows.v[:, 0, 0]),
        np.ascontiguousarray(windows.torque[:, :, 0]),
        out,
    )
    return np.asarray(out[:, windows.parts - 1 :: windows.parts] - windows.q[:, 1:, 0])[..., None]


@njit(cache=True, error_model="numpy")
def _simulate(p, h, q0, v0, torque, out):  # type: ignore[no-untyped-def]
    """Positions out (W, S) after each step of h [s]; q0, v0 (W,), torque (W, S); numbers p (COUNT,)."""
    for w in range(len(q0)):
        q, v = q0[w], v0[w]
        for k in range(torque.shape[1]):
            half = q + 0.5 * h * v
            force = torque[w, k] - p[CONSTANT] - p[STIFFNESS] * half
            if p[SINE] != 0.0 or p[COSINE] != 0.0:
                force -= p[SINE] * np.sin(half) + p[COSINE] * np.cos(half)
            if p[RIPPLE_SINE] != 0.0 or p[RIPPLE_COSINE] != 0.0:
                force -= p[RIPPLE_SINE] * np.sin(p[RIPPLE] * half) + p[RIPPLE_COSINE] * np.cos(p[RIPPLE] * half)
            dry = 0.0
            if p[STRIBECK] != 0.0:
                dry += p[STRIBECK] * np.exp(-((v / p[SPEED]) ** 2))
            if p[WAVE_SINE] != 0.0 or p[WAVE_COSINE] != 0.0:
                dry += p[WAVE_SINE] * np.sin(p[WAVE] * half) + p[WAVE_COSINE] * np.cos(p[WAVE] * half)
            damping = p[FORWARD] if v > 0.0 or (v == 0.0 and force > 0.0) else p[BACKWARD]
            share = 0.5 * h * (damping + p[QUADRATIC] * abs(v)) / p[INERTIA]
            free = v * (1.0 - share) + h * force / p[INERTIA]
            high, low = h * (p[DRY_FORWARD] + dry) / p[INERTIA], -h * (p[DRY_BACKWARD] + dry) / p[INERTIA]
            if free > high:
                after = (free - high) / (1.0 + share)
            elif free < low:
                after = (free - low) / (1.0 + share)
            else:
                after = 0.0
            q, v = half + 0.5 * h * after, after
            out[w, k] = q
