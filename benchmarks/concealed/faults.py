"""Random faults of every kind, the motor torque that they add, and their scaling to a share of the torque."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..plants.bodies import Drives, drive
from ..plants.control import Array, Track, misread
from ..plants.faults import FOREIGN, Fault
from ..plants.laws import LEVELS, MEMORIES, TORQUES, Laws
from ..plants.mujoco_ import simulate
from .scene import DURATION, PERIOD, RATE, Scene, rms

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
        n, torque = len(scene.body.joints), np.zeros_like(scene.bodies)
        laws = Laws([fault], scene.body.joints, [AMPLE] * n, 1 / RATE)
        (q, v, _), load = scene.asked, scene.bodies
        for k, t in enumerate(scene.t):
            added, level = laws.at(t, q[k], v[k], load[k])
            torque[k] = added + (level - AMPLE) * np.sign(v[k])
            laws.advance(v[k])
        return torque
    for names, law in ((RIGID, _rigid), (DRIVES, _driven), (RECORDING, _misread)):
        if effect in names:
            return law(scene, fault)
    own = OTHERS.get(effect)
    if own is None:
        raise ValueError(f"the torque of {effect} requires simulation")
    return own(scene, fault)


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


ATTEMPTS, TURNS, CLOSE, CLOSE_ENOUGH = 6, 8, 0.01, 0.15  # draws, scaling steps, tolerances of the size [1]
PUSH = 2.0  # torque of a contact while it lasts, over the size [1]
NOTHING, HALF = 1e-6, 0.5  # size treated as zero, smallest accepted share of the requested size [1]
TILT, LARGEST_OFFSET = 0.5, 0.3  # upper bounds on base tilt and encoder offset [rad]
LOG = 500.0  # rate of a trial simulation [Hz]
SMOOTH = 25  # half width of the torque average in a trial [rows]


def plant(effect: str, joint: str, size: float, scene: Scene, rng: np.random.Generator) -> tuple[Fault, float]:
    """Draw a fault of an effect and scale it to a size; return it with the size reached.

    Raises:
        ValueError: when no draw reaches the size.
    """
    for _ in range(ATTEMPTS):
        fault = draw(effect, scene, joint, rng)
        if effect in UNSIZED:
            return fault, float(measure(scene, fault))
        try:
            found = _sized(scene, fault, size * (PUSH if effect == "external_contact" else 1.0))
        except (ValueError, ArithmeticError):
            continue
        if found is not None:
            return found
    raise ValueError(f"no {effect} at {joint} reaches {size:.0%} of the torque")


def measure(scene: Scene, fault: Fault) -> float:
    """Rms torque of a fault over that of the joint or of all joints; for a contact, while it lasts."""
    torque, j = extra(scene, fault), 0 if fault.joint is None else scene.body.joints.index(fault.joint)
    if fault.effect == "external_contact":
        torque = torque[(scene.t >= fault.numbers["start"]) & (scene.t <= fault.numbers["end"])]
    if fault.effect in SPREAD:
        return float(np.sqrt(np.sum(rms(torque) ** 2) / np.sum(rms(scene.bodies) ** 2)))
    share = rms(torque) / scene.scale
    if fault.effect == "joint_coupling":
        return float(share.max())
    return float(share[j])


def _sized(scene: Scene, fault: Fault, size: float) -> tuple[Fault, float] | None:
    if fault.effect == "torque_saturation":
        return _clipped(scene, fault, size)
    size_of: Callable[[Scene, Fault], float] = _tried if fault.effect == "backlash" else measure
    if fault.effect == "backlash":
        fault = scaled(fault, size)
    turns, close = (3, CLOSE_ENOUGH) if fault.effect == "backlash" else (TURNS, CLOSE)
    found = size_of(scene, fault)
    for _ in range(turns):
        if found < NOTHING:
            return None
        if abs(found / size - 1) < close:
            break
        fault = scaled(fault, float(np.clip(size / max(found, 1e-12), 1e-4, 1e4)))
        found = size_of(scene, fault)
    if fault.effect == "encoder_offset" and abs(fault.numbers["offset"]) > LARGEST_OFFSET:
        fault = scaled(fault, LARGEST_OFFSET / abs(fault.numbers["offset"]))
        found = size_of(scene, fault)
    if fault.effect == "base_tilt" and np.hypot(fault.numbers["x"], fault.numbers["y"]) > TILT:
        return None
    return (fault, found) if found > HALF * size else None


def _clipped(scene: Scene, fault: Fault, size: float) -> tuple[Fault, float] | None:
    """Bisect the limit of a torque saturation."""
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = (low + high) / 2
        limit = middle * float(np.abs(scene.whole[:, scene.body.joints.index(str(fault.joint))]).max())
        trial = Fault(fault.effect, fault.joint, {"limit": limit})
        low, high = (low, middle) if (found := measure(scene, trial)) < size else (middle, high)
    return (trial, found) if found > (1 - CLOSE) * size else None


def _tried(scene: Scene, fault: Fault) -> float:
    """Size of a fault by simulation: simulated torque minus inverse dynamics of the simulated motion."""
    j = scene.body.joints.index(str(fault.joint))
    drives, motion = scene.rotors, scene.motions[0]
    track = simulate(scene.body, drives, motion, PERIOD, LOG, [fault])
    v = np.gradient(track.q, track.t, axis=0)
    a = np.gradient(v, track.t, axis=0)
    rest = (track.tau - scene.inverse(track.q, v, a))[:, j]
    window = np.hanning(2 * SMOOTH + 1)
    rest = np.convolve(rest, window / window.sum(), "valid")
    return float(rms(rest) / scene.scale[j])
