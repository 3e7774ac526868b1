"""Bodies of a model in principal axes, as MuJoCo requires, and what writers share: comments, numbers as text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...errors import RobotError, one_line, shorten
from ...estimation.feasible import fit_consistent
from ...model import Model, stated_inertials
from ...regression.base_parameters import build_base
from ...regression.projection import least_squares
from ...types import Array, Estimate, Frozen, Law, Parameters, Robot

FRICTION_LAWS = ("viscous_friction", "coulomb_friction")
MIN_MASS = 1e-12  # minimum mass [kg] and moment [kg.m2] of a moving body; MuJoCo rejects zero
_XML_DECLARATION = re.compile(r"\s*<\?xml\s[^>]*\?>")
_MOMENT_TOLERANCE = 1e-9  # tolerance, relative to the largest principal moment
_EXACT_RATIO = 1e8  # size of a base parameter over its standard deviation


class Principal(NamedTuple):
    """A body about its centre of mass."""

    mass: float  # [kg]
    centre: Array  # (3,) [m]
    moments: Array  # (3,) [kg.m2]
    quaternion: Array  # (4,) w x y z [1]


def about_centre(parameters: Array) -> tuple[float, Array, Array] | None:
    """Mass, centre (3,) [m] and inertia (3, 3) [kg.m2] about it; parameters: (10,) [kg, kg.m, kg.m2] of Pinocchio.

    None unless the parameters are finite, with a mass if there is a first moment.
    """
    mass, first = float(parameters[0]), parameters[1:4]
    if not np.isfinite(parameters).all() or (mass == 0 and np.any(first)):
        return None
    xx, xy, yy, xz, yz, zz = parameters[4:]
    centre = first / mass if mass else np.zeros(3)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return mass, centre, inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))


def principal(parameters: Array) -> Principal | None:
    """A body in its principal axes, with a minimum mass; None if it is not physically consistent.

    parameters: (10,) [kg, kg.m, kg.m2] of Pinocchio.
    """
    body = about_centre(parameters)
    if body is None or body[0] < 0:
        return None
    mass, centre, inertia = body
    moments, axes = np.linalg.eigh(inertia)
    small = _MOMENT_TOLERANCE * abs(moments[2])
    if moments[0] < -small or moments[0] + moments[1] < moments[2] - small:
        return None
    moments = np.maximum(moments, MIN_MASS)
    moments[:2] += max(0.0, moments[2] * (1 + 1e-15) - moments[0] - moments[1])  # corrects rounding errors
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return Principal(max(mass, MIN_MASS), centre, moments, quaternion(axes))


def quaternion(rotation: Array) -> Array:
    """Convert a rotation: (3, 3) [1] to a quaternion w x y z, (4,) [1]."""
    return np.roll(pin.Quaternion(rotation).normalized().coeffs(), 1)


def words(numbers: ArrayLike) -> str:
    """Format numbers as an attribute, with all digits."""
    return " ".join(repr(float(x) + 0.0) for x in np.asarray(numbers, float))


def pose_words(placement: Any) -> dict[str, str]:
    """Position and orientation (pin.SE3) as attributes."""
    return {"pos": words(placement.translation), "quat": words(quaternion(placement.rotation))}


class PossibleBodies(NamedTuple):
    """Bodies of the links, separate payload bodies, and notes on changes."""

    links: list[Principal]  # nb
    loads: list[tuple[Law, Principal]]
    notes: list[str]


def possible_bodies(model: Model) -> PossibleBodies:
    """Return the bodies of a model; if some are inconsistent, replace all by consistent ones with the same torque.

    Raises:
        RobotError: no physically consistent bodies give this torque.
    """
    payloads = [law for law in model.joint_laws if law.effect.name == "payload" and law.parameters["mass"] > MIN_MASS]
    alone = ((law, principal(np.array(law.effect.coefficients(law.parameters)))) for law in payloads)
    loads = [(law, body) for law, body in alone if body]  # others are added to the inertial of their link
    apart = {id(law) for law, _ in loads}
    bare = replace(model, laws=tuple(law for law in model.laws if id(law) not in apart))
    links = [principal(x) for x in bare.whole_inertials()]
    odd = [name for name, body in zip(model.robot.links, links, strict=True) if body is None]
    if not odd:
        return PossibleBodies([body for body in links if body], loads, [])
    base = build_base(replace(model.robot, model=model.bodies()))
    value = base.combination @ model.whole_inertials().ravel()
    size = np.maximum(np.abs(value), 1e-3 * np.abs(value).max(initial=1e-9))
    known = Estimate(value, np.diag((size / _EXACT_RATIO) ** 2), np.diag((_EXACT_RATIO / size) ** 2), np.zeros(0), ())
    fit = fit_consistent(base, known, Parameters(base.labels, stated_inertials(model.robot).ravel()))
    if not fit.feasible_without_moving:
        changed = None
    else:
        near = fit.parameters.values
        exact = Parameters(base.labels, near + least_squares(base.combination, value - base.combination @ near))
        changed = exact.bodies() if exact.is_feasible() else None
    bodies = [] if changed is None else [body for body in map(principal, changed) if body]
    if len(bodies) < len(links):
        raise RobotError(
            f"the inertials of {shorten(odd)} are not physically consistent, as MuJoCo requires, and no "
            "consistent ones give the same torque; identify with --method convex, or export to a URDF"
        )
    note = f"inertials are replaced by consistent ones with the same torque, since {shorten(odd)} had inconsistent ones"
    return PossibleBodies(bodies, [], [note])


@dataclass(frozen=True)
class Exported(Frozen):
    """The text of a file, and notes on the content that it lacks."""

    text: str
    notes: tuple[str, ...] = ()
    beside: Mapping[str, str] = field(default_factory=dict)  # further texts, by the ends of their files' names
    meshes: Mapping[str, Path] = field(default_factory=dict)  # files to copy, by their path from the folder of the text
    flags: tuple[str, ...] = ()  # on laws that it lacks and that have more than 2 % of the torque of a joint


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


def annotated(kind: str, made: Exported) -> Exported:
    """An export with its flags and notes as comments of its text."""
    lines = [*made.flags, *made.notes]
    if not lines:
        return made
    if kind in ("urdf", "mjcf"):
        return replace(made, text=with_comment(made.text, lines))
    if kind == "c":
        comment = "".join(f"/* {c_comment(line)} */\n" for line in lines)
        header = {end: comment + beside if end == ".h" else beside for end, beside in made.beside.items()}
        return replace(made, text=comment + made.text, beside=header)
    return replace(made, text=remarks(lines) + made.text)


def with_comment(text: str, notes: Iterable[str]) -> str:
    """Insert notes as a comment before the root element of XML; it has no double hyphens."""
    newline = "\r\n" if "\r\n" in text else "\n"
    said = newline.join(notes).replace("--", "- -").replace("--", "- -")
    declared = _XML_DECLARATION.match(text)
    head = text[: declared.end()] + newline if declared else ""
    return f"{head}<!-- {said} -->{text[declared.end() :] if declared else newline + text}"


def in_docstring(text: str) -> str:
    """Escape text for a docstring of Python."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


def c_comment(text: str) -> str:
    """Format text as part of a comment of C, which it cannot end."""
    return one_line(text).replace("*/", "* /").replace("/*", "/ *").encode("ascii", "replace").decode()


def model_digest(model: Model) -> str:
    """SHA-256 of the model.json that `model.save` writes."""
    from ..report import to_json

    return sha256(to_json(model.document()).encode()).hexdigest()


def summed(model: Model, effect: str) -> Array:
    """Sum of an effect's single parameter over its laws, (n,) [the unit of the parameter]; NaN: no law."""
    total = np.full(len(model.robot.joints), np.nan)
    for law in model.joint_laws:
        if law.effect.name == effect:
            (value,), (joint,) = law.parameters.values(), law.joints
            total[joint] = np.nan_to_num(total[joint]) + value
    return total
