"""Robots of the blind benchmark, their motions (Fourier series of eight seconds), and the torque along these."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np

from signid.robot import load_robot

from ..plants.bodies import Body, Drives, bare
from ..plants.control import Array
from ..plants.faults import Fault
from ..plants.mujoco_ import build, dofs, inverse, mean_inertia

MASS, CENTRE, INERTIA = 1.0, 0.1, 2.0  # errors of mass [1], centre [m] and inertia [1] per unit of `error`
LEAST = 0.3  # smallest factor on a stated mass or inertia [1]


class Place(NamedTuple):
    """Centre and largest amplitude of a robot's motions."""

    centre: tuple[float, ...]  # (n,) [rad]
    reach: float  # rad


ROBOTS: Mapping[str, Place] = {
    "1r": Place((0.6,), 1.2),
    "3r": Place((0.0, 0.4, 0.6), 1.0),
    "ur3": Place((0.0, -1.2, 1.2, -0.6, 0.9, 0.3), 0.9),
    "ur5": Place((0.0, -1.2, 1.2, -0.6, 0.9, 0.3), 0.9),
    "ur10": Place((0.0, -1.2, 1.2, -0.6, 0.9, 0.3), 0.9),
    "panda": Place((0.0, -0.3, 0.0, -1.8, 0.3, 1.6, 0.4), 0.6),
    "kinova": Place((0.0, 2.6, 1.8, 0.3, 2.2, 0.4), 0.9),  # light wrist, like xarm7
    "xarm7": Place((0.0, -0.5, 0.2, 1.2, 0.3, 0.8, 0.3), 0.7),
    "z1": Place((0.0, 1.2, -1.2, 0.2, 0.3, 0.4), 0.7),
}


def described(name: str) -> Body:
    """Stated description of a robot: arm with welded hand, without visuals and drives."""
    robot = load_robot(name)
    body = Body(robot.document, robot.joints[: len(ROBOTS[name].centre)])
    root = ElementTree.fromstring(bare(body))
    for joint in root.findall("joint"):
        for part in (*joint.findall("dynamics"), *joint.findall("mimic"), *joint.findall("safety_controller")):
            joint.remove(part)
    return Body(ElementTree.tostring(root, encoding="unicode"), body.joints)


def mistaken(body: Body, error: float, rng: np.random.Generator) -> Body:
    """True robot of a wrong description: every mass, centre and inertia is perturbed."""
    root = ElementTree.fromstring(body.urdf)
    for link in root.findall("link"):
        part = link.find("inertial")
        mass, inertia = (None if part is None else part.find(tag) for tag in ("mass", "inertia"))
        draws = rng.standard_normal(5)
        if part is None or mass is None or inertia is None:
            continue
        mass.set("value", f"{float(mass.get('value', '0')) * max(1 + MASS * error * draws[0], LEAST):.17g}")
        factor = max(1 + INERTIA * error * draws[1], LEAST)
        for key, value in inertia.attrib.items():
            inertia.set(key, f"{float(value) * factor:.17g}")
        origin = part.find("origin")
        origin = ElementTree.SubElement(part, "origin") if origin is None else origin
        centre = np.array(origin.get("xyz", "0 0 0").split(), dtype=float) + CENTRE * error * draws[2:]
        origin.set("xyz", " ".join(f"{x:.17g}" for x in centre))
    return Body(ElementTree.tostring(root, encoding="unicode"), body.joints)


PERIOD, PERIODS = 8.0, 2  # period [s], periods per recording
ORDERS = np.array([1, 2, 3, 5, 8, 12])  # orders of the harmonics
SPEED = 2.2  # largest joint speed [rad/s]
ASIDE, SMALLER = 0.3, 0.7  # largest shift of a motion's centre [rad], smallest used share of the reach [1]


class Fourier(NamedTuple):
    """Sums of sine and cosine about a centre, n joints."""

    sine: Array  # (6, n) [rad]
    cosine: Array  # (6, n) [rad]
    centre: Array  # (n,) [rad]

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration, (N, n) each [rad, rad/s, rad/s2] at times (N,) [s]."""
        w = 2 * np.pi / PERIOD * ORDERS[:, None]
        s, c = np.sin(t[:, None] * w.T), np.cos(t[:, None] * w.T)
        v = c @ (self.sine * w) - s @ (self.cosine * w)
        return self.centre + s @ self.sine + c @ self.cosine, v, -s @ (self.sine * w**2) - c @ (self.cosine * w**2)


def draw(place: Place, rng: np.random.Generator) -> Fourier:
    """Draw a random motion about the place, scaled to the limit of reach or speed."""
    n = len(place.centre)
    sine, cosine = rng.standard_normal((2, len(ORDERS), n)) / np.sqrt(ORDERS)[:, None]
    q, v, _ = Fourier(sine, cosine, np.zeros(n)).at(np.arange(0, PERIOD, 0.01))
    reach = place.reach * rng.uniform(SMALLER, 1, n)
    scale = np.minimum(reach / np.abs(q).max(0), SPEED / np.abs(v).max(0))
    return Fourier(sine * scale, cosine * scale, np.array(place.centre) + rng.uniform(-ASIDE, ASIDE, n))


RATE = 50.0  # sampling rate of the motions [Hz]
DURATION = PERIODS * PERIOD  # duration of a recording [s]
ROTOR, FRICTION = 0.25, 0.05  # rotor over mean joint inertia [1]; viscous and dry friction each over torque [1]
LIGHT = 0.02  # lower bound on a joint's torque scale over the largest one [1]


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot and its sequence of reference motions."""

    body: Body
    motions: tuple[Fourier, ...]
    factors: Sequence[float] | Array = (1.0, 1.0, 1.0)  # on viscous, dry friction and rotors: (3,) or (3, n) [1]

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
        return replace(Drives.none(len(self.body.joints)), armature=tuple(self.factors[2] * ROTOR * self.inertia))

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
        speed, factors = rms(self.asked[1]), self.factors
        viscous, coulomb = factors[0] * FRICTION * self.scale / speed, factors[1] * FRICTION * self.scale
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
