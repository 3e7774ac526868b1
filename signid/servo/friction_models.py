"""Friction models of drives by their published names: M1 to M6 of BAM, and PACE.

Sources: Duclusaud, Passault, Padois, Ly, Extended friction models for servo actuators, arXiv 2410.08650 (M1 to M6);
Bjelonic et al., Towards bridging the gap: systematic sim-to-real transfer for diverse legged robots, 2025 (PACE).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..servos import Servo
from .search.choice import Candidate

STRIBECK = ("gear_velocity", "gear_level", "gear_exponent")
LOAD = ("gear_load",)
STRIBECK_LOAD = (*LOAD, *STRIBECK, "gear_load_at_rest")
DIRECTIONAL = (*STRIBECK_LOAD, "gear_external", "gear_external_at_rest")
SPEEDS = (0.1, 0.5)  # velocities of the Stribeck decay to start from, over the rms speed of the joint
WEIGHTS = (1.0, 0.3)  # of the external load to start from, over that of the motor [1]
SQUARE = 2.0  # exponent of the decay to start from [1]
AS_FOUND = "identified"  # the drives of the identification itself


class NamedModel(NamedTuple):
    """A friction model: Coulomb and viscous friction, and what it has beside them."""

    name: str
    terms: str
    numbers: tuple[str, ...] = ()  # of a `Servo`, free beside those of M1
    before: str = ""  # model that its fit starts from


MODELS = (
    NamedModel("M1", "Coulomb, viscous"),
    NamedModel("M2", "M1, Stribeck", STRIBECK, "M1"),
    NamedModel("M3", "M1, load", LOAD, "M1"),
    NamedModel("M4", "M3, Stribeck also of the load", STRIBECK_LOAD, "M3"),
    NamedModel("M5", "M4, motor and external load apart", DIRECTIONAL, "M4"),
    NamedModel(
        "M6", "M5, squares of the loads", (*DIRECTIONAL, "gear_quadratic_motor", "gear_quadratic_external"), "M5"
    ),
    NamedModel("PACE", "M1, zero of the encoder in place of the torque offset", ("encoder_offset",), "M1"),
    NamedModel(AS_FOUND, "numbers of the identification"),
)


def starts(
    model: NamedModel, before: Candidate, identified: Candidate, speeds: Mapping[str, float]
) -> Sequence[Candidate]:
    """Drives that the fit of a model starts from.

    before: the fitted drives of `model.before`; identified: those of the identification, where M1 begins; speeds: rms
    by joint [rad/s or m/s].
    """
    if model.name == AS_FOUND:
        return [identified]
    if not model.before:
        return [_without(identified, "load_friction", identified.servos)]
    if "encoder_offset" in model.numbers:
        before = _without(before, "torque_offset", [joint for joint, name in before.free if name == "torque_offset"])
    held = {name for _, name in before.free}
    new = [name for name in model.numbers if name not in held]
    free = [(joint, name) for joint in before.servos for name in new]
    return [
        before.changed({joint: servo.with_(**one[joint]) for joint, servo in before.servos.items()}, free)
        for one in _begun(new, before, identified, speeds)
    ]


def _begun(
    new: Sequence[str], before: Candidate, identified: Candidate, speeds: Mapping[str, float]
) -> Iterator[dict[str, dict[str, float]]]:
    """Numbers by joint of each start; new ones that stay zero get theirs from the fit."""
    joints = before.servos
    if "gear_velocity" in new:
        for share in SPEEDS:
            yield {joint: {"gear_exponent": SQUARE, "gear_velocity": share * speeds[joint]} for joint in joints}
    elif "gear_external" in new:
        for weight in WEIGHTS:
            yield dict.fromkeys(joints, {"gear_external": weight})
        yield {joint: _by_motor(identified.servos[joint]) for joint in joints}
    elif "gear_load" in new:
        yield dict.fromkeys(joints, {"gear_exponent": SQUARE})
    else:
        yield dict.fromkeys(joints, {})


def _by_motor(servo: Servo) -> dict[str, float]:
    """Numbers of an identified drive, whose friction is by the torque of its motor alone."""
    same = {name: getattr(servo, name) for name in ("kp", "kd", "viscous_friction", "armature", "coulomb_friction")}
    return {
        **same,
        "gear_load": servo.load_friction,
        "gear_external": 0.05,
        "gear_level": 0.0,
        "gear_load_at_rest": 0.0,
    }


def _without(candidate: Candidate, number: str, joints: Collection[str]) -> Candidate:
    """Drives without a number at some joints."""
    servos = {joint: candidate.servos[joint].with_(**{number: 0.0}) for joint in joints}
    free = tuple(name for name in candidate.free if name[1] != number)
    return replace(candidate.changed(servos), free=free)
