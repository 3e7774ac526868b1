"""Vocabulary of planted faults, shared by all plants.

Effects and parameters have signid's names; foreign laws have no counterpart in signid.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

BODY = ("mass", "first_moment_x", "first_moment_y", "first_moment_z")  # [kg], [kg.m] about the joint's frame
INERTIA = ("inertia_xx", "inertia_xy", "inertia_yy", "inertia_xz", "inertia_yz", "inertia_zz")  # [kg.m2], all or none

EFFECTS: Mapping[str, tuple[str, ...]] = {
    "viscous_friction": ("coefficient",),
    "coulomb_friction": ("level",),
    "asymmetric_friction": ("viscous_positive", "viscous_negative", "coulomb_positive", "coulomb_negative"),
    "stribeck_friction": ("level", "velocity"),
    "quadratic_friction": ("coefficient",),
    "load_friction": ("coefficient",),
    "presliding_friction": ("level", "distance"),
    "position_friction": ("amplitude", "frequency", "phase"),
    "friction_drift": ("change", "time_constant"),
    "armature": ("inertia",),
    "torque_offset": ("offset",),
    "spring": ("stiffness", "rest"),
    "cable_torque": ("cubic", "centre"),
    "counterbalance": ("amplitude", "phase"),
    "torque_gain": ("error",),
    "torque_ripple": ("amplitude", "frequency", "phase"),
    "backlash": ("gap",),
    "joint_elasticity": ("stiffness",),
    "encoder_offset": ("offset",),
    "time_delay": ("delay",),
    "torque_lag": ("time_constant",),
    "payload": BODY,
    "link_inertia": BODY,
    "base_tilt": ("x", "y"),
    "joint_coupling": ("partner", "inertia", "viscous", "coulomb"),
    "torque_saturation": ("limit",),
    "external_contact": ("force_x", "force_y", "force_z", "start", "end"),
    "fluid_drag": ("coefficient",),
    "torque_sign": (),
    "channel_swap": ("partner",),
}

FOREIGN: Mapping[str, tuple[str, ...]] = {  # not among signid's effects; laws in torques.py
    "tustin_friction": ("level", "velocity"),
    "lugre_friction": ("level", "static", "velocity", "stiffness", "damping"),
    "double_ripple": ("amplitude", "second", "frequency", "phase"),
    "root_friction": ("coefficient",),
    "friction_step": ("change", "time"),
    "triangular_friction": ("amplitude", "frequency"),
    "soft_stop": ("stiffness", "centre", "free"),
    "root_load_friction": ("coefficient",),
    "torque_in_time": ("amplitude", "frequency", "phase"),
    "velocity_wave": ("amplitude", "velocity"),
    "skewed_friction": ("coefficient", "centre"),
    "load_wave": ("amplitude", "torque"),
    "crossed_torque": ("partner", "amplitude", "frequency"),
}

GLOBAL = ("base_tilt", "external_contact", "fluid_drag")  # effects of the whole robot; joint is None
ANY = ("payload", "time_delay", "torque_lag")  # effects of one joint or link; None: last link, or all joints


@dataclass(frozen=True)
class Fault:
    """One planted fault; parameters in SI units, `partner` is a joint's name."""

    effect: str
    joint: str | None
    parameters: Mapping[str, float | str]

    def __post_init__(self) -> None:
        """Validate effect, parameters and joint.

        Raises:
            ValueError: for an unknown effect, a missing or surplus parameter, or a missing or surplus joint.
        """
        wanted = {**EFFECTS, **FOREIGN}.get(self.effect)
        if wanted is None:
            raise ValueError(f"unknown effect {self.effect!r}; known are {', '.join((*EFFECTS, *FOREIGN))}")
        given, inertia = set(self.parameters), set(INERTIA if wanted is BODY else ())
        if given != set(wanted) and given != set(wanted) | inertia:
            raise ValueError(f"{self.effect} takes {', '.join(wanted) or 'no parameters'}, not {', '.join(given)}")
        if self.effect not in ANY and (self.joint is None) != (self.effect in GLOBAL):
            raise ValueError(f"{self.effect} {'takes no joint' if self.joint else 'needs a joint'}")
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    @property
    def numbers(self) -> dict[str, float]:
        """Numerical parameters."""
        return {key: float(value) for key, value in self.parameters.items() if key != "partner"}

    @property
    def partner(self) -> str:
        """Name of the other joint."""
        return str(self.parameters["partner"])


def check(faults: Iterable[Fault], joints: Sequence[str]) -> None:
    """Validate the joints of faults.

    Raises:
        ValueError: for an unknown joint, or a joint that is its own partner.
    """
    for fault in faults:
        named = [joint for joint in (fault.joint, fault.parameters.get("partner")) if joint is not None]
        for joint in named:
            if joint not in joints:
                raise ValueError(f"{fault.effect} is planted at {joint}, but the joints are {', '.join(joints)}")
        if len(named) != len(set(named)):
            raise ValueError(f"{fault.effect} needs two joints, not {fault.joint} twice")
