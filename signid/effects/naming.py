"""Laws by the names of joints: where a law stands as files and the command line write it, and back."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from ..errors import OptionError
from ..robot.joints import find
from ..types import Law, Robot, Shape
from . import EFFECTS
from .law import places


def place(effect: Any, robot: Robot, joint: str | None, partner: str | None = None) -> tuple[int, ...]:
    """The joints of a law: that of one joint, that and its partner's, or all of them.

    Raises:
        OptionError: a joint is missing, or is one too many for the effect.
        RobotError: there is no such joint.
    """
    n, scope = len(robot.joints), effect.scope
    if (partner is None) == (scope == "pair"):
        wanted = "needs partner=JOINT" if scope == "pair" else "has no partner"
        raise OptionError(f"effect {effect.name!r} {wanted}; write {written(effect)}")
    if joint is None and scope in ("joint", "pair", "link") and n != 1 + (scope == "pair"):
        raise OptionError(f"effect {effect.name!r} acts at a joint and none is named; write {written(effect)}")
    if joint is not None and scope == "robot":
        raise OptionError(f"effect {effect.name!r} acts on the whole robot; write it without @{joint}")
    named = [name for name in (joint, partner) if name is not None]
    found = tuple(find(name, robot.joints, robot.numbers, robot.name) for name in named)
    if joint is None:
        return places(effect, n)[0]
    if len(set(found)) < len(found):
        raise OptionError(f"effect {effect.name!r} couples two joints; give a partner other than {joint}")
    if scope == "tip" and found != (n - 1,):
        raise OptionError(f"effect {effect.name!r} acts on the last link, that of {robot.joints[-1]}, not {joint}")
    return found


def placed(law: Law, robot: Robot) -> tuple[str | None, dict[str, str | float]]:
    """The joint that a law names, None where it acts on the whole robot, and its parameters with the partner.

    Where `place` is given both, the same joints come back.
    """
    values: dict[str, str | float] = {key: float(value) for key, value in law.parameters.items()}
    if law.effect.scope in ("robot", "any") and law.joints == tuple(range(len(robot.joints))):
        return None, values
    if law.effect.scope == "pair":
        values = {"partner": robot.joints[law.joints[1]], **values}
    return robot.joints[law.joints[0]], values


def spoken(law: Law, robot: Robot) -> str:
    """A law by its effect and where it acts: "spring of joint_2", "base_tilt"."""
    joint, values = placed(law, robot)
    if joint is None or law.effect.scope == "tip":
        return str(law.effect.name)
    return f"{law.effect.name} of {joint}" + (f" and {values['partner']}" if "partner" in values else "")


def law_at(effect: Any, robot: Robot, joint: str | None, parameters: Mapping[str, str | float]) -> Law:
    """The law of an effect at a joint, with parameters as files carry them.

    Raises:
        OptionError: a parameter is missing, unknown or no number, or the joint does not fit the effect.
        RobotError: there is no such joint.
    """
    partner = parameters.get("partner")
    joints = place(effect, robot, joint, None if partner is None else str(partner))
    values = {key: value for key, value in parameters.items() if key != "partner"}
    wanted = [key for key in effect.parameters if key not in effect.optional or key in values]
    if unknown := [key for key in values if key not in effect.parameters]:
        raise OptionError(f"effect {effect.name!r} has no parameter {unknown[0]!r}; write {written(effect)}")
    if missing := [key for key in wanted if key not in values]:
        raise OptionError(f"effect {effect.name!r} needs {', '.join(missing)}; write {written(effect)}")
    try:
        numbers = {key: float(values[key]) for key in wanted}
    except ValueError:
        raise OptionError(
            f"effect {effect.name!r} has a parameter that is no number; write {written(effect)}"
        ) from None
    if absurd := [key for key, value in numbers.items() if not isfinite(value)]:
        raise OptionError(f"effect {effect.name!r}: {absurd[0]} is {numbers[absurd[0]]}; write {written(effect)}")
    return Law(effect, joints, numbers)


def parse_law(text: str, robot: Robot, partial: bool = False) -> Law:
    """The law that a text such as `spring@elbow:stiffness=30,rest=0.2` states.

    Args:
        text: EFFECT[@JOINT][:key=value,...]; an effect that couples two joints also has partner=JOINT. Without any
            key the usual values are meant; with some, coefficients that are left out are zero.
        robot: gives the joints.
        partial: whether parameters may be left open.

    Raises:
        OptionError: there is no such effect, the joint does not fit it, or a parameter is missing, unknown or absurd.
        RobotError: there is no such joint.
    """
    head, colon, tail = text.strip().partition(":")
    name, at, joint = (part.strip() for part in head.partition("@"))
    effect = EFFECTS[name]
    pairs = [[part.strip() for part in pair.partition("=")] for pair in tail.split(",")] if colon else []
    given = {key: value for key, _, value in pairs}
    if not all(key and value for key, _, value in pairs) or len(given) < len(pairs) or bool(at) > bool(joint):
        raise OptionError(f"{text!r} cannot be read; write {written(effect)}")
    if partial and set(given) <= {"partner", *effect.parameters}:
        law = _possible(law_at(effect, robot, joint or None, {**effect.example, **given}))
        return Law(effect, law.joints, {key: value for key, value in law.parameters.items() if key in given})
    left_out = effect.example if not set(given) - {"partner"} else dict.fromkeys(effect.linear(), 0.0)
    left_out = {key: value for key, value in left_out.items() if key not in effect.optional}
    return _possible(law_at(effect, robot, joint or None, {**left_out, **given}))


def written(effect: Any) -> str:
    """How a law of an effect is written on the command line, with usual values."""
    keys = {"partner": "JOINT"} if effect.scope == "pair" else {}
    values = {**keys, **{key: value for key, value in effect.example.items() if key not in effect.optional}}
    pairs = ",".join(f"{key}={value}" for key, value in values.items())
    where = {"robot": "", "any": "[@JOINT]", "tip": ""}.get(effect.scope, "@JOINT")
    return f"{effect.name}{where}{':' if pairs else ''}{pairs}"


def _possible(law: Law) -> Law:
    """The law, if nothing that must be positive is negative, and no shape but a moment is zero."""
    for key, value in law.parameters.items():
        kind = law.effect.parameters[key]
        if isinstance(kind, Shape):
            low = value <= 0 and bool(kind.grid or kind.unit != "s")
        else:
            low = value < 0 and kind.positive
        if low:
            raise OptionError(f"effect {law.effect.name!r}: {key} is {value:g}; give a positive number")
    return law
