"""Identification of a robot: JSON documents, terminal tables, parameters and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from ....effects.base import Effect
from ....estimation.excitation import ENOUGH
from ....model import Model, standard_parameters
from ....types import Array, BaseMap, Input, Law
from ..documents import Document, description, ending, excitation_verdict, fit_document, opening, recorded
from ..layout import determination, figure, heading, new_table, note_lines, paragraph, plural, share, with_interval
from .laws import law_units
from .signs import signs_document, signs_tables

if TYPE_CHECKING:
    from ....estimation.excitation import ExcitationVerdict
    from ....estimation.fit_quality import Fit
    from ....identify import Identification

WIDE = 4  # maximum number of columns of law parameters


class LawNumber(NamedTuple):
    """One parameter of a law; std is None if it is identifiable only in combination."""

    effect: str
    joint: str | None  # None: the whole robot
    key: str
    value: float
    std: float | None
    unit: str

    @property
    def place(self) -> str:
        """Joint, or the robot."""
        return self.joint or "(robot)"

    @property
    def interval(self) -> tuple[str, str]:
        """Value, and the half-width of its interval."""
        return (figure(self.value), "in combination") if self.std is None else with_interval(self.value, self.std)

    @property
    def words(self) -> tuple[str, str]:
        """Effect and key without underscores."""
        return self.effect.replace("_", " "), self.key.replace("_", " ")


def identified_numbers(result: Identification) -> list[list[LawNumber]]:
    """Parameters of each law of the model, with their standard deviations."""
    singles, std = _alone(result.base), result.estimate.std
    places: dict[int, list[int]] = {}
    for k, label in enumerate(result.base.labels):
        if label.law is not None:
            places.setdefault(label.law, []).append(k)
    known = {i: [float(std[singles[k]]) if k in singles else None for k in own] for i, own in places.items()}
    return [_numbers(result, law, known.get(i, [])) for i, law in enumerate(result.model.laws)]


def _alone(base: BaseMap) -> dict[int, int]:
    """Individually identifiable standard parameters: index of each -> index of its base parameter."""
    terms = np.count_nonzero(base.combination, axis=1)
    return {int(lead): row for row, lead in enumerate(base.independent) if terms[row] == 1}


def _rigid_rows(base: BaseMap) -> list[int]:
    """Base parameters other than a single coefficient of a law."""
    singles = _alone(base)
    laws = {singles[k] for k, label in enumerate(base.labels) if label.law is not None and k in singles}
    return [row for row in range(base.rank) if row not in laws]


def _numbers(result: Identification, law: Law, known: Sequence[float | None]) -> list[LawNumber]:
    linear = list(law.effect.linear())
    plain = type(law.effect).physical is Effect.physical  # the parameters are the coefficients
    joint = result.robot.joints[law.joints[0]] if len(law.joints) == 1 else None
    std = {key: known[linear.index(key)] for key in law.parameters if plain and key in linear}
    units, values = law_units(result.robot, law), law.parameters.items()
    return [LawNumber(law.effect.name, joint, key, float(x), std.get(key), units[key]) for key, x in values]


def base_documents(base: BaseMap) -> list[Document]:
    """Formula and unit of each base parameter."""
    units = (unit.replace("m2", "m^2") for unit in base.units)
    return [{"expression": e, "unit": unit} for e, unit in zip(base.expressions, units, strict=True)]


def identification_document(result: Identification, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of identification.json; `inputs` besides the recordings default to the robot description."""
    robot, values = result.robot, zip(result.base_value, result.estimate.std, result.estimate.value, strict=True)
    return {
        **opening("signid.identification/1", robot),
        "base_parameters": [
            {**combination, "value": float(value), "std": float(std), "estimate": float(estimate)}
            for combination, (value, std, estimate) in zip(base_documents(result.base), values, strict=True)
        ],
        "standard_parameters": standard_parameters(robot, result.parameters.bodies()),
        "physically_consistent": result.physically_consistent,
        "moved": float(result.moved),
        "effects": [
            {
                "effect": law.effect.name,
                "joint": robot.joints[law.joints[0]] if len(law.joints) == 1 else None,
                "parameters": {n.key: {"value": n.value, "std": n.std, "unit": n.unit} for n in numbers},
            }
            for law, numbers in zip(result.model.laws, identified_numbers(result), strict=True)
        ],
        "signs": signs_document(result.signs),
        "fit": {**fit_document(result.fit), "refit": result.fit.refit},
        **({} if result.refinement is None else {"refinement": _refinement(result)}),
        "excitation": excitation_verdict(result.excitation),
        "method": result.method,
        "estimator": result.estimate.method,
        "recordings": [recorded(recording, sampling) for recording, sampling in result.session.whole],
        "cutoff": {"torque": result.cutoff, "position": result.position_cutoff, "unit": "Hz"},
        **ending(result, result.inputs, inputs or [description(robot)], result.seed),
    }


def identification_tables(result: Identification) -> list[RenderableType]:
    """Base parameters and laws with their intervals, fit, excitation and physical consistency."""
    base = new_table("base parameter", "value>", "± (95 %)>", "unit")
    for row in _rigid_rows(result.base):
        interval = with_interval(result.base_value[row], result.estimate.std[row])
        base.add_row(result.base.expressions[row], *interval, result.base.units[row])
    counted = f"{plural(result.base.rank, 'base parameter')}, {plural(len(result.robot.joints), 'joint')}"
    heads = ("joint", "training>", "held out>", "noise floor>", "unit", "R2 held out>")
    return [
        heading(f"{result.robot.name}: {counted}", below=False),
        base,
        *_laws([number for numbers in identified_numbers(result) for number in numbers]),
        *([] if result.signs is None else signs_tables(result.signs)),
        heading("Fit: rms of the residual torque"),
        new_table(*heads, rows=fit_rows(result.fit)),
        paragraph(excited_words(result.excitation)),
        paragraph(consistent_words(result)),
        paragraph(f"{cutoff_words(result.cutoff, result.position_cutoff)}; {result.estimate.method}."),
        *_refined(result),
        *note_lines(result.notes),
    ]


def _laws(numbers: Sequence[LawNumber]) -> list[RenderableType]:
    """A table with one row per joint, or one row per parameter if there are too many columns."""
    kinds = list(dict.fromkeys((n.effect, n.key) for n in numbers))
    if not kinds:
        return []
    if len(kinds) <= WIDE:
        table = _law_grid(numbers, kinds)
    else:
        rows = ((n.place, *n.words, _law_cell(n), n.unit) for n in numbers)
        table = new_table("joint", "law", "parameter", "value>", "unit", rows=rows)
    combined = any(n.std is None for n in numbers)
    note = [paragraph("In parentheses: identifiable only in combination with other parameters.")] if combined else []
    return [heading("Laws at the joints, ± 95 %"), table, *note]


def _law_grid(numbers: Sequence[LawNumber], kinds: Sequence[tuple[str, str]]) -> Table:
    lines: dict[str, dict[tuple[str, str], LawNumber]] = {}
    units: dict[tuple[str, str], dict[str, None]] = {}
    for n in numbers:
        lines.setdefault(n.place, {})[n.effect, n.key] = n
        units.setdefault((n.effect, n.key), {})[n.unit] = None
    heads = [f"{kind[0].replace('_', ' ')}\n{kind[1]} [{' or '.join(units[kind])}]>" for kind in kinds]
    rows = ((place, *(_law_cell(line.get(kind)) for kind in kinds)) for place, line in lines.items())
    return new_table("joint", *heads, rows=rows)


def _law_cell(number: LawNumber | None) -> str:
    if number is None:
        return ""
    if number.std is None:
        return f"({figure(number.value)})"
    return " ± ".join(text for text in number.interval if text != "-")


def fit_rows(fit: Fit, *before: Array) -> Iterator[tuple[str, ...]]:
    """Joint, rms of other models (before: (n,) [N.m or N]), training and held-out rms, noise floor, unit, R2."""
    columns = zip(*before, fit.train_rms, fit.held_out_rms, strict=True)
    for joint, sizes, floor, unit, r2 in zip(
        fit.joints, columns, fit.noise_floor, fit.unit, fit.held_out_r2, strict=True
    ):
        yield joint, *map(figure, sizes), figure(floor, 2), unit, determination(r2)


def excited_words(found: ExcitationVerdict) -> str:
    """The verdict on the excitation in one or two sentences."""
    least = share(max(float(found.shares[0]), 0.0)) if len(found.shares) else "0 %"
    reached = f"the weakest direction has {least} of the information of a random motion of the same size"
    verdict = "sufficient" if found.sufficient else "insufficient"
    sentence = f"Excitation {verdict}: {reached} ({share(ENOUGH)} needed)."
    if found.small:
        be = "is" if len(found.small) == 1 else "are"
        sentence += f" {plural(len(found.small), 'base parameter')} {be} too small to affect this torque."
    return sentence


def consistent_words(result: Identification) -> str:
    """Physical consistency of the inertials in a sentence."""
    if not result.physically_consistent:
        advice = " (method wls does not enforce it)" if result.method == "wls" else ""
        return f"The inertials are not physically consistent{advice}."
    if result.method == "wls":
        return "The inertials are physically consistent."
    change = f"this changed base parameters by at most {result.moved:.1f} standard deviations"
    return f"The inertials are physically consistent; {change}."


def cutoff_words(torque: float, position: float) -> str:
    """The cut-off frequencies, and the option that sets them."""
    return f"Cut-off {figure(torque)} Hz for torque and {figure(position)} Hz for positions (set with --cutoff)"


def _refinement(result: Identification) -> Document | None:
    """Build the block `refinement` of identification.json; None if it was not asked for."""
    found = result.refinement
    if found is None:
        return None
    joints = result.robot.joints
    return {
        "kept": found.kept,
        "windows": list(found.lengths),
        "before": [float(x) for x in found.before],
        "after": [float(x) for x in found.after],
        "unit": list(found.unit),
        "effects": [
            {
                "effect": law.effect.name,
                "joint": joints[law.joints[0]] if len(law.joints) == 1 else None,
                "parameters": {key: float(value) for key, value in law.parameters.items()},
            }
            for law in result.best.laws
        ],
    }


def _refined(result: Identification) -> list[RenderableType]:
    """Numbers of the laws in model.json, if roll-outs refined them."""
    found, model = result.refinement, result.refined
    if found is None or model is None:
        return []
    table = new_table("joint", "law", "parameter", "value>", "unit", rows=_refined_rows(model))
    return [heading("Refined by roll-outs: laws of model.json"), table, paragraph(f"{found.sentence}.".capitalize())]


def _refined_rows(model: Model) -> list[list[str]]:
    prismatic, joints = model.robot.prismatic, model.robot.joints
    rows = []
    for law in model.laws:
        j = law.joints[0]
        for key, value in law.parameters.items():
            unit = law.effect.parameters[key].unit_at(bool(prismatic[j]))
            rows.append([joints[j], law.effect.name.replace("_", " "), key, figure(float(value)), unit])
    return rows
