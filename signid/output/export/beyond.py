"""What a format can say of a model's laws, and in which words it is told what it cannot say."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from ...errors import shorten
from ...model import Model
from ...types import Array, Law, Robot

MOST = 16  # joints that are named
BODIES = ("payload", "link_inertia")  # laws that inertials hold


@dataclass(frozen=True)
class Exported:
    """The text of a file, and a sentence on each thing that it lacks."""

    text: str
    notes: tuple[str, ...] = ()


def summed(model: Model, effect: str) -> Array:
    """What the laws of an effect with one number come to at each joint, (n,) [the unit of the number]; NaN: no law."""
    total = np.full(len(model.robot.joints), np.nan)
    for law in model.laws:
        if law.effect.name == effect:
            (value,), (joint,) = law.parameters.values(), law.joints
            total[joint] = np.nan_to_num(total[joint]) + value
    return total


def held(model: Model, effects: Iterable[str]) -> list[Law]:
    """The laws of such effects, at the joints where what they come to is not below zero: no drive's file holds that."""
    sums = {effect: summed(model, effect) for effect in effects}
    return [law for law in model.laws if law.effect.name in sums and sums[law.effect.name][law.joints[0]] >= 0]


def lacking(robot: Robot, laws: Iterable[Law], carried: Collection[Law]) -> str:
    """The laws that are not among those carried, as words: `torque_offset of joint_1, joint_2; backlash of joint_3`."""
    where: dict[str, list[str]] = {}
    for law in laws:
        if not any(law is other for other in carried):
            every = law.effect.scope in ("robot", "any") and len(law.joints) == len(robot.joints)
            said = law.effect.meaning(law.parameters)
            name = f"{law.effect.name} ({said})" if said else law.effect.name
            where.setdefault(name, []).extend([] if every else [robot.joints[j] for j in law.joints])
    return "; ".join(f"{name} of {shorten(joints, MOST)}" if joints else name for name, joints in where.items())


def fixed_note(robot: Robot, what: str) -> list[str]:
    """A sentence on the joints that are held fixed although they could move."""
    driven = np.asarray(robot.drive.any(axis=1))
    names = [
        str(name)
        for name, joint in list(zip(robot.model.names, robot.model.joints, strict=True))[1:]
        if not driven[joint.idx_v : joint.idx_v + joint.nv].any()
    ]
    return [f"{shorten(names)} {'is' if len(names) == 1 else 'are'} held fixed in the model: {what}"] if names else []


def remarks(lines: Iterable[str]) -> str:
    """Lines as comments of TOML, YAML or Python."""
    return "".join(f"# {' '.join(line.split())}\n" for line in lines)


def commented(lines: Iterable[str]) -> str:
    """Lines as the text of an XML comment, in which no two hyphens may stand."""
    return "\n".join(lines).replace("--", "- -").replace("--", "- -")
