"""Additional motor torque caused by a fault along the motions of a session."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..plants.bodies import Drives, drive
from ..plants.control import Track
from ..plants.faults import FOREIGN, Fault
from ..plants.laws import Laws
from ..plants.record import misread
from ..plants.torques import LEVELS, MEMORIES, TORQUES
from .scene import RATE, Scene

Array = NDArray[np.float64]

AMPLE = 1e6  # dry friction that keeps the levels of faults positive [N.m]
RIGID = ("payload", "link_inertia", "base_tilt")
DRIVES = ("viscous_friction", "coulomb_friction", "torque_offset", "armature")
RECORDING = ("torque_gain", "torque_lag", "time_delay", "torque_sign", "channel_swap")


def extra(scene: Scene, fault: Fault) -> Array:
    """Additional motor or recorded torque (N, n) [N.m] caused by a fault.

    Raises:
        ValueError: for a fault that requires simulation.
    """
    effect = fault.effect
    if effect in (*LEVELS, *TORQUES, *MEMORIES, *FOREIGN):
        return _stepped(scene, fault)
    for names, law in ((RIGID, _rigid), (DRIVES, _driven), (RECORDING, _misread)):
        if effect in names:
            return law(scene, fault)
    own = OTHERS.get(effect)
    if own is None:
        raise ValueError(f"the torque of {effect} requires simulation")
    return own(scene, fault)


def _stepped(scene: Scene, fault: Fault) -> Array:
    n, torque = len(scene.body.joints), np.zeros_like(scene.bodies)
    laws = Laws([fault], scene.body.joints, [AMPLE] * n, 1 / RATE)
    (q, v, _), load = scene.asked, scene.bodies
    for k, t in enumerate(scene.t):
        added, level = laws.at(t, q[k], v[k], load[k])
        torque[k] = added + (level - AMPLE) * np.sign(v[k])
        laws.advance(v[k])
    return torque


def _rigid(scene: Scene, fault: Fault) -> Array:
    return scene.inverse(*scene.asked, [fault]) - scene.bodies


def _driven(scene: Scene, fault: Fault) -> Array:
    joints, (_, v, a) = scene.body.joints, scene.asked
    own = drive(Drives.none(len(joints)), joints, [fault])
    rubbing = own.viscous_friction * v + own.coulomb_friction * np.sign(v)
    return np.asarray(own.armature * a + rubbing + own.torque_offset)


def _misread(scene: Scene, fault: Fault) -> Array:
    parts = [
        misread(Track(t, q, tau), scene.body.joints, [fault]).tau - tau
        for t, q, tau in zip(*(scene.split(x) for x in (scene.t, scene.asked[0], scene.whole)), strict=True)
    ]
    return np.concatenate(parts)


def _spring(scene: Scene, fault: Fault) -> Array:
    j, p, torque = _at(scene, fault), fault.numbers, np.zeros_like(scene.bodies)
    torque[:, j] = p["stiffness"] * (scene.asked[0][:, j] - p["rest"])
    return torque


def _saturation(scene: Scene, fault: Fault) -> Array:
    j, torque, limit = _at(scene, fault), np.zeros_like(scene.whole), fault.numbers["limit"]
    torque[:, j] = scene.whole[:, j] - np.clip(scene.whole[:, j], -limit, limit)
    return torque


def _offset(scene: Scene, fault: Fault) -> Array:
    q, v, a = scene.asked
    moved = q.copy()
    moved[:, _at(scene, fault)] -= fault.numbers["offset"]
    return scene.inverse(moved, v, a) - scene.bodies


def _elasticity(scene: Scene, fault: Fault) -> Array:
    q, v, a = (x.copy() for x in scene.asked)
    j = _at(scene, fault)
    deflection = -(scene.bodies[:, j] - scene.rotors.armature[j] * a[:, j]) / fault.numbers["stiffness"]
    speed = scene.rate(deflection)
    q[:, j] += deflection
    v[:, j] += speed
    a[:, j] += scene.rate(speed)
    torque = scene.inverse(q, v, a) - scene.bodies
    torque[:, j] -= scene.rotors.armature[j] * scene.rate(speed)  # the rotor does not move with the link
    return torque


def _coupling(scene: Scene, fault: Fault) -> Array:
    j, k, p = _at(scene, fault), scene.body.joints.index(fault.partner), fault.numbers
    _, v, a = scene.asked
    torque = np.zeros_like(v)
    rubbing = p["coulomb"] * np.sign(v[:, j] + v[:, k])
    torque[:, j] = p["inertia"] * a[:, k] + p["viscous"] * v[:, k] + rubbing
    torque[:, k] = p["inertia"] * a[:, j] + p["viscous"] * v[:, j] + rubbing
    return torque


def _contact(scene: Scene, fault: Fault) -> Array:
    p = fault.numbers
    during = (scene.t >= p["start"]) & (scene.t <= p["end"])
    push = np.array([p["force_x"], p["force_y"], p["force_z"]])
    return np.asarray(np.einsum("kin,i->kn", scene.jacobians, push) * during[:, None])


def _drag(scene: Scene, fault: Fault) -> Array:
    w = np.einsum("kin,kn->ki", scene.jacobians, scene.asked[1])
    size = fault.numbers["coefficient"] * np.linalg.norm(w, axis=1, keepdims=True)
    return np.asarray(np.einsum("kin,ki->kn", scene.jacobians, size * w))


def _at(scene: Scene, fault: Fault) -> int:
    return scene.body.joints.index(str(fault.joint))


OTHERS: dict[str, Callable[[Scene, Fault], Array]] = {
    "spring": _spring,
    "torque_saturation": _saturation,
    "encoder_offset": _offset,
    "joint_elasticity": _elasticity,
    "joint_coupling": _coupling,
    "external_contact": _contact,
    "fluid_drag": _drag,
}
