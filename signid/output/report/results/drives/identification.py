"""Identification of position drives: JSON document, terminal tables and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType

from .....effects import EFFECTS
from .....model import standard_parameters
from .....parameters import Array, pseudo_inertia
from .....servos import PASSIVE
from .....types import Input
from ...layout import UNKNOWN, figure, heading, new_table, note_lines, paragraph, plural, share, with_interval
from ..documents import Document, description, ending, opening, stamps_clock
from .closed_loops import closed_loop_rows, closed_loop_title, position_fit, rollout_document

if TYPE_CHECKING:
    from .....servo.identify import ServoIdentification, ServoJoint, ServoNumber
    from .....servo.zeros import JointZero

FIRST = ("kp", "damping", "delay", "lag", "effort_limit", "armature", "coulomb_friction", "load_friction")
LAWS = (*PASSIVE, "load_friction")  # numbers of a drive that are written as effects
ROUNDING = 1e-9  # eigenvalue over trace of a pseudo-inertia that counts as 0
DAMPING = "kd + viscous_friction + back_emf"


def servo_identification_document(result: ServoIdentification, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of identification.json; `inputs` besides the recordings default to the robot description."""
    robot, model = result.robot, result.model
    inertials = np.asarray(model.inertials)
    return {
        **opening("signid.identification/1", robot),
        "base_parameters": [],
        "standard_parameters": standard_parameters(model.robot, inertials),
        "physically_consistent": all(_is_possible(x) for x in inertials),
        "effects": list(_effects(result)),
        "signs": None,
        "fit": {**position_fit(result.rollout), "refit": result.refit},
        "method": "output error of the closed loop",
        "recordings": [
            {"path": log.path, "clock": stamps_clock(log.period), "content_rate": log.content_rate}
            for log in result.logs
        ],
        "servo": {
            "scale": _scale(result),
            "joints": [_joint(one) for one in result.joints],
            "rollout": rollout_document(result.rollout),
            **({"zeros": [_zero(one) for one in result.zeros]} if result.zeros else {}),
        },
        **ending(result, result.inputs, inputs or [description(robot)], result.seed),
    }


def _is_possible(inertial: Array) -> bool:
    """Whether a body, which may have no mass, could have these ten inertial parameters."""
    matrix = pseudo_inertia(inertial)
    return bool(np.linalg.eigvalsh(matrix)[0] >= -ROUNDING * abs(np.trace(matrix)))


def _scale(result: ServoIdentification) -> Document:
    scale = result.scale
    return {
        "told_by": scale.known_by,
        "share_of_known_load": {one.joint: one.known_load_share for one in result.joints},
        "sentence": scale.sentence,
        "otherwise": "; ".join(scale.alternatives),
    }


def _joint(one: ServoJoint) -> Document:
    numbers = {name: _number(one.numbers[name]) for name in ordered_numbers([one])}
    limit = numbers.get("effort_limit", {"value": None, "std": None, "unit": ""})
    damping = {"damping": {**numbers["damping"], "is": DAMPING}} if "damping" in numbers else {}
    return {
        "joint": one.joint,
        "law": one.law,
        "law_probability": one.law_probability,
        "laws": dict(one.laws),
        **numbers,
        **damping,
        "effort_limit": {**limit, "saturated_share": one.saturated_share},
        "known_load_share": one.known_load_share,
        "not_told": list(one.not_identifiable),
    }


def _zero(one: JointZero) -> Document:
    return {
        "joint": one.joint,
        "sign": one.sign,
        "sign_probability": one.sign_probability,
        "zero": {"value": one.zero, "std": one.std, "unit": "rad"},
        "identifiable": one.identifiable,
    }


def _number(number: ServoNumber) -> Document:
    """Value and standard deviation; a number that is not identifiable has neither, and a sentence."""
    known = number.value is not None
    return {
        "value": number.value,
        "std": number.std if known else None,
        "unit": number.unit,
        **({"stated": number.value} if number.stated else {}),
        **({"sentence": number.sentence} if number.sentence else {}),
    }


def _effects(result: ServoIdentification) -> Iterator[Document]:
    """Passive laws of the joints that the recordings identify."""
    for one in result.joints:
        for name in LAWS:
            number = one.numbers.get(name)
            if number is not None and number.value is not None:
                value = {"value": number.value, "std": number.std, "unit": number.unit}
                yield {"effect": name, "joint": one.joint, "parameters": {next(iter(EFFECTS[name].parameters)): value}}


def ordered_numbers(joints: Sequence[ServoJoint]) -> list[str]:
    """Names of the numbers of some joints, the most asked for first."""
    names = dict.fromkeys(name for one in joints for name in one.numbers)
    return [*(name for name in FIRST if name in names), *(name for name in names if name not in FIRST)]


def servo_identification_tables(result: ServoIdentification) -> list[RenderableType]:
    """Drives with their intervals, one joint a line; what is not identifiable; errors of closed loops."""
    heads, rows = servo_rows(result)
    rolled, errors = closed_loop_rows(result.rollout)
    lines = unidentifiable_lines(result.joints)
    return [
        heading(f"{result.robot.name}: position drives of {plural(len(result.joints), 'joint')}, ± 95 %", below=False),
        new_table(*heads, rows=rows),
        heading("Scale of torque and mass"),
        *map(paragraph, scale_lines(result)),
        *([heading("Not identifiable from these recordings"), *map(paragraph, lines)] if lines else []),
        heading(closed_loop_title(result.rollout)),
        new_table(*rolled, rows=errors),
        *note_lines(note for note in result.notes if note not in lines),
    ]


def servo_rows(result: ServoIdentification) -> tuple[list[str], list[list[str]]]:
    """Table heads and one row per joint: law, numbers with 95 % intervals, saturated share."""
    names = [
        name
        for name in ordered_numbers(result.joints)
        if name in FIRST[:5] or any(_shown(one.numbers.get(name)) for one in result.joints)
    ]
    units = {
        name: dict.fromkeys(one.numbers[name].unit for one in result.joints if name in one.numbers) for name in names
    }
    heads = [f"{name.replace('_', ' ')}\n[{' or '.join(units[name])}]>" for name in names]
    rows = [
        [one.joint, _law(one), *(number_cell(one.numbers.get(name)) for name in names), share(one.saturated_share)]
        for one in result.joints
    ]
    return ["joint", "law", *heads, "saturated>"], rows


def _shown(number: ServoNumber | None) -> bool:
    """Whether a less usual number deserves a column: a value that is not zero."""
    return number is not None and number.value is not None and number.value != 0


def _law(one: ServoJoint) -> str:
    if one.law_probability is None:
        return f"{one.law} (stated)"
    sure = ">0.999" if one.law_probability > 0.999 else f"{one.law_probability:.3g}"
    return f"{one.law} ({sure})"


def number_cell(number: ServoNumber | None) -> str:
    """Value with the half-width of its 95 % interval; words where it is stated or not identifiable."""
    if number is None:
        return ""
    if number.value is None:
        return UNKNOWN
    if number.stated or number.std is None:
        return f"{figure(number.value)} (stated)" if number.stated else f"({figure(number.value)})"
    return " ± ".join(text for text in with_interval(number.value, number.std) if text != "-")


def scale_lines(result: ServoIdentification) -> list[str]:
    """Basis of the scale of torque, and its alternatives."""
    given = (result.scale.sentence, *result.scale.alternatives)
    return [text if text.startswith("kp") else f"{text[:1].upper()}{text[1:]}" for text in given if text]


def unidentifiable_lines(joints: Sequence[ServoJoint]) -> list[str]:
    """Sentences on what is not identifiable, each once, with its joints."""
    from .....servo.identify.flags import by_sentence

    return list(by_sentence(joints))
