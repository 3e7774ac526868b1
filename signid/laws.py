"""Laws by the names of joints: where a law stands as files and the command line write it, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .effects.law import places
from .errors import OptionError
from .robot.joints import find
from .types import Law, Robot


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
    if joint is None and scope in ("joint", "pair", "link") and n > 1 + (scope == "pair"):
        raise OptionError(f"effect {effect.name!r} acts at a joint and none is named; write {written(effect)}")
    if joint is None or scope == "robot":
        if joint is not None:
            raise OptionError(f"effect {effect.name!r} acts on the whole robot; write it without @{joint}")
        return places(effect, n)[0]
    named = [joint] if partner is None else [joint, partner]
    found = tuple(find(name, robot.joints, robot.numbers, robot.name) for name in named)
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


def law_at(effect: Any, robot: Robot, joint: str | None, parameters: Mapping[str, str | float]) -> Law:
    """The law of an effect at a joint, with parameters as files carry them.

    Raises:
        OptionError: a parameter is missing, unknown or no number, or the joint does not fit the effect.
        RobotError: there is no such joint.
    """
    partner = parameters.get("partner")
    joints = place(effect, robot, joint, None if partner is None else str(partner))
    values = {key: value for key, value in parameters.items() if key != "partner"}
    if set(values) != set(effect.parameters):
        raise OptionError(
            f"effect {effect.name!r} was given {', '.join(values) or 'no parameter'}; write {written(effect)}"
        )
    try:
        return Law(effect, joints, {key: float(values[key]) for key in effect.parameters})
    except ValueError:
        raise OptionError(
            f"effect {effect.name!r} has a parameter that is no number; write {written(effect)}"
        ) from None


def written(effect: Any) -> str:
    """How a law of an effect is written on the command line, with usual values."""
    keys = {"partner": "JOINT"} if effect.scope == "pair" else {}
    pairs = ",".join(f"{key}={value}" for key, value in {**keys, **effect.example}.items())
    where = {"robot": "", "any": "[@JOINT]", "tip": ""}.get(effect.scope, "@JOINT")
    return f"{effect.name}{where}{':' if pairs else ''}{pairs}"
