"""Random faults of every kind; their size is scaled afterwards."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..plants.faults import Fault
from .scene import DURATION, Scene, rms

Values = Mapping[str, float | str]
GLOBAL = ("base_tilt", "external_contact", "fluid_drag", "time_delay", "torque_lag")  # effects without joint
SPREAD = (*GLOBAL, "payload", "link_inertia", "encoder_offset")  # measured over all joints
UNSIZED = ("torque_sign", "channel_swap")


class Draw:
    """Random parameters of a fault at joint j of a scene."""

    def __init__(self, scene: Scene, j: int, rng: np.random.Generator) -> None:
        self.scene, self.j, self.rng = scene, j, rng
        q = scene.asked[0][:, j]
        self.torque, self.speed = float(scene.scale[j]), float(rms(scene.asked[1])[j])
        self.middle, self.travel = float(q.mean()), float(np.ptp(q))
        self.end = DURATION * len(scene.motions)

    def within(self, low: float, high: float) -> float:
        """Uniform random number."""
        return float(self.rng.uniform(low, high))

    @property
    def side(self) -> float:
        """Random sign."""
        return float(self.rng.choice([-1.0, 1.0]))

    @property
    def turn(self) -> float:
        """Random angle [rad]."""
        return self.within(-np.pi, np.pi)

    def partner(self) -> str:
        """Name of a neighbouring joint."""
        joints = self.scene.body.joints
        return joints[self.j - 1 if self.j else 1]

    def direction(self, n: int) -> list[float]:
        """Random unit vector."""
        x = self.rng.standard_normal(n)
        return [float(y) for y in x / np.linalg.norm(x)]

    def asymmetric(self) -> Values:
        """Friction with a ratio of two to six between the directions."""
        more, other = (1 + x * self.within(0.35, 0.7) for x in (self.side, self.side))
        viscous, level = self.torque / self.speed, self.torque
        both = {"viscous_positive": viscous * more, "viscous_negative": viscous * (2 - more)}
        return {**both, "coulomb_positive": level * other, "coulomb_negative": level * (2 - other)}

    def body(self, aside: float, ahead: float) -> Values:
        """Body of 1 kg, some centimetres off the joint's axis and ahead along it."""
        x, y, z = (self.within(-aside, aside) for _ in range(3))
        return {"mass": 1.0, "first_moment_x": x, "first_moment_y": y, "first_moment_z": z + ahead}

    def coupling(self) -> Values:
        """Coupled drives of two neighbouring joints."""
        partner = self.partner()
        k = self.scene.body.joints.index(partner)
        inertia = self.within(0, 0.5) * min(self.scene.rotors.armature[self.j], self.scene.rotors.armature[k])
        rubbing = self.within(0.2, 1) * self.torque, self.within(0.2, 1) * self.torque
        return {"partner": partner, "inertia": inertia, "viscous": rubbing[0] / self.speed, "coulomb": rubbing[1]}

    def contact(self) -> Values:
        """Push of about one second in one of the motions."""
        force, start = self.direction(3), self.within(1.5, DURATION - 3)
        start += DURATION * int(self.rng.integers(len(self.scene.motions)))
        times = {"start": start, "end": start + self.within(0.7, 1.5)}
        return {**dict(zip(("force_x", "force_y", "force_z"), force, strict=True)), **times}

    def lugre(self) -> Values:
        """LuGre friction with a bristle deflection of 5 % of the travel."""
        level, stiffness = self.torque, self.torque / (0.05 * self.travel)
        rest = {"velocity": 0.2 * self.speed, "stiffness": stiffness, "damping": 0.002 * stiffness}
        return {"level": level, "static": 1.4 * level, **rest}

    def ripple(self, low: float, high: float) -> Values:
        """Sine wave over the position."""
        return {"amplitude": self.torque, "frequency": self.within(low, high), "phase": self.turn}


LAWS: Mapping[str, Callable[[Draw], Values]] = {
    "viscous_friction": lambda d: {"coefficient": d.torque / d.speed},
    "coulomb_friction": lambda d: {"level": d.torque},
    "asymmetric_friction": Draw.asymmetric,
    "stribeck_friction": lambda d: {"level": d.torque, "velocity": d.within(0.18, 0.35) * d.speed},
    "quadratic_friction": lambda d: {"coefficient": d.torque / d.speed**2},
    "load_friction": lambda d: {"coefficient": 1.0},
    "presliding_friction": lambda d: {"level": d.torque, "distance": d.within(0.04, 0.1) * d.travel},
    "position_friction": lambda d: d.ripple(1.0, 3.0),
    "friction_drift": lambda d: {"change": d.side * d.torque, "time_constant": d.within(0.15, 0.5) * d.end},
    "armature": lambda d: {"inertia": 1.0},
    "torque_offset": lambda d: {"offset": d.side * d.torque},
    "spring": lambda d: {"stiffness": d.torque, "rest": d.middle + d.within(-0.3, 0.3)},
    "cable_torque": lambda d: {"cubic": d.side * d.torque, "centre": d.middle + d.within(-0.1, 0.1)},
    "counterbalance": lambda d: {"amplitude": d.torque, "phase": d.turn},
    "torque_gain": lambda d: {"error": d.side},
    "torque_ripple": lambda d: d.ripple(6.0, 20.0),
    "backlash": lambda d: {"gap": 0.2},
    "joint_elasticity": lambda d: {"stiffness": 100 * d.torque},
    "encoder_offset": lambda d: {"offset": 0.05 * d.side},
    "time_delay": lambda d: {"delay": 0.01},
    "torque_lag": lambda d: {"time_constant": 0.01},
    "payload": lambda d: d.body(0.06, 0.08),
    "link_inertia": lambda d: d.body(0.06, 0.0),
    "base_tilt": lambda d: dict(zip(("x", "y"), (0.05 * x for x in d.direction(2)), strict=True)),
    "joint_coupling": Draw.coupling,
    "torque_saturation": lambda d: {"limit": d.torque},
    "external_contact": Draw.contact,
    "fluid_drag": lambda d: {"coefficient": 1.0},
    "torque_sign": lambda d: {},
    "channel_swap": lambda d: {"partner": d.partner()},
    "tustin_friction": lambda d: {"level": d.torque, "velocity": 0.25 * d.speed},
    "lugre_friction": Draw.lugre,
    "double_ripple": lambda d: {**d.ripple(6.0, 12.0), "second": 0.6 * d.torque},
    "root_friction": lambda d: {"coefficient": d.torque},
    "friction_step": lambda d: {"change": d.torque, "time": d.within(0.35, 0.65) * d.end},
    "triangular_friction": lambda d: {"amplitude": d.torque, "frequency": 1.5},
    "soft_stop": lambda d: {"stiffness": d.torque, "centre": d.middle, "free": 0.25 * d.travel},
    "root_load_friction": lambda d: {"coefficient": 1.0},
    "torque_in_time": lambda d: {"amplitude": d.torque, "frequency": d.within(0.6, 1.4), "phase": d.turn},
    "velocity_wave": lambda d: {"amplitude": d.torque, "velocity": 0.25 * d.speed},
    "skewed_friction": lambda d: {"coefficient": d.torque / d.speed, "centre": d.middle},
    "load_wave": lambda d: {"amplitude": d.torque, "torque": 0.5 * d.torque},
    "crossed_torque": lambda d: {"partner": d.partner(), "amplitude": d.torque, "frequency": 3.0},
}

SHAPE = tuple(  # parameters independent of the size of the fault
    "velocity distance frequency phase rest centre start end time free torque partner".split()
)


def draw(effect: str, scene: Scene, joint: str, rng: np.random.Generator) -> Fault:
    """Draw a fault of arbitrary size at a joint or of the whole robot."""
    values = LAWS[effect](Draw(scene, scene.body.joints.index(joint), rng))
    return Fault(effect, None if effect in GLOBAL else joint, values)


def scaled(fault: Fault, factor: float) -> Fault:
    """Scale a fault by a factor."""
    fixed = SHAPE if fault.effect != "friction_drift" else (*SHAPE, "time_constant")
    if fault.effect == "joint_elasticity":
        factor = 1 / factor
    values: dict[str, Any] = {key: x if key in fixed else factor * float(x) for key, x in fault.parameters.items()}
    return Fault(fault.effect, fault.joint, values)
