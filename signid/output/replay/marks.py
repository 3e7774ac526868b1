"""Marks of findings: a ring at a joint, a body or an arrow, with a label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import floor, isfinite, log10
from typing import Any

import numpy as np

from ...effects.base import BodyLaw
from ...effects.naming import law_place
from ...robot.dynamics import joint_of_row, own_row
from ...types import TWO_SIDED, Coefficient, Law, Robot
from .found import ReplayFinding
from .poses import axis

DENSITY = 3000.0  # density at which a payload is drawn [kg/m3]
FAR = 1.5  # distance over reach up to which a centre of mass is drawn at its place
MOST = 5  # maximum number of parameters in a label


@dataclass(frozen=True)
class Mark:
    """A finding, located in the frame of a body of the model (0: world)."""

    kind: str  # joint, body, force, tilt or robot
    body: int
    title: str
    lines: tuple[str, ...]
    cause: bool
    point: tuple[float, ...]  # (3,) [m]
    along: tuple[float, ...]  # (3,) axis [1], force [N] in the world, or rotation of gravity [rad]
    size: float = 0.0  # radius of a body [m]
    time: tuple[float, float] | None = None  # start and end [s]

    def document(self) -> dict[str, Any]:
        """The mark as JSON for the page."""
        return asdict(self)


def marks(robot: Robot, findings: Sequence[ReplayFinding], reach: float) -> list[Mark]:
    """Place a mark for each finding, causes first.

    Args:
        robot: robot of the extended simulation.
        findings: findings of a diagnosis.
        reach: reach of the robot [m].
    """
    found = [_mark(robot, finding, reach) for finding in findings]
    return sorted(found, key=lambda mark: not mark.cause)


def _mark(robot: Robot, finding: ReplayFinding, reach: float) -> Mark:
    law = finding.law
    joint, values = law_place(law, robot)
    where = f" of {joint}" + (f" and {values['partner']}" if "partner" in values else "")
    tip = law.effect.scope == "tip"
    title = f"{law.effect.name.replace('_', ' ')}{'' if joint is None or tip else where}"
    words = (title, _numbers(robot, finding), finding.cause)
    if {"force_x", "force_y", "force_z"} <= law.parameters.keys():
        end = len(robot.joints) - 1
        body = joint_of_row(robot.model, own_row(robot, end))
        force = _vector(law.parameters, "force")
        time = (law.parameters["start"], law.parameters["end"])
        return Mark("force", body, *words, _tuple(robot.model.inertias[body].lever), _tuple(-force), time=time)
    if isinstance(law.effect, BodyLaw) and "first_moment_x" in law.parameters:
        return _body(robot, law, words, reach)
    if law.effect.name == "base_tilt":
        turn = [law.parameters["x"], law.parameters["y"], 0.0]
        return Mark("tilt", 0, *words, (0.0, 0.0, 0.0), _tuple(np.array(turn)))
    if joint is None:
        return Mark("robot", 0, *words, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    body, along, _ = axis(robot, law.joints[0])
    return Mark("joint", body, *words, (0.0, 0.0, 0.0), _tuple(along))


def _body(robot: Robot, law: Law, words: tuple[str, tuple[str, ...], bool], reach: float) -> Mark:
    """A ball of the mass at its centre; if that is too far away, at the centre of the link."""
    body, along, _ = axis(robot, law.joints[0])
    title, lines, cause = words
    mass, moment = law.parameters["mass"], _vector(law.parameters, "first_moment")
    centre = moment / mass if mass else np.full(3, np.inf)
    if np.linalg.norm(centre) < FAR * reach:
        where = ", ".join(f"{1000 * x:z.0f}" for x in centre)
        lines = (lines[0], f"centre of mass at {where} mm in the joint frame", lines[-1])
    else:
        centre = robot.model.inertias[body].lever
    radius = float(np.cbrt(3 * abs(mass) / (4 * np.pi * DENSITY)))
    return Mark("body", body, title, lines, cause, _tuple(centre), _tuple(along), min(radius, reach / 4))


def _numbers(robot: Robot, finding: ReplayFinding) -> tuple[str, ...]:
    """The first parameters with their 95 % intervals, and the probability."""
    law, shown = finding.law, list[str]()
    single = len(law.joints) == 1
    for key in [key for key in law.parameters if key not in law.effect.optional][:MOST]:
        kind, value, std = law.effect.parameters[key], law.parameters[key], finding.std.get(key)
        prismatic = single and bool(robot.prismatic[law.joints[0]])
        unit = kind.unit_at(prismatic) if isinstance(kind, Coefficient) or single else kind.unit
        half = TWO_SIDED * std if std is not None and isfinite(std) else 0.0
        if shown and abs(value) < half:
            continue  # consistent with zero
        shown.append(f"{key.replace('_', ' ')} {_figure(value, half)}{'' if unit == '1' else f' {unit}'}")
    sure = ">0.999" if finding.probability > 0.999 else f"{finding.probability:.3f}"
    return (*shown, f"probability {sure}")


def _figure(value: float, half: float) -> str:
    """Format a value and the half-width of its interval to two digits of the latter, or three digits if it is 0."""
    if half <= 0:
        return f"{value:.3g}"
    places = max(0, 1 - floor(log10(half)))
    return f"{value:.{places}f} ± {half:.{places}f}" if places < 7 else f"{value:.3g} ± {half:.2g}"


def _vector(numbers: Mapping[str, float], key: str) -> Any:
    return np.array([numbers[f"{key}_{axis}"] for axis in "xyz"])


def _tuple(vector: Any) -> tuple[float, ...]:
    return tuple(float(x) for x in vector)
