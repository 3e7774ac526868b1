"""Laws in terms of joint names, as in files and on the command line."""

from __future__ import annotations

from collections.abc import Mapping

from ..errors import OptionError
from ..robot.joints import find_joint
from ..types import Law, Robot, Shape
from . import EFFECTS
from .base import Effect
from .law import candidate_places

MAX_PARAMETER = 9e9  # magnitude of a parameter [its unit]; times since 1970 are 1.7e9 s


def place(effect: Effect, robot: Robot, joint: str | None, partner: str | None = None) -> tuple[int, ...]:
    """Joint indices of a law: one joint, a joint and its partner, or all joints.

    Raises:
        OptionError: missing or superfluous joint.
    """
    n, scope = len(robot.joints), effect.scope
    if (partner is None) == (scope == "pair"):
        fault = "needs partner=JOINT" if scope == "pair" else "has no partner"
        raise _fault(effect, fault)
    if joint is None and scope in ("joint", "pair", "link") and n != 1 + (scope == "pair"):
        raise _fault(effect, "acts at a joint and none is named")
    if joint is not None and scope == "robot":
        raise OptionError(f"effect {effect.name!r} acts on the whole robot; write it without @{joint}")
    named = [name for name in (joint, partner) if name is not None]
    found = tuple(find_joint(name, robot) for name in named)
    if joint is None:
        return candidate_places(effect, n)[0]
    if len(set(found)) < len(found):
        raise OptionError(f"effect {effect.name!r} couples two joints; give a partner other than {joint}")
    if scope == "tip" and found != (n - 1,):
        raise OptionError(f"effect {effect.name!r} acts on the last link, that of {robot.joints[-1]}, not {joint}")
    return found


def law_place(law: Law, robot: Robot) -> tuple[str | None, dict[str, str | float]]:
    """Joint name of a law (None for the whole robot) and its parameters including the partner; inverse of `place`."""
    values: dict[str, str | float] = {key: float(value) for key, value in law.parameters.items()}
    if law.effect.scope in ("robot", "any") and law.joints == tuple(range(len(robot.joints))):
        return None, values
    if law.effect.scope == "pair":
        values = {"partner": robot.joints[law.joints[1]], **values}
    return robot.joints[law.joints[0]], values


def law_name(law: Law, robot: Robot) -> str:
    """Effect and joints of a law as text: "spring of joint_2", "base_tilt"."""
    joint, values = law_place(law, robot)
    if joint is None or law.effect.scope == "tip":
        return law.effect.name
    return f"{law.effect.name} of {joint}" + (f" and {values['partner']}" if "partner" in values else "")


def law_at(effect: Effect, robot: Robot, joint: str | None, parameters: Mapping[str, str | float]) -> Law:
    """Law of an effect at a joint, with parameters as in files.

    Raises:
        OptionError: missing, unknown or non-numeric parameter, or a joint that does not fit the effect.
    """
    partner = parameters.get("partner")
    joints = place(effect, robot, joint, None if partner is None else str(partner))
    values = {key: value for key, value in parameters.items() if key != "partner"}
    wanted = [key for key in effect.parameters if key not in effect.optional or key in values]
    if unknown := [key for key in values if key not in effect.parameters]:
        raise _fault(effect, f"has no parameter {unknown[0]!r}")
    if missing := [key for key in wanted if key not in values]:
        raise _fault(effect, f"needs {', '.join(missing)}")
    try:
        numbers = {key: float(values[key]) for key in wanted}
    except ValueError:
        raise _fault(effect, "has a parameter that is not a number") from None
    if absurd := [key for key, value in numbers.items() if not abs(value) <= MAX_PARAMETER]:
        fault = f"{absurd[0]} is {numbers[absurd[0]]}, beyond {MAX_PARAMETER:.0e}"
        raise OptionError(f"effect {effect.name!r}: {fault}; write {law_syntax(effect)}")
    return Law(effect, joints, numbers)


def parse_law(text: str, robot: Robot, partial: bool = False) -> Law:
    """Parse the text of a law, such as `spring@elbow:stiffness=30,rest=0.2`.

    The text is EFFECT[@JOINT][:key=value,...]; an effect that couples two joints also has partner=JOINT. Without keys,
    all parameters have typical values; with some keys, omitted coefficients are zero, or absent from a partial law.

    Raises:
        OptionError: unknown effect, a joint that does not fit it, or a missing, unknown or invalid parameter.
    """
    head, colon, tail = text.strip().partition(":")
    name, at, joint = (part.strip() for part in head.partition("@"))
    effect = EFFECTS[name]
    pairs = [[part.strip() for part in pair.partition("=")] for pair in tail.split(",")] if colon else []
    given = {key: value for key, _, value in pairs}
    if not all(key and value for key, _, value in pairs) or len(given) < len(pairs) or bool(at) > bool(joint):
        raise OptionError(f"{text!r} cannot be read; write {law_syntax(effect)}")
    if partial and set(given) <= {"partner", *effect.parameters}:
        law = check_signs(law_at(effect, robot, joint or None, {**effect.example, **given}))
        return Law(effect, law.joints, {key: value for key, value in law.parameters.items() if key in given})
    left_out = effect.example if not set(given) - {"partner"} else dict.fromkeys(effect.linear(), 0.0)
    left_out = {key: value for key, value in left_out.items() if key not in effect.optional}
    return check_signs(law_at(effect, robot, joint or None, {**left_out, **given}))


def law_syntax(effect: Effect) -> str:
    """Syntax of an effect on the command line, with typical values."""
    keys = {"partner": "JOINT"} if effect.scope == "pair" else {}
    required = {key: value for key, value in effect.example.items() if key not in effect.optional}
    values = {**keys, **(required or effect.example)}
    pairs = ",".join(f"{key}={value}" for key, value in values.items())
    where = {"robot": "", "any": "[@JOINT]", "tip": ""}.get(effect.scope, "@JOINT")
    return f"{effect.name}{where}{':' if pairs else ''}{pairs}"


def _fault(effect: Effect, fault: str) -> OptionError:
    return OptionError(f"effect {effect.name!r} {fault}; write {law_syntax(effect)}")


def check_signs(law: Law) -> Law:
    """The law, if positive coefficients are not negative and positive shapes are above zero.

    Raises:
        OptionError: a parameter has an impossible sign.
    """
    for key, value in law.parameters.items():
        kind = law.effect.parameters[key]
        if kind.positive and (value <= 0 if isinstance(kind, Shape) else value < 0):
            raise OptionError(f"effect {law.effect.name!r}: {key} is {value:g}; give a positive number")
    return law
