"""Laws that a format can hold, and notes about those that it cannot."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

import numpy as np

from ...errors import one_line, shorten
from ...model import Model
from ...types import Array, Frozen, Law, Robot

MOST = 16  # maximum number of joints listed
BODIES = ("payload", "link_inertia")  # laws included in inertials


@dataclass(frozen=True)
class Exported(Frozen):
    """The text of a file, and notes on the content that it lacks."""

    text: str
    notes: tuple[str, ...] = ()
    beside: Mapping[str, str] = field(default_factory=dict)  # further texts, by the ends of their files' names
    meshes: Mapping[str, Path] = field(default_factory=dict)  # files to copy, by their path from the folder of the text


def summed(model: Model, effect: str) -> Array:
    """Sum of an effect's single parameter over its laws, (n,) [the unit of the parameter]; NaN: no law."""
    total = np.full(len(model.robot.joints), np.nan)
    for law in model.joint_laws:
        if law.effect.name == effect:
            (value,), (joint,) = law.parameters.values(), law.joints
            total[joint] = np.nan_to_num(total[joint]) + value
    return total


def held(model: Model, effects: Iterable[str]) -> list[Law]:
    """Laws of some effects at joints where their sum is not negative; formats cannot hold negative values."""
    sums = {effect: summed(model, effect) for effect in effects}
    return [law for law in model.joint_laws if law.effect.name in sums and sums[law.effect.name][law.joints[0]] >= 0]


def among(law: Law, laws: Iterable[Law]) -> bool:
    """Whether a law itself, not an equal one, is among some laws."""
    return any(law is other for other in laws)


def beyond(subject: str, model: Model, effects: Iterable[str], whole: Collection[str] = BODIES) -> list[str]:
    """Note on the laws that a format lacks, if it holds some effects unless negative, and others as they are."""
    carried = [*held(model, effects), *(law for law in model.joint_laws if law.effect.name in whole)]
    words = lacking(model.robot, model.joint_laws, carried)
    return [f"{subject} cannot hold {words}"] if words else []


def lacking(robot: Robot, laws: Iterable[Law], carried: Collection[Law]) -> str:
    """Laws that are not among those carried, in words: `torque_offset of joint_1, joint_2; backlash of joint_3`."""
    where: dict[str, list[str]] = {}
    for law in laws:
        if not among(law, carried):
            every = law.effect.scope in ("robot", "any") and len(law.joints) == len(robot.joints)
            said = law.effect.meaning(law.parameters)
            name = f"{law.effect.name} ({said})" if said else law.effect.name
            where.setdefault(name, []).extend([] if every else [robot.joints[j] for j in law.joints])
    return "; ".join(f"{name} of {shorten(joints, MOST)}" if joints else name for name, joints in where.items())


def fixed_note(robot: Robot, consequence: str) -> list[str]:
    """Note on movable joints that the model holds fixed."""
    driven = np.asarray(robot.drive.any(axis=1))
    names = [
        str(name)
        for name, joint in list(zip(robot.model.names, robot.model.joints, strict=True))[1:]
        if not driven[joint.idx_v : joint.idx_v + joint.nv].any()
    ]
    be = "is" if len(names) == 1 else "are"
    return [f"{shorten(names)} {be} held fixed in the model: {consequence}"] if names else []


def remarks(lines: Iterable[str]) -> str:
    """Format lines as comments of TOML, YAML or Python."""
    return "".join(f"# {one_line(line)}\n" for line in lines)


def commented(lines: Iterable[str]) -> str:
    """Format lines as the text of an XML comment, without double hyphens."""
    return "\n".join(lines).replace("--", "- -").replace("--", "- -")


def c_comment(text: str) -> str:
    """Format text as part of a comment of C, which it cannot end."""
    return one_line(text).replace("*/", "* /").replace("/*", "/ *").encode("ascii", "replace").decode()


def model_digest(model: Model) -> str:
    """SHA-256 of the model.json that `model.save` writes."""
    from ..report import to_json

    return sha256(to_json(model.document()).encode()).hexdigest()
