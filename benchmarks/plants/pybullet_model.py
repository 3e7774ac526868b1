"""Robot in Bullet with its joints in a given order.

By default, Bullet assigns 1 kg to links without inertial, applies the URDF's joint limits, brakes every motor, adds air
drag to every link and changes inertia by merging fixed links. This module disables all of these.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pybullet
from numpy.typing import NDArray

from .bodies import Body, bare, tilted
from .control import STEP
from .faults import Fault

Array = NDArray[np.float64]


class Machine:
    """One robot in its own world; call `close` after use."""

    def __init__(self, body: Body, faults: Sequence[Fault] = (), weigh: bool = True) -> None:
        """Load the rigid bodies without friction, rotors and laws.

        Args:
            body: rigid bodies.
            faults: planted faults; only bodies and gravity are used.
            weigh: use the true link masses instead of those of the URDF.

        Raises:
            ValueError: when a joint has more than one position or is missing.
        """
        self.world = pybullet.connect(pybullet.DIRECT)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(_plain(bare(body, faults)), encoding="utf-8")
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE
            self.id = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=self.world)
        pybullet.setTimeStep(STEP, physicsClientId=self.world)
        pybullet.setGravity(*tilted(np.array([0.0, 0.0, -9.81]), faults), physicsClientId=self.world)
        count = pybullet.getNumJoints(self.id, physicsClientId=self.world)
        infos = [pybullet.getJointInfo(self.id, i, physicsClientId=self.world) for i in range(count)]
        moving = [i for i, info in enumerate(infos) if info[2] != pybullet.JOINT_FIXED]
        at = {infos[i][1].decode(): i for i in moving}
        if set(at) != set(body.joints):
            raise ValueError(f"Bullet moves joints {', '.join(at)} instead of {', '.join(body.joints)}")
        self.joints = [at[name] for name in body.joints]
        self._order = [moving.index(i) for i in self.joints]
        self._links = {info[12].decode(): i for i, info in enumerate(infos)}
        for i in range(-1, count):
            pybullet.changeDynamics(
                self.id, i, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=self.world
            )
        for link, factor in body.heavier.items() if weigh else ():
            self._weigh(self._links[link], factor)
        still = {"controlMode": pybullet.VELOCITY_CONTROL, "forces": [0.0] * len(at)}
        pybullet.setJointMotorControlArray(self.id, self.joints, physicsClientId=self.world, **still)
        self._tip = self._centre(infos)

    def close(self) -> None:
        """Disconnect from the world."""
        pybullet.disconnect(self.world)

    def place(self, q: Array, v: Array) -> None:
        """Set joint positions q (n,) [rad] and velocities v (n,) [rad/s]."""
        for i, x, dx in zip(self.joints, q, v, strict=True):
            pybullet.resetJointState(self.id, i, x, dx, physicsClientId=self.world)

    def read(self) -> tuple[Array, Array]:
        """Positions and velocities, (n,) each [rad, rad/s]."""
        states = pybullet.getJointStates(self.id, self.joints, physicsClientId=self.world)
        return np.array([x[0] for x in states]), np.array([x[1] for x in states])

    def step(self, torque: Array) -> None:
        """Advance one step under torque (n,) [N.m]."""
        control = {"controlMode": pybullet.TORQUE_CONTROL, "forces": torque.tolist()}
        pybullet.setJointMotorControlArray(self.id, self.joints, physicsClientId=self.world, **control)
        pybullet.stepSimulation(physicsClientId=self.world)

    def mass(self, q: Array) -> Array:
        """Mass matrix (n, n) [kg.m2] at q (n,) [rad]."""
        matrix = pybullet.calculateMassMatrix(self.id, self._sort(q), physicsClientId=self.world)
        return np.array(matrix)[np.ix_(self._order, self._order)]

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Inverse dynamics (n,) [N.m] at q (n,) [rad], v (n,) [rad/s], a (n,) [rad/s2]."""
        states = (self._sort(x) for x in (q, v, a))
        return np.array(pybullet.calculateInverseDynamics(self.id, *states, physicsClientId=self.world))[self._order]

    def jacobian(self, q: Array) -> Array:
        """Jacobian (3, n) [m] of the last link's centre of mass along the world's axes at q (n,) [rad]."""
        zero, position = [0.0] * len(q), self._sort(q)
        full = pybullet.calculateJacobian(
            self.id, self.joints[-1], self._tip, position, zero, zero, physicsClientId=self.world
        )
        return np.array(full[0])[:, self._order]

    def _sort(self, x: Array) -> list[float]:
        sorted_ = np.empty(len(x))
        sorted_[self._order] = x
        return list(sorted_.tolist())

    def _weigh(self, link: int, factor: float) -> None:
        mass, _, inertia = pybullet.getDynamicsInfo(self.id, link, physicsClientId=self.world)[:3]
        heavy = {"mass": mass * factor, "localInertiaDiagonal": [x * factor for x in inertia]}
        pybullet.changeDynamics(self.id, link, physicsClientId=self.world, **heavy)

    def _centre(self, infos: Sequence[tuple[object, ...]]) -> list[float]:
        """Centre of mass of the last link and all links welded to it, along the link's principal axes [m].

        Bullet's Jacobian expects points in these coordinates.
        """
        last = self.joints[-1]
        welded = {last}
        for i, info in enumerate(infos):
            if info[2] == pybullet.JOINT_FIXED and info[16] in welded:
                welded.add(i)
        masses = [pybullet.getDynamicsInfo(self.id, i, physicsClientId=self.world)[0] for i in sorted(welded)]
        states = pybullet.getLinkStates(
            self.id, sorted(welded), computeForwardKinematics=True, physicsClientId=self.world
        )
        centre = np.average([x[0] for x in states], axis=0, weights=masses)
        frame = states[sorted(welded).index(last)]
        axes = pybullet.getDynamicsInfo(self.id, last, physicsClientId=self.world)[4]
        local = pybullet.multiplyTransforms(*pybullet.invertTransform(frame[4], frame[5]), centre, [0, 0, 0, 1])[0]
        return list(pybullet.multiplyTransforms(*pybullet.invertTransform([0, 0, 0], axes), local, [0, 0, 0, 1])[0])


def _plain(urdf: str) -> str:
    """URDF without limits and drive parameters, and with zero mass for links without inertial."""
    root = ElementTree.fromstring(urdf.encode())
    for joint in root.findall("joint"):
        for part in (*joint.findall("limit"), *joint.findall("dynamics"), *joint.findall("mimic")):
            joint.remove(part)
        if joint.get("type") == "revolute":
            joint.set("type", "continuous")
        elif joint.get("type") == "prismatic":
            ElementTree.SubElement(joint, "limit", lower="1", upper="-1", effort="0", velocity="0")
    for link in root.findall("link"):
        if link.find("inertial") is None:
            massless = ElementTree.SubElement(link, "inertial")
            ElementTree.SubElement(massless, "mass", value="0")
            ElementTree.SubElement(massless, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0"))
    return ElementTree.tostring(root, encoding="unicode")
