"""Healthy robot along the motions of its session: joint motion and torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..plants.bodies import Body, Drives
from ..plants.faults import Fault
from ..plants.mujoco_model import build, dofs, inverse, mean_inertia
from .motion import PERIOD, PERIODS, Fourier

Array = NDArray[np.float64]

RATE = 50.0  # sampling rate of the motions [Hz]
DURATION = PERIODS * PERIOD  # duration of a recording [s]
ROTOR, FRICTION = 0.25, 0.05  # rotor over mean joint inertia [1]; viscous and dry friction each over torque [1]
LIGHT = 0.02  # lower bound on a joint's torque scale over the largest one [1]


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot and its sequence of reference motions."""

    body: Body
    motions: tuple[Fourier, ...]

    @cached_property
    def t(self) -> Array:
        """Times of the session (N,) [s]."""
        return np.arange(round(len(self.motions) * DURATION * RATE)) / RATE

    @cached_property
    def asked(self) -> tuple[Array, Array, Array]:
        """Desired position, velocity and acceleration, (N, n) each [rad, rad/s, rad/s2]."""
        parts = [motion.at(t) for motion, t in zip(self.motions, self.split(self.t), strict=True)]
        return tuple(np.vstack(x) for x in zip(*parts, strict=True))  # type: ignore[return-value]

    @cached_property
    def inertia(self) -> Array:
        """Mean diagonal of the links' mass matrix (n,) [kg.m2]."""
        model = build(self.body, Drives.none(len(self.body.joints)))
        return mean_inertia(model, self.body.joints, self.asked[0][:: round(RATE)])

    @cached_property
    def rotors(self) -> Drives:
        """Drives without friction."""
        return replace(Drives.none(len(self.body.joints)), armature=tuple(ROTOR * self.inertia))

    @cached_property
    def bodies(self) -> Array:
        """Torque of links and rotors (N, n) [N.m]."""
        return self.inverse(*self.asked)

    @cached_property
    def scale(self) -> Array:
        """Rms torque of each joint with a lower bound (n,) [N.m]."""
        size = rms(self.bodies)
        return np.maximum(size, LIGHT * size.max())

    @cached_property
    def drives(self) -> Drives:
        """Drives with rotors and friction at every joint."""
        speed = rms(self.asked[1])
        viscous, coulomb = FRICTION * self.scale / speed, FRICTION * self.scale
        return replace(self.rotors, viscous_friction=tuple(viscous), coulomb_friction=tuple(coulomb))

    @cached_property
    def whole(self) -> Array:
        """Motor torque including friction (N, n) [N.m]."""
        v = self.asked[1]
        return self.bodies + self.drives.viscous_friction * v + self.drives.coulomb_friction * np.sign(v)

    def inverse(self, q: Array, v: Array, a: Array, faults: Sequence[Fault] = ()) -> Array:
        """Torque of links and rotors (N, n) [N.m] with faults along a motion (N, n) [rad, rad/s, rad/s2]."""
        model = build(self.body, self.rotors, frictionless=True, faults=faults)
        return inverse(model, self.body.joints, q, v, a)

    @cached_property
    def jacobians(self) -> Array:
        """Jacobians (N, 3, n) [m] of the last link's centre of mass."""
        model = build(self.body, self.rotors)
        data, at = mujoco.MjData(model), dofs(model, self.body.joints)
        tip, full = int(model.joint(self.body.joints[-1]).bodyid[0]), np.zeros((3, model.nv))
        found = np.zeros((len(self.t), 3, len(at)))
        for k, q in enumerate(self.asked[0]):
            data.qpos[at] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacBodyCom(model, data, full, None, tip)
            found[k] = full[:, at]
        return found

    def split(self, x: Array) -> list[Array]:
        """Split rows of the session (N, ...) into rows of each motion."""
        return np.split(x, len(self.motions))

    def rate(self, x: Array) -> Array:
        """Time derivative of rows (N, ...), motion by motion."""
        return np.concatenate([np.gradient(part, 1 / RATE, axis=0) for part in self.split(x)])


def rms(x: Array) -> Array:
    """Root mean square over rows."""
    return np.asarray(np.sqrt(np.mean(np.square(x), axis=0)))
