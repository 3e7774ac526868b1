"""Identification of position drives: JSON document, terminal tables and page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType

from ....effects import EFFECTS
from ....model import standard_parameters
from ....parameters import Array, pseudo_inertia
from ....servos import PASSIVE
from ....types import Input
from ..documents import Document, description, ending, opening, picked, stamps_clock
from ..layout import UNKNOWN, figure, heading, plural, share, with_interval
from ..plots.courses import loop_blocks, worst_joints
from ..plots.frame import Header, sections_page, shared
from ..sections import Block, Card, Cells, Legend, Section, Sentences, terminal

if TYPE_CHECKING:
    from ....servo.identify import FrictionModel, ServoIdentification, ServoJoint, ServoNumber, ServoRollOut
    from ....servo.zeros import JointZero

FIRST = ("kp", "damping", "delay", "lag", "effort_limit", "armature", "coulomb_friction", "load_friction")
LAWS = (*PASSIVE, "load_friction")  # numbers of a drive that are written as effects
ROUNDING = 1e-9  # eigenvalue over trace of a pseudo-inertia that counts as 0
LEGEND = (
    "damping: kd of the drive, viscous friction and back-EMF together; lag: delay + damping / kp; saturated: share of "
    "samples in which the drive gives its limit."
)
MODELS = (
    "Each model takes the place of the friction of the drives and is fitted to the same windows of the training rows. "
    "The log Bayes factor is that of these rows over the first model; the probability allows for their differences. "
    "M1 to M6: Duclusaud et al., arXiv 2410.08650; PACE: Bjelonic et al., 2025."
)
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
            "rollout": {**rollout_document(result.rollout), "held_out": result.rollout.held_out},
            **({"zeros": [_zero(one) for one in result.zeros]} if result.zeros else {}),
            **(
                {"friction_models": [_model(x, result) for x in result.friction_models]}
                if result.friction_models
                else {}
            ),
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
        "set_by": scale.known_by,
        "share_of_known_load": {one.joint: one.known_load_share for one in result.joints},
        "sentence": scale.sentence,
        "otherwise": "; ".join(scale.alternatives),
    }


def _joint(one: ServoJoint) -> Document:
    numbers = {name: _number(one.numbers[name]) for name in _ordered_numbers([one])}
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
        **({"equal": list(one.equal)} if one.equal else {}),
        "not_identifiable": list(one.not_identifiable),
    }


def _zero(one: JointZero) -> Document:
    return {
        "joint": one.joint,
        "sign": one.sign,
        "sign_probability": one.sign_probability,
        "zero": {"value": one.zero, "std": one.std, "unit": "rad"},
        "identifiable": one.identifiable,
    }


def _model(one: FrictionModel, result: ServoIdentification) -> Document:
    return {
        "model": one.name,
        **picked(one, "terms mean_absolute rms"),
        "held_out": result.rollout.held_out,
        **picked(one, "log_bayes_factor probability"),
        "processor_seconds": one.seconds,
        "joints": {joint: {name: _number(x) for name, x in numbers.items()} for joint, numbers in one.numbers.items()},
    }


def _number(number: ServoNumber) -> Document:
    """Value and standard deviation; a number that is not identifiable has neither, and a sentence."""
    known = number.value is not None
    return {
        "value": number.value,
        "std": number.std if known else None,
        "unit": number.unit,
        **({"stated": number.value} if number.stated else {}),
        **({"prior": number.prior._asdict()} if number.prior else {}),
        **({"bounds": [x if np.isfinite(x) else None for x in number.bounds]} if number.bounds else {}),
        **({"at_bound": True} if number.at_bound else {}),
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


def _ordered_numbers(joints: Sequence[ServoJoint]) -> list[str]:
    """Names of the numbers of some joints, the most asked for first."""
    names = dict.fromkeys(name for one in joints for name in one.numbers)
    return [*(name for name in FIRST if name in names), *(name for name in names if name not in FIRST)]


def position_fit(found: ServoRollOut) -> Document:
    """Rms position error of closed loops over whole recordings, in the form of a fit."""
    nothing = [None] * len(found.joints)
    return {
        "joints": list(found.joints),
        "unit": list(found.units),
        "train_rms": nothing,
        "held_out_rms": found.whole_rms,
        "noise_floor": nothing,
        "held_out_r2": nothing,
    }


def rollout_document(found: ServoRollOut) -> Document:
    """Rms position error per joint of closed loops from commands alone."""
    sizes = picked(found, "whole_rms one_second_rms nominal nominal_whole_rms nominal_one_second_rms")
    return {"joints": list(found.joints), **sizes, "unit": list(found.units)}


def servo_identification_tables(result: ServoIdentification) -> list[RenderableType]:
    """Drives with their intervals, one joint a line; what is not identifiable; errors of closed loops."""
    sections = [_drives(result)._replace(title=""), _scale_basis(result), _unidentifiable(result), _loops(result)]
    sections += [_models(result)]
    title = f"{result.robot.name}: position drives of {plural(len(result.joints), 'joint')}, ± 95 %"
    return [heading(title, below=False), *terminal(sections, _notes(result))]


def servo_identification_page(result: ServoIdentification, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a servo identification; `inputs` besides the recordings default to the description."""
    name, counted = result.robot.name, plural(len(result.joints), "position drive")
    over = f"identification of {name}: position drives from commands and positions, without torque"
    headline = f"{name}: {counted} identified from commanded and measured positions"
    sections = [
        _loops(result).beside(*loop_blocks(result.traces, result.rollout, result.rollout.nominal, "identified")),
        _drives(result).beside(Legend(LEGEND)),
        _scale_basis(result).beside(
            Cells(
                ("joint", "torque that known masses explain>", "saturated samples>"),
                [(one.joint, share(one.known_load_share), share(one.saturated_share)) for one in result.joints],
            )
        ),
        _unidentifiable(result),
        Section("Laws of the drives that were compared", (Cells(("joint", "law", "probability>"), _compared(result)),)),
        _models(result).beside(*_model_numbers(result)),
    ]
    header = Header(f"{name}: {counted}", over, list(_cards(result)), "unreliable" if result.flags else "", headline)
    return sections_page(header, sections, shared(result, [result.robot], inputs, command) | {"notes": _notes(result)})


def _cards(result: ServoIdentification) -> Iterator[Card]:
    """Key figures of the joint with the largest error after the fit."""
    found = result.rollout
    for j in worst_joints(found)[:1]:
        joint, unit = found.joints[j], found.units[j]
        columns = (found.whole_rms, found.nominal_whole_rms, found.one_second_rms, found.nominal_one_second_rms)
        whole, before, short, short_before = (figure(float(rms[j])) for rms in columns)
        data = "held out" if found.held_out else "data of the fit"
        beside = f"worst joint, {data}; {found.nominal}: {before}"
        yield Card(f"closed loop of {joint}, whole recordings", f"{whole} {unit}", beside)
        beside = f"rms position error; {found.nominal}: {short_before}"
        yield Card("the same joint, windows of 1 s", f"{short} {unit}", beside)
        for one in result.joints:
            if one.joint == joint and (kp := one.numbers.get("kp")) is not None:
                yield Card(f"stiffness kp of {joint}", _number_cell(kp), f"{kp.unit}, ± 95 %; law {one.law}")


def _notes(result: ServoIdentification) -> list[str]:
    """Notes that are no sentence on what is not identifiable."""
    lines = _unidentifiable_lines(result)
    return [note for note in result.notes if note not in lines]


def _loops(result: ServoIdentification) -> Section:
    """Rms of the nominal and of the identified loop, whole recordings and 1 s windows."""
    found = result.rollout
    columns = (found.nominal_whole_rms, found.whole_rms, found.nominal_one_second_rms, found.one_second_rms)
    rows = [
        [joint, *(figure(float(rms[j])) for rms in columns), found.units[j]] for j, joint in enumerate(found.joints)
    ]
    before = found.nominal or "before"
    heads = ["joint", f"whole,\n{before}>", "whole,\nidentified>", f"1 s,\n{before}>", "1 s,\nidentified>", "unit"]
    data = "held-out data" if found.held_out else "data of the fit (none was held out)"
    return Section(f"Closed loop from commands alone, {data}: rms position error", (Cells(heads, rows),))


def _drives(result: ServoIdentification) -> Section:
    """One row per joint: law, numbers with 95 % intervals, saturated share."""
    names = [
        name
        for name in _ordered_numbers(result.joints)
        if name in FIRST[:5] or any(_shown(one.numbers.get(name)) for one in result.joints)
    ]
    units = {
        name: dict.fromkeys(one.numbers[name].unit for one in result.joints if name in one.numbers) for name in names
    }
    heads = [f"{name.replace('_', ' ')}\n[{' or '.join(units[name])}]>" for name in names]
    rows = [
        [one.joint, _law(one), *(_number_cell(one.numbers.get(name)) for name in names), share(one.saturated_share)]
        for one in result.joints
    ]
    return Section("Drives, ± 95 %", (Cells(["joint", "law", *heads, "saturated>"], rows),))


def _shown(number: ServoNumber | None) -> bool:
    """Whether a less usual number deserves a column: a value that is not zero."""
    return number is not None and number.value is not None and number.value != 0


def _law(one: ServoJoint) -> str:
    if one.law_probability is None:
        return f"{one.law} (stated)"
    sure = ">0.999" if one.law_probability > 0.999 else f"{one.law_probability:.3g}"
    return f"{one.law} ({sure})"


def _number_cell(number: ServoNumber | None) -> str:
    """Value with the half-width of its 95 % interval; words where it is stated or not identifiable."""
    if number is None:
        return ""
    if number.value is None:
        return UNKNOWN
    if number.at_bound:
        return f"{figure(number.value)} (bound)"
    if number.stated or number.std is None:
        return f"{figure(number.value)} (stated)" if number.stated else f"({figure(number.value)})"
    text = " ± ".join(text for text in with_interval(number.value, number.std) if text != "-")
    return f"{text} (with prior)" if number.prior else text


def _scale_basis(result: ServoIdentification) -> Section:
    """Basis of the scale of torque, and its alternatives."""
    given = (result.scale.sentence, *result.scale.alternatives)
    said = [text if text.startswith("kp") else f"{text[:1].upper()}{text[1:]}" for text in given if text]
    return Section("Scale of torque and mass", (Sentences(said),))


def _unidentifiable(result: ServoIdentification) -> Section:
    return Section("Not identifiable from these recordings", (Sentences(_unidentifiable_lines(result)),))


def _unidentifiable_lines(result: ServoIdentification) -> list[str]:
    """Sentences on what is not identifiable, each once, with its joints."""
    from ....servo.identify.flags import by_sentence

    return list(by_sentence(result.joints))


def _compared(result: ServoIdentification) -> list[tuple[str, str, str]]:
    """Posterior of each law that was tried, per joint."""
    return [
        (one.joint, law, ">0.999" if probability > 0.999 else figure(probability))
        for one in result.joints
        for law, probability in sorted(one.laws.items(), key=lambda item: -item[1])
    ]


def _models(result: ServoIdentification) -> Section:
    """One row per friction model: errors of whole recordings, evidence, time."""
    heads = ("model", "has", "mean |error|>", "rms>", "log Bayes factor>", "probability>", "processor s>")
    rows = [
        (
            one.name,
            one.terms,
            _by_unit(result.rollout, one.mean_absolute),
            _by_unit(result.rollout, one.rms),
            f"{one.log_bayes_factor:.1f}",
            "-" if np.isnan(one.probability) else f"{one.probability:.2f}",
            f"{one.seconds:.1f}",
        )
        for one in result.friction_models
    ]
    data = "held-out data" if result.rollout.held_out else "data of the fit (none was held out)"
    return Section(f"Friction models: errors from commands alone, {data}", (Cells(heads, rows),) if rows else ())


def _by_unit(found: ServoRollOut, errors: Array) -> str:
    """Mean error of the joints of each unit; "-" where it diverges."""
    each = {unit: errors[[u == unit for u in found.units]] for unit in dict.fromkeys(found.units)}
    means = {unit: x[~np.isnan(x)] for unit, x in each.items()}
    return ", ".join(f"{figure(float(np.mean(x)))} {unit}" for unit, x in means.items() if x.size)


def _model_numbers(result: ServoIdentification) -> Iterator[Block]:
    """Numbers of each friction model by joint, those that are not identifiable last."""
    rows = [
        (
            one.name,
            joint,
            ", ".join(f"{_word(x.name)} {_number_cell(x)} {x.unit}" for x in numbers.values() if x.value is not None),
            ", ".join(_word(x.name) for x in numbers.values() if x.value is None),
        )
        for one in result.friction_models
        for joint, numbers in one.numbers.items()
    ]
    if rows:
        yield Cells(("model", "joint", "numbers, ± 95 %", "not identifiable"), rows)
        yield Legend(MODELS)


def _word(name: str) -> str:
    return name.replace("_", " ")
