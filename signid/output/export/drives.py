"""Position drives in formats of simulators: actuators and joint attributes of MJCF, and the notes on both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import OptionError, shorten
from ...model import Model, with_servos
from ...servos import PASSIVE_LAWS, SERVO_NUMBERS, Servo
from .bodies import words
from .formats import MAX_NAMES

DRIVE_STEP = 1e-4  # time step of an exported MJCF with drives: 1 mrad beside exact roll-outs, also saturated [s]
NOTED_LAG_SHARE = 0.1  # share of the lag that damping has where it is not negligible
_HARD_FRICTION = {"solreffriction": "0.0002 1", "solimpfriction": "0.9999 0.9999 0.001 0.5 2"}  # else it creeps
_COEFFICIENT_FACTOR = 1.0 + 1e-9  # MuJoCo reads a positive coefficient of the speed else as a damping ratio


def with_known_numbers(model: Model, gain: bool) -> tuple[Model, list[str]]:
    """Model without numbers of drives that the recordings did not identify, and notes on them.

    With `gain`, identified numbers have as many digits as two digits of their standard deviations.
    The value that was stated before takes its place, else none: no friction, armature, offset, limit or delay; writers
    leave out the numbers of `left_out`. A drive has no use without its `gain` kp, so that must be known.

    Raises:
        OptionError: the gain of a drive, or its damping, is neither identifiable nor stated.
    """
    for key in ("kp", "kd") if gain else ():
        unknown = [joint for joint, servo in model.servos.items() if key in left_out(servo)]
        if key == "kd":  # a small damping hardly acts, and one whose scale alone is unknown shows in the lag
            drives = {joint: model.servos[joint] for joint in unknown}
            large = {joint for joint, x in drives.items() if x.damping > NOTED_LAG_SHARE * x.lag * x.kp}
            unknown = [joint for joint, x in drives.items() if "kp" in x.not_identifiable or joint in large]
        if unknown:
            be, it = ("is", "it") if len(unknown) == 1 else ("are", "they")
            raise OptionError(
                f"{key} of {shorten(unknown, MAX_NAMES)} {be} not identifiable from the recordings, so {it} cannot be "
                f"exported; state {'it' if key == 'kp' else 'the gain'}: signid identify --known "
                f"kp.{unknown[0]}=20, or {key} below [joint.{unknown[0]}.servo] in actuators.toml"
            )
    servos: dict[str, Servo] = {}
    for joint, servo in model.servos.items():
        known: dict[str, Any] = {
            name: getattr(Servo, name) if x is None else x for name, x in servo.not_identifiable.items()
        }
        for name, std in servo.std.items() if gain else ():  # the digits that intervals carry
            if np.isfinite(std) and std > 0 and name not in servo.not_identifiable:
                known[name] = round(getattr(servo, name), 1 - int(np.floor(np.log10(std))))
        servos[joint] = replace(servo, **known)
    notes = []
    names = SERVO_NUMBERS if gain else PASSIVE_LAWS
    for stated, what in ((True, "as stated before the recordings"), (False, "left out")):
        where: dict[str, list[str]] = {}
        for name in names:
            at = [j for j, x in model.servos.items() if name in x.not_identifiable and (name in left_out(x)) != stated]
            if at:
                where.setdefault(shorten(at, MAX_NAMES), []).append(name)
        if where:
            listed = "; ".join(f"{', '.join(group)} of {at}" for at, group in where.items())
            notes.append(f"not identifiable from the recordings and {what}: {listed}")
    for name, sentence in _LEFT_OUT_NOTES.items():
        if at := [joint for joint, servo in model.servos.items() if name in servo.combined and "kp" in names]:
            notes.append(sentence.format(shorten(at, MAX_NAMES)))
    return with_servos(model, servos, complete=True), notes


_LEFT_OUT_NOTES = {
    "damping": "kd of {} is the damping, kd + viscous_friction, whose parts are not identifiable from the recordings",
    "lag": "delay of {} is one possible value: the lag, delay + damping / kp, is identifiable, and its parts are not",
}


def left_out(servo: Servo) -> frozenset[str]:
    """Numbers of a drive that the recordings do not identify and nothing states."""
    return frozenset(name for name, stated in servo.not_identifiable.items() if stated is None)


def curved(servo: Servo) -> bool:
    """Whether the limit of the torque falls with the speed."""
    return servo.law == "torque_speed" and bool(np.isfinite([servo.effort_limit, servo.speed_limit]).all())


def mjcf_joint(servo: Servo) -> dict[str, str]:
    """Attributes of an MJCF joint that its drive sets, besides armature and dry friction."""
    damping = servo.damping if servo.law == "duty" else servo.viscous_friction
    stated = {"damping": repr(float(damping))} if damping > 0 else {}
    if servo.coulomb_friction > 0:
        stated |= _HARD_FRICTION
    if curved(servo) or (servo.law != "duty" and servo.kd_on == "error" and servo.kd > 0):
        stated |= _range("actuatorfrcrange", servo)
    return stated


def mjcf_actuators(joint: str, servo: Servo) -> list[tuple[str, dict[str, str]]]:
    """Actuators of MJCF for a drive, as tags and attributes; the first takes the position, a second the speed."""
    speed = servo.kd_on == "error" and servo.kd > 0 and not curved(servo)
    kd = 0.0 if speed or servo.law == "duty" else servo.kd
    first = {"name": joint, "joint": joint}
    limit = {} if speed and servo.law != "duty" else _range("forcerange", servo)
    if curved(servo):
        slope = servo.effort_limit / servo.speed_limit
        bias = [-servo.torque_offset, -servo.kp * _COEFFICIENT_FACTOR, slope - kd]
        line = {"name": f"{joint}_torque_speed", "joint": joint, "motorconst": "1", "resistance": repr(1 / slope)}
        return [_general(first, servo, bias, limit), ("dcmotor", {**line, "input": "none"})]
    if servo.torque_offset:
        made = _general(first, servo, [-servo.torque_offset, -servo.kp, -kd], limit)
    else:
        gains = {"kp": repr(float(servo.kp)), **({"kv": repr(float(kd))} if kd > 0 else {})}
        made = ("position", {**first, **gains, **limit, **_delayed(servo)})
    if not speed:
        return [made]
    second = {"name": f"{joint}_speed", "joint": joint, **_delayed(servo)}
    if servo.law == "duty":
        return [made, ("motor", {**second, "gear": repr(float(servo.kd))})]
    return [made, ("velocity", {**second, "kv": repr(float(servo.kd))})]


def mjcf_notes(model: Model) -> list[str]:
    """Requirements and gaps of an MJCF with drives, one sentence each."""
    if not model.servos:
        return []
    delays = [f"{joint} {1e3 * servo.delay:.4g} ms" for joint, servo in model.servos.items()]
    return [
        f"commands are delayed ({shorten(delays, MAX_NAMES)}, and half a step of {1e3 * DRIVE_STEP:g} ms, since "
        f"MuJoCo applies a command that much early), which needs MuJoCo 3.5 or newer; mj_initCtrlHistory sets those "
        f"before the start",
        f"a time step of {1e3 * DRIVE_STEP:g} ms repeats the loop to 1 mrad; at 1 ms, positions differ by half a step "
        f"times the speed, and by some mrad where torque is limited",
    ]


def _general(
    first: Mapping[str, str], servo: Servo, bias: list[float], limit: Mapping[str, str]
) -> tuple[str, dict[str, str]]:
    """Actuator with a constant torque: kp command + bias . (1, position, speed), clipped."""
    gains = {"gainprm": repr(float(servo.kp)), "biastype": "affine", "biasprm": words(bias)}
    return "general", {**first, **gains, **limit, **_delayed(servo)}


def _range(name: str, servo: Servo) -> dict[str, str]:
    """Attribute of the limit, moved by the offset, which is not clipped."""
    if not np.isfinite(servo.effort_limit):
        return {}
    return {name: words([-servo.effort_limit - servo.torque_offset, servo.effort_limit - servo.torque_offset])}


def _delayed(servo: Servo) -> dict[str, str]:
    """Delay of the command; interpolation averages a held command over each step.

    MuJoCo's force at the beginning of a step acts as the mean over the interval around that instant, so that a command
    acts half a step early: the delay is longer by it.
    """
    delay = servo.delay + DRIVE_STEP / 2
    return {"delay": repr(float(delay)), "nsample": str(int(np.ceil(delay / DRIVE_STEP)) + 2), "interp": "linear"}
