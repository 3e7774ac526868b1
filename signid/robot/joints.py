"""Joints of a robot, by name or number, held fixed, or as a configuration; and gravity at its root link."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from itertools import takewhile
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, OptionError, RobotError, shorten
from ..types import Actuators, Array, Robot

if TYPE_CHECKING:
    import pinocchio as pin

MAX_JOINT_DIGITS = 10  # of numbers of joints, fewer than these
_JOINT_ARRAYS = ("prismatic", "lower", "upper", "velocity_limit", "effort_limit")  # arrays (n,) of a robot
MAX_GRAVITY = 1000.0  # largest magnitude [m/s2]: forty times that on Jupiter's surface
SEPARATOR = re.compile(r"([_\-./ ])")
SIDE_WORDS = "left right l r fl fr rl rr hl hr lf rf lh rh bl br lb rb front rear hind back".split()
FINGER_WORDS = "index middle ring pinky little".split()
SIDE_PREFIX = re.compile(r"^[LR](?=[A-Z][a-z])")  # LHipPitch, RHipPitch
LIMB_WORD = re.compile(r"^(finger|leg|arm|toe)(\d*)$")  # finger2, or finger and 2


def find_joint(joint: str | int, robot: Robot) -> int:
    """Index of a joint of a robot, given by its name or, if no joint has that name, by its number.

    Raises:
        RobotError: no moving joint has that name or number.
    """
    text = str(joint)
    if text in robot.joints:
        return robot.index(text)
    if text.isascii() and text.isdigit() and len(text) < MAX_JOINT_DIGITS and int(text) in robot.numbers:
        return robot.numbers.index(int(text))
    close = get_close_matches(text, robot.joints, n=3, cutoff=0.6)
    advice = f"did you mean {' or '.join(close)}?" if close else f"choose from {shorten(robot.joints)}"
    raise RobotError(f"{robot.name} has no joint {text!r} that moves by itself; {advice}")


def hold(robot: Robot, positions: Mapping[str, float]) -> Robot:
    """Hold joints (by name or number) at given positions [rad or m]; their mimic joints follow.

    Raises:
        RobotError: unknown or repeated joint, position that is not finite, or no joint left to move.
    """
    if not positions:
        return robot
    held: dict[int, float] = {}
    for joint, value in positions.items():
        i = find_joint(joint, robot)
        if i in held:
            raise RobotError(f"joint {robot.joints[i]} of {robot.name} has two positions to be held at; give one")
        try:
            number = nan if isinstance(value, bool | str) else float(value)
        except (TypeError, ValueError, OverflowError):
            number = nan
        if not isfinite(number):
            raise RobotError(f"joint {robot.joints[i]} cannot be held at {value!r}; give a finite number in rad or m")
        held[i] = number
    keep = [i for i in range(len(robot.joints)) if i not in held]
    if not keep:
        raise RobotError(f"every joint of {robot.name} would be held fixed; leave at least one to move")
    fixed = [f"{robot.joints[i]} at {held[i]:.6g} {'m' if robot.prismatic[i] else 'rad'}" for i in sorted(held)]
    return replace(
        robot,
        joints=tuple(robot.joints[i] for i in keep),
        numbers=tuple(robot.numbers[i] for i in keep),
        drive=robot.drive[:, keep],
        rest=robot.rest + sum((robot.drive[:, i] * value for i, value in held.items()), np.zeros(len(robot.rest))),
        actuators=Actuators(*(getattr(robot.actuators, item.name)[keep] for item in fields(Actuators))),
        servo={joint: stated for joint, stated in robot.servo.items() if robot.index(joint) not in held},
        springs={joint: stated for joint, stated in robot.springs.items() if robot.index(joint) not in held},
        registers={key: stated for key, stated in robot.registers.items() if robot.index(key[1]) not in held},
        notes=(*robot.notes, f"held fixed: {shorten(fixed)}"),
        **{key: getattr(robot, key)[keep] for key in _JOINT_ARRAYS},
    )


def resting(robot: Robot, but: Collection[str] = ()) -> dict[str, float]:
    """Rest positions [rad or m] of all joints except `but`: zero, or the nearest position within the limits."""
    rest = np.clip(0.0, robot.lower, robot.upper)
    return {joint: float(rest[i]) for i, joint in enumerate(robot.joints) if joint not in but}


def weld(model: pin.Model, held: Sequence[int], configuration: Array) -> pin.Model:
    """Model in which the bodies of held joints are merged with their parents; the names of links are lost.

    `held` are indices of joints of the model; configuration: (nq,) where they are held [rad, m or 1].
    """
    import pinocchio as pin

    named = pin.Model(model)
    for i, frame in enumerate(named.frames):
        if frame.type == pin.FrameType.BODY:
            frame.name = f"body {i}"  # Pinocchio rejects links with the name of a joint
    return pin.buildReducedModel(named, list(held), configuration)


def configuration(robot: Robot, q: Array) -> Array:
    """Compute configurations (N, nq) [rad, m or 1] of the model at joint positions q (N, n) [rad or m], or one (nq,).

    Mimic and held joints are included, continuous joints are cos and sin.

    Raises:
        InputError: the last axis of q does not match the number of joints.
    """
    import pinocchio as pin

    q = np.asarray(q, float)
    n = len(robot.joints)
    if q.ndim == 0 or q.shape[-1] != n:
        raise InputError(f"positions of {robot.name} have shape {q.shape}; give one column for each of its {n} joints")
    position = q @ robot.drive.T + robot.rest  # (N, nv)
    result = np.empty((*q.shape[:-1], robot.model.nq))
    result[...] = pin.neutral(robot.model)
    for joint in list(robot.model.joints)[1:]:
        if joint.nq == 2 and joint.nv == 1:
            result[..., joint.idx_q] = np.cos(position[..., joint.idx_v])
            result[..., joint.idx_q + 1] = np.sin(position[..., joint.idx_v])
        elif is_plain(joint):
            result[..., joint.idx_q : joint.idx_q + joint.nq] = position[..., joint.idx_v : joint.idx_v + joint.nv]
    return result


def is_plain(joint: Any) -> bool:
    """Whether the configuration of a model joint equals its positions: one axis, or several independent axes."""
    return bool(joint.nq == joint.nv and (joint.nv == 1 or joint.shortname() == "JointModelComposite"))


def with_gravity(robot: Robot, gravity: Sequence[float] | Array | None) -> Robot:
    """Return the robot in a field of gravity (3,) [m/s2], in the frame of its root link; None: unchanged.

    Zero stands for a robot whose recorded torque does not carry its weight.

    Raises:
        OptionError: gravity is not three finite numbers of up to MAX_GRAVITY.
    """
    if gravity is None:
        return robot
    try:
        vector = np.array([float(x) for x in gravity])
    except (TypeError, ValueError, OverflowError):
        vector = np.zeros(0)
    if isinstance(gravity, str) or vector.shape != (3,) or not np.all(np.abs(vector) <= MAX_GRAVITY):
        raise OptionError(
            f"gravity is {gravity!r}; give three numbers up to {MAX_GRAVITY:.0f} m/s2, in the frame of the root link, "
            f"such as 0,0,-9.81"
        )
    if np.array_equal(vector, robot.model.gravity.linear):
        return robot
    model = robot.model.copy()
    model.gravity.linear = vector
    note = f"gravity is {gravity_text(vector)} m/s2 in the frame of {root_link(robot)}"
    return replace(robot, model=model, notes=(*(x for x in robot.notes if not x.startswith("gravity is ")), note))


def parse_gravity(text: str) -> tuple[float, ...]:
    """Parse gravity on the command line, X,Y,Z [m/s2].

    Raises:
        OptionError: the text is not three finite numbers.
    """
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3 or not all(isfinite(x) and abs(x) <= MAX_GRAVITY for x in numbers):
        raise OptionError(
            f"--gravity {text!r} is not a vector; write X,Y,Z: three numbers up to {MAX_GRAVITY:.0f} m/s2, in the "
            f"frame of the root link, such as 0,-9.81,0"
        )
    return numbers


def gravity_text(gravity: Sequence[float] | Array) -> str:
    """Write gravity: (3,) [m/s2] as in a sentence: (0, -9.81, 0)."""
    return f"({', '.join(f'{float(x) + 0.0:.4g}' for x in gravity)})"


def root_link(robot: Robot) -> str:
    """Name of the link in whose frame gravity is stated."""
    import pinocchio as pin

    bodies = (x.name for x in robot.model.frames if x.type == pin.FrameType.BODY and x.parentJoint == 0)
    return str(next(bodies, "the base"))


def is_weightless(model: pin.Model) -> bool:
    """Whether a pin.Model has no gravity."""
    return not np.any(model.gravity.linear)


def similar_joints(joints: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Joints whose names differ in a side, a finger or the number of a limb only: left_hip and right_hip; two or more.

    Numbers of joints in a chain (joint_1, joint_2) are no kind.
    """
    kinds: dict[str, list[str]] = {}
    for joint in joints:
        words, limb, out = SEPARATOR.split(SIDE_PREFIX.sub("*", joint)), "", list[str]()
        for k, word in enumerate(words):
            low, match = word.lower(), LIMB_WORD.match(word.lower())
            numbered = limb and word.isdigit() and k + 1 < len(words)  # not the last word: l_arm_1 is a chain
            if low in SIDE_WORDS or low in FINGER_WORDS or numbered:
                out.append("*")
            else:
                out.append(f"{match[1]}*" if match and match[2] and len(words) > 1 else word)
            limb = limb if SEPARATOR.match(word) else match[1] if match and not match[2] else ""
        kinds.setdefault("".join(out), []).append(joint)
    return tuple(tuple(members) for members in kinds.values() if len(members) > 1)


def name_pattern(members: Sequence[str], joints: Sequence[str]) -> str:
    """Regular expression that matches the whole names of some of the joints and of no other: `.*_hip_joint`."""
    if len(members) == 1:
        return _escaped(members[0])
    words = [SEPARATOR.split(name) for name in members]
    first = _common_prefix(words)
    last = _common_prefix([name_words[len(first) :][::-1] for name_words in words])[::-1]
    pattern = f"{_escaped(''.join(first))}.*{_escaped(''.join(last))}"
    if [joint for joint in joints if re.fullmatch(pattern, joint)] == list(members):
        return pattern
    return "|".join(map(_escaped, members))


def _escaped(text: str) -> str:
    return re.escape(text).replace(r"\-", "-")


def _common_prefix(words: Sequence[Sequence[str]]) -> list[str]:
    """Words with which all sequences begin."""
    return [column[0] for column in takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))]
