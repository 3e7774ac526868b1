"""Position servos: the numbers of a drive that follows commanded positions, and recordings of it on a uniform grid.

Torque of a drive at one joint, with e = dead_band(q_des(t - delay) - q), gain g of the firmware relative to its
nominal value, supply voltage V relative to its nominal value, and v_ref = 0 (kd_on "velocity") or the speed of the
command (kd_on "error"):

    effort        tau_m = clip(g kp e + kd (v_ref - v) + tau_ff, -T, T)
    duty          tau_m = V clip(g kp e, -T, T) + kd (v_ref - v)         kd includes the back-EMF
    torque_speed  tau_m = effort, with T (1 - |v|/speed_limit) where the drive pushes along the motion

and tau_m is divided by 1 + droop |tau_m|. The joint obeys

    M a + armature a + bias + offset + viscous_friction v + (coulomb_friction + load_friction |tau_m|) sign v = tau_m

and obeys these laws of `effects` where the model has them: Stribeck, gear and position friction, a spring, backlash,
and an error of the encoder's zero.

Torque off (`on` = 0): tau_m = 0. Source: methods of BAM (Duclusaud et al. 2025), PACE (2025) and Isaac Lab's actuators.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from .errors import shorten
from .frozen import Frozen
from .types import Array

DRIVE_LAWS = ("effort", "duty", "torque_speed")
KD_ON = ("velocity", "error")
# numbers of a drive that are laws of its joint, of the same name
PASSIVE_LAWS = ("armature", "viscous_friction", "coulomb_friction", "torque_offset")
CHOICES: Mapping[str, Sequence[str]] = {"law": DRIVE_LAWS, "kd_on": KD_ON}
MIN_NUMBER, MAX_NUMBER = 1e-9, 1e7  # [unit of the number] that is not zero; of the drives of robots
LIMIT_KEYS = ("effort_limit", "speed_limit", "profile_speed")  # numbers that cannot be zero; infinite: no limit
MAX_DRIVE_DELAY = 10.0  # [s]; the buses of robots need less than 0.3 s


@dataclass(frozen=True)
class Servo:
    """Numbers of the drive of one revolute joint (prismatic joints: N, m in place of N.m, rad)."""

    law: str = "effort"  # one of DRIVE_LAWS
    kd_on: str = "velocity"  # one of KD_ON
    kp: float = 0.0  # [N.m/rad] at the nominal gain of the firmware
    kd: float = 0.0  # [N.m.s/rad] of the drive while on; includes back-EMF
    delay: float = 0.0  # [s] from the command's stamp to its effect
    effort_limit: float = np.inf  # [N.m] at zero speed; stall torque of `duty` and `torque_speed`
    speed_limit: float = np.inf  # [rad/s] speed without torque of `torque_speed`
    dead_band: float = 0.0  # [rad] errors below it give no torque
    profile_speed: float = np.inf  # [rad/s] largest speed at which the firmware moves its own command
    coulomb_friction: float = 0.0  # [N.m]
    viscous_friction: float = 0.0  # [N.m.s/rad] of the joint, drive on or off
    load_friction: float = 0.0  # [1] friction per motor torque; the law `load_friction` is about the torque of the link
    armature: float = 0.0  # [kg.m2]
    torque_offset: float = 0.0  # [N.m]
    droop: float = 0.0  # [1/N.m] torque is divided by 1 + droop |torque|
    stribeck_level: float = 0.0  # [N.m] laws of the joint, which are no numbers of its drive: Stribeck friction
    stribeck_velocity: float = np.inf  # [rad/s]
    position_amplitude: float = 0.0  # [N.m] friction that changes with the position
    position_phase: float = 0.0  # [rad]
    position_frequency: float = 0.0  # [1/rad]
    spring_stiffness: float = 0.0  # [N.m/rad]
    spring_rest: float = 0.0  # [rad]
    backlash_gap: float = 0.0  # [rad] between motor and link
    encoder_offset: float = 0.0  # [rad] measured position minus true one
    gear_exponent: float = 0.0  # [1] of speed in the decay of the friction of a gear; 0: no such friction
    gear_velocity: float = 1.0  # [rad/s] of the decay
    gear_level: float = 0.0  # [N.m] at rest
    gear_load: float = 0.0  # [1] per torque of motor and bodies
    gear_external: float = 1.0  # [1] weight of the bodies there
    gear_load_at_rest: float = 0.0  # [1] the same at rest, in addition
    gear_external_at_rest: float = 1.0  # [1]
    gear_quadratic_motor: float = 0.0  # [1/N.m] at rest, per square of the motor's torque while the bodies drive it
    gear_quadratic_external: float = 0.0  # [1/N.m] at rest, per square of the bodies' torque while the motor drives
    link_encoder: float = 0.0  # [1] 1: the position of the link behind backlash is measured, 0: that of the motor
    kp_register: float | None = None  # firmware gain that `kp` belongs to; a recording's own is relative to it
    # numbers that recordings do not identify, with the value that was stated before, if any [unit of the number]
    not_identifiable: Mapping[str, float | None] = field(default_factory=dict, compare=False)
    combined: tuple[str, ...] = field(default=(), compare=False)  # keys of SUM_PARTS that are identified only whole
    std: Mapping[str, float] = field(default_factory=dict, compare=False)  # of identified numbers [unit of the number]

    @property
    def damping(self) -> float:
        """Damping while the drive is on [N.m.s/rad]: kd + viscous_friction."""
        return self.kd + self.viscous_friction

    @property
    def lag(self) -> float:
        """Delay of a slow ramp [s]: delay + damping / kp."""
        return self.delay + self.damping / self.kp if self.kp > 0 else np.inf

    def with_(self, **numbers: float) -> Servo:
        """The same drive with other numbers, which are no longer marked as not identifiable."""
        marks: dict[str, Any] = {}
        if self.not_identifiable or self.combined or self.std:
            marks["std"] = {name: x for name, x in self.std.items() if name not in numbers}
            marks["not_identifiable"] = {name: x for name, x in self.not_identifiable.items() if name not in numbers}
            marks["combined"] = tuple(name for name in self.combined if not numbers.keys() & set(SUM_PARTS[name]))
        return replace(self, **numbers, **marks)  # type: ignore[arg-type]


class Marks(NamedTuple):
    """Certainty of the numbers of a drive, as `Servo` holds it."""

    not_identifiable: Mapping[str, float | None] = MappingProxyType({})
    combined: tuple[str, ...] = ()
    std: Mapping[str, float] = MappingProxyType({})


MARK_KEYS = Marks._fields
SUM_PARTS: Mapping[str, Sequence[str]] = {"damping": ("kd", "viscous_friction"), "lag": ("delay",)}  # and their parts
# parameters of laws of the joint that are packed beside the numbers of a drive, by effect
JOINT_LAWS: Mapping[str, Mapping[str, str]] = {
    "stribeck_friction": {"level": "stribeck_level", "velocity": "stribeck_velocity"},
    "position_friction": {
        "amplitude": "position_amplitude",
        "phase": "position_phase",
        "frequency": "position_frequency",
    },
    "spring": {"stiffness": "spring_stiffness", "rest": "spring_rest"},
    "backlash": {"gap": "backlash_gap"},
    "encoder_offset": {"offset": "encoder_offset"},
    "gear_friction": {
        "exponent": "gear_exponent",
        "velocity": "gear_velocity",
        "level": "gear_level",
        "coefficient": "gear_load",
        "external": "gear_external",
        "coefficient_at_rest": "gear_load_at_rest",
        "external_at_rest": "gear_external_at_rest",
        "quadratic_motor": "gear_quadratic_motor",
        "quadratic_external": "gear_quadratic_external",
    },
}
JOINT_NUMBERS = tuple(number for numbers in JOINT_LAWS.values() for number in numbers.values())
SERVO_NUMBERS = tuple(
    f.name for f in fields(Servo) if f.name not in {*CHOICES, "kp_register", "link_encoder", *MARK_KEYS, *JOINT_NUMBERS}
)
LOOP_NUMBERS = (*SERVO_NUMBERS, *JOINT_NUMBERS, "link_encoder")  # of the closed loop
NUMBERS_OF_UNIT = {
    "N.m/rad": "kp spring_stiffness",
    "N.m.s/rad": "kd viscous_friction",
    "N.m": "effort_limit coulomb_friction torque_offset stribeck_level position_amplitude gear_level",
    "1/N.m": "droop gear_quadratic_motor gear_quadratic_external",
    "kg.m2": "armature",
    "s": "delay",
    "rad": "dead_band position_phase spring_rest backlash_gap encoder_offset",
    "rad/s": "speed_limit profile_speed stribeck_velocity gear_velocity",
    "1/rad": "position_frequency",
    "1": "load_friction gear_exponent gear_load gear_external gear_load_at_rest gear_external_at_rest link_encoder",
}
UNITS = {number: unit for unit, numbers in NUMBERS_OF_UNIT.items() for number in numbers.split()}
SERVO_UNITS, LOOP_UNITS = ({name: UNITS[name] for name in names} for names in (SERVO_NUMBERS, LOOP_NUMBERS))


@dataclass(frozen=True, eq=False)
class ServoGrid(Frozen):
    """One recording of n servo joints on a uniform grid of N rows; commands are held from row to row.

    The joints are all those of the robot that the recording moves; `driven` says which of them have commands.
    """

    joints: tuple[str, ...]  # n
    rate: float  # [Hz]
    origin: float  # [s] stamp of the first row
    q: Array  # (N, n) [rad or m] measured
    command: Array  # (N, n) [rad or m] q_des in force at each row; measured q where a joint has none
    command_speed: Array | None  # (N, n) [rad/s or m/s]
    feed_forward: Array | None  # (N, n) [N.m or N]
    on: Array  # (N, n) [1] 1 while the drive holds, else 0
    voltage: Array  # (N, n) relative to the nominal supply [1]
    gain: Array  # (n,) firmware gain relative to the nominal one [1]
    driven: tuple[bool, ...]  # (n,)
    path: str = ""
    sha256: str = ""

    @property
    def step(self) -> float:
        """Time between rows [s]."""
        return 1.0 / self.rate

    def __len__(self) -> int:
        return len(self.q)


def number_fault(name: str, value: float, positive: bool = False) -> str:
    """Expectation that a number of a drive misses, "" if it is plausible; `positive`: it cannot be zero."""
    if name == "link_encoder":
        return "" if value in (0.0, 1.0) else "expected 1 or 0"
    if name == "delay":
        return "" if 0 <= value <= MAX_DRIVE_DELAY else f"expected a delay from 0 to {MAX_DRIVE_DELAY:g} s"
    if name == "torque_offset":
        return "" if abs(value) <= MAX_NUMBER else f"expected a number from {-MAX_NUMBER:g} to {MAX_NUMBER:g}"
    if positive and not MIN_NUMBER <= value <= MAX_NUMBER:
        return f"expected a positive number from {MIN_NUMBER:g} to {MAX_NUMBER:g}"
    return "" if 0 <= value <= MAX_NUMBER else f"expected zero or a positive number up to {MAX_NUMBER:g}"


def servos_document(servos: Mapping[str, Servo], joints: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Drives by joint as JSON, in the units of SERVO_UNITS; infinite numbers and unknown registers are left out."""
    return {joint: _document(servos[joint]) for joint in joints if joint in servos}


def _document(servo: Servo) -> dict[str, Any]:
    numbers = {name: float(getattr(servo, name)) for name in SERVO_NUMBERS}
    finite = {name: value for name, value in numbers.items() if np.isfinite(value)}
    register = {} if servo.kp_register is None else {"kp_register": float(servo.kp_register)}
    unknown = {"not_identifiable": dict(servo.not_identifiable)} if servo.not_identifiable else {}
    combined = {"combined": list(servo.combined)} if servo.combined else {}
    std = {"std": dict(servo.std)} if servo.std else {}
    encoder = {"link_encoder": float(servo.link_encoder)} if servo.link_encoder else {}
    return {"law": servo.law, "kd_on": servo.kd_on, **finite, **encoder, **register, **unknown, **combined, **std}


def servos_from(content: Mapping[str, Mapping[str, Any]], joints: Sequence[str]) -> dict[str, Servo]:
    """Drives by joint from JSON, in the order of the joints; inverse of `servos_document`.

    Raises:
        ValueError: unknown joint, law or number, or a number that no drive has; the message says which.
    """
    if strangers := [joint for joint in content if joint not in joints]:
        raise ValueError(f"servos: the robot moves {shorten(joints)}, and no joint {strangers[0]!r}")
    found = {
        joint: Servo(**{**content[joint], "combined": tuple(content[joint].get("combined", ()))})
        for joint in joints
        if joint in content
    }
    for joint, servo in found.items():
        for key, known in CHOICES.items():
            if getattr(servo, key) not in known:
                raise ValueError(f"servos.{joint}.{key}: {getattr(servo, key)!r} is none of {', '.join(known)}")
        for key in ("not_identifiable", "std"):
            if strangers := [name for name in getattr(servo, key) if name not in SERVO_NUMBERS]:
                raise ValueError(f"servos.{joint}.{key}: a drive has no number {strangers[0]!r}")
        if strangers := [name for name in servo.combined if name not in SUM_PARTS]:
            raise ValueError(f"servos.{joint}.combined: {strangers[0]!r} is none of {', '.join(SUM_PARTS)}")
        given = {name: value for name, value in content[joint].items() if name not in (*CHOICES, *MARK_KEYS)}
        for name, value in given.items():
            positive = name in (*LIMIT_KEYS, "kp_register") or (name == "kp" and value > 0)
            if value is not None and (fault := number_fault(name, value, positive)):
                raise ValueError(f"servos.{joint}.{name}: {value:g} {SERVO_UNITS.get(name, '')}; {fault}")
    return found
