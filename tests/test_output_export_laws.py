"""Laws in an MJCF: MuJoCo repeats the motion that signid simulates under the same torque."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from exported import model_of

from signid.effects.base import TransmissionLaw
from signid.model import Model
from signid.output.export import export
from signid.simulation.plant import simulate
from signid.simulation.plant.control import Torques
from signid.types import Array

SECONDS, STEP = 2.0, 1e-4  # [s]
BEGIN = 0.3  # [rad] position of the motor
CLOSE = 1e-3  # [rad]
LAWS = {
    "torque_offset": ("torque_offset@1:offset=0.4",),
    "quadratic_friction": ("quadratic_friction@1:coefficient=0.8", "viscous_friction@1:coefficient=0.2"),
    "cable_torque": ("cable_torque@1:cubic=3,centre=0.3",),
    "counterbalance": ("counterbalance@1:amplitude=2,phase=0.4",),
    "torque_ripple": ("torque_ripple@1:amplitude=0.8,frequency=9.5,phase=0.3",),
    "presliding_friction": ("presliding_friction@1:level=0.8,distance=0.02",),
    "joint_elasticity": ("joint_elasticity@1:stiffness=150", "viscous_friction@1:coefficient=0.5"),
    "backlash": ("backlash@1:gap=0.02", "viscous_friction@1:coefficient=0.5"),
}


def plant(*laws: str) -> Model:
    return model_of("1r", "armature@1:inertia=0.1", *laws)


def torque(t: Array) -> Array:
    return np.asarray(1.5 * np.sin(5 * t) + 1.1 * np.sin(9 * t + 1))


def both(model: Model, without: Model) -> tuple[Array, Array, Array]:
    """Positions (K,) [rad] of the motor: of signid, of the exported MJCF, and of signid for another model."""
    t = np.arange(round(SECONDS / STEP)) * STEP
    given = Torques(t, torque(t)[:, None], np.array([BEGIN]), np.zeros(1))
    mine, less = (simulate(x, given, SECONDS, step=STEP).true_q[: len(t), 0] for x in (model, without))
    there = mujoco.MjModel.from_xml_string(export(model, "mjcf").text)
    there.opt.timestep = STEP
    data, found = mujoco.MjData(there), np.empty(len(t))
    data.qpos[0] = BEGIN
    data.qpos[1:] = deflection(model)
    for k, now in enumerate(t):
        found[k] = data.qpos[0]
        data.ctrl[0] = torque(now)
        mujoco.mj_step(there, data)
    return mine, found, less


def deflection(model: Model) -> float:
    """Position of the link behind the motor [rad], in balance with its weight."""
    weight = float(model.gravity(np.array([BEGIN]))[0])
    for law in model.of(TransmissionLaw):
        p = law.parameters
        return -weight / p["stiffness"] if "stiffness" in p else -p["gap"] / 2 * float(np.sign(weight))
    return 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_mujoco_repeats_a_law(name: str) -> None:
    expected, found, without = both(plant(*LAWS[name]), plant(*LAWS[name][1:]))
    assert np.abs(found - expected).max() < CLOSE
    assert np.abs(without - expected).max() > 5 * CLOSE, "the law shows"
