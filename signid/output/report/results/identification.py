"""Identification and inspection of a robot, and payload of its last link: JSON documents, terminal tables and page."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import RenderableType

from ....effects.base import Effect
from ....estimation.excitation import MIN_INFO
from ....model import standard_parameters, stated_inertials
from ....types import INERTIAL, TWO_SIDED, Array, BaseMap, Input, Law, Robot, pseudo_inertia
from ..documents import (
    Document,
    description,
    ending,
    excitation_verdict,
    fit_document,
    opening,
    picked,
    provenance,
    recorded,
    rms,
)
from ..layout import (
    determination,
    figure,
    heading,
    name_cell,
    new_table,
    note_lines,
    paragraph,
    plural,
    position_units,
    share,
    torque_units,
    with_interval,
)
from ..pages import Header, sections_page, shared
from ..plots import correlation_plot, excitation_plot, held_out_rows, joint_plots, tied, worst
from ..quantities import Quantity, effect_document, grid, law_document, law_numbers, spaced
from ..sections import Bar, Card, Cells, Folds, Key, Legend, Plain, Plots, Section, Sentences, terminal
from .signs import drawn_signs, signs_document, signs_sections

if TYPE_CHECKING:
    from ....check import Inspection
    from ....estimation.excitation import ExcitationVerdict
    from ....estimation.fit_quality import Fit
    from ....identify import Identification
    from ....payload import Payload

COEFFICIENT_STEP = 1e-6  # [1] step of finite differences over the coefficients of a law
MAX_NUMBER_COLUMNS = 4  # maximum number of columns of law parameters
MAX_CORRELATED_PAIRS = 12  # maximum number of correlated pairs listed
CURVE_KEY = (("measured", "measured"), ("before", "before: robot description"), ("after", "after: identified model"))
BASE_LEGEND = (
    "Identifiable combinations of the parameters of bodies and laws; indices: moving links. The bar shows the "
    "half-width of the interval relative to the value; it is full and grey if the interval contains zero."
)
BODIES = (
    *("link", "mass described [kg]>", "identified [kg]>", "centre of mass described [mm]>", "identified [mm]>"),
    "smallest eigenvalue of the pseudo-inertia>",
)
CONSISTENT = (
    "Only combinations are identifiable; the remaining degrees of freedom come from the description. A body is "
    "physically consistent if no eigenvalue is negative (Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018)."
)
HEADS = ("joint", "#>", "type", "carries link", "lower>", "upper>", "velocity>", "effort>", "unit")


def identified_numbers(result: Identification) -> list[list[Quantity]]:
    """Parameters of each law of the model, from which all outputs follow; std is None in combinations alone."""
    singles, places = _alone(result.base), defaultdict[int, list[int]](list)
    for k, label in enumerate(result.base.labels):
        if label.law is not None:
            places[label.law].append(k)
    laws = [(x, _deviations(result, x, [singles.get(k) for k in places[i]])) for i, x in enumerate(result.model.laws)]
    numbers = [law_numbers(result.robot, *pair) for pair in laws]
    for law, std in result.currents:  # in the current of a joint without a torque constant
        known = dict(zip(law.effect.linear(), std, strict=True))
        in_amperes = {"kg.m2": "A.s2/rad"}
        numbers.append(
            [
                x._replace(unit=in_amperes.get(x.unit) or x.unit.replace("N.m", "A").replace("N", "A"))
                for x in law_numbers(result.robot, law, known)
            ]
        )
    return numbers


def whole_numbers(result: Identification) -> list[Quantity]:
    """Numbers of the whole result, from which all outputs follow."""
    verdict = "consistent" if result.physically_consistent else "inconsistent"
    card = ("physical consistency", verdict, f"changed by at most {result.moved:.1f} standard deviations")
    return [Quantity("moved", float(result.moved), None, "1", words=consistent_words(result), card=card)]


def _alone(base: BaseMap) -> dict[int, int]:
    """Individually identifiable standard parameters: index of each -> index of its base parameter."""
    terms = np.count_nonzero(base.combination, axis=1)
    return {int(lead): row for row, lead in enumerate(base.independent) if terms[row] == 1}


def _deviations(result: Identification, law: Law, rows: Sequence[int | None]) -> dict[str, float]:
    """Standard deviation of each identifiable parameter, from the base parameters `rows` that are its coefficients."""
    effect, estimate = law.effect, result.estimate
    if type(effect).physical is Effect.physical:  # the parameters are the coefficients
        return {k: float(estimate.std[row]) for k, row in zip(effect.linear(), rows, strict=False) if row is not None}
    known = {k: row for k, row in enumerate(rows) if row is not None}
    first, covariance = [*known], estimate.covariance[np.ix_([*known.values()], [*known.values()])]
    at = np.array(effect.coefficients(law.parameters))
    step = COEFFICIENT_STEP * max(float(np.abs(at).max()), COEFFICIENT_STEP)
    ends = [[list(effect.physical(at + x, {}).values()) for x in sign * step * np.eye(len(at))] for sign in (1, -1)]
    slopes = (np.array(ends[0]) - ends[1]) / (2 * step)  # (k coefficients, k parameters)
    mixed = np.any(np.delete(slopes, first, axis=0), axis=0).tolist()  # with coefficients that are not identifiable
    std = np.sqrt(np.diag(slopes[first].T @ covariance @ slopes[first]))
    return {key: float(x) for key, x, no in zip(effect.linear(), std, mixed, strict=True) if not no}


def base_documents(base: BaseMap) -> list[Document]:
    """Formula and unit of each base parameter."""
    units = (unit.replace("m2", "m^2") for unit in base.units)
    return [{"expression": e, "unit": unit} for e, unit in zip(base.expressions, units, strict=True)]


def identification_document(result: Identification, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of identification.json; `inputs` besides the recordings default to the robot description."""
    robot, refinement = result.robot, Document()
    values = zip(result.base_value, result.estimate.std, result.estimate.value, strict=True)
    if (refined := result.refinement) is not None:
        refinement = {
            "kept": refined.kept,
            "windows": list(refined.lengths),
            "before": [float(x) for x in refined.before],
            "after": [float(x) for x in refined.after],
            "unit": list(refined.unit),
            "effects": [
                {**law_document(robot, law), "parameters": {x.name: x.value for x in law_numbers(robot, law, {})}}
                for law in result.best.laws
            ],
        }
    return {
        **opening("signid.identification/1", robot),
        "base_parameters": [
            {**combination, "value": float(value), "std": float(std), "estimate": float(estimate)}
            for combination, (value, std, estimate) in zip(base_documents(result.base), values, strict=True)
        ],
        "standard_parameters": standard_parameters(robot, result.parameters.bodies()),
        "physically_consistent": result.physically_consistent,
        **{x.name: x.value if x.known else None for x in whole_numbers(result)},
        "effects": [effect_document(law[0].law, law[0].joint, law) for law in identified_numbers(result)],
        "signs": None if result.signs is None else signs_document(result.signs),
        "fit": {**fit_document(result.fit), "refit": result.fit.refit},
        "lacks": [{key: x for key, x in list(vars(lack).items())[:4]} for lack in result.lacks],
        "varies": [law._asdict() for law in result.varies],
        **({"refinement": refinement} if refinement else {}),
        "excitation": excitation_verdict(result.excitation),
        "method": result.method,
        "estimator": result.estimate.method,
        "recordings": [recorded(recording, sampling) for recording, sampling in result.session.whole],
        "cutoff": {"torque": result.cutoff, "position": result.position_cutoff, "unit": "Hz"},
        **ending(result, result.inputs, inputs or [description(robot)], result.seed),
    }


def identification_tables(result: Identification) -> list[RenderableType]:
    """Base parameters and laws with their intervals, fit, excitation and physical consistency."""
    base, heads = result.base, ("joint", "training>", "held out>", "noise floor>", "unit", "R2 held out>")
    singles = _alone(base)
    laws = {singles[k] for k, label in enumerate(base.labels) if label.law is not None and k in singles}
    rows = [  # single coefficients of laws are in the table of laws
        (base.expressions[k], *with_interval(result.base_value[k], result.estimate.std[k]), base.units[k])
        for k in range(base.rank)
        if k not in laws
    ]
    sentences = (
        excited_words(result.excitation),
        *(x.sentence for x in whole_numbers(result)),
        f"{cutoff_words(result.cutoff, result.position_cutoff)}; {result.estimate.method}.",
    )
    sections = [
        Section("", (Cells(("base parameter", "value>", "± (95 %)>", "unit"), rows),)),
        _laws([number for law in identified_numbers(result) for number in law]),
        *([] if result.signs is None else signs_sections(result.signs)),
        Section("Fit: rms of the residual torque", (Cells(heads, list(fit_rows(result.fit))), Sentences(sentences))),
    ]
    if (refinement := result.refinement) is not None and (model := result.refined) is not None:
        numbers = [n for law in model.laws for n in law_numbers(model.robot, law, {})]
        refined = [(n.place, spaced(n.law), n.name, n.text, n.unit) for n in numbers]
        table = Cells(("joint", "law", "parameter", "value>", "unit"), refined)
        said = Plain(f"{refinement.sentence}.".capitalize())
        sections.append(Section("Refined by roll-outs: laws of model.json", (table, said)))
    counted = f"{plural(base.rank, 'base parameter')}, {plural(len(result.robot.joints), 'joint')}"
    return [heading(f"{result.robot.name}: {counted}", below=False), *terminal(sections, result.notes)]


def _laws(numbers: Sequence[Quantity]) -> Section:
    """A table with one row per joint, or one row per parameter if there are too many columns."""
    if len({(n.law, n.name) for n in numbers}) <= MAX_NUMBER_COLUMNS:
        heads, cells = grid(numbers, lambda n: f"{spaced(n.law)}\n{n.name} ")
        places = dict.fromkeys(n.place for n in numbers)
        table = Cells(("joint", *heads), [(place, *row) for place, row in zip(places, cells, strict=True)])
    else:
        rows = [(n.place, spaced(n.law), spaced(n.name), n.cell, n.unit) for n in numbers]
        table = Cells(("joint", "law", "parameter", "value>", "unit"), rows)
    combined = any(n.std is None for n in numbers)
    note = "In parentheses: identifiable only in combination with other parameters." if combined else ""
    return Section("Laws at the joints, ± 95 %", (table, Plain(note)))


def fit_rows(fit: Fit, *before: Array) -> Iterator[tuple[str, ...]]:
    """Joint, rms of other models (before: (n,) [N.m or N]), training and held-out rms, noise floor, unit, R2."""
    columns = zip(*before, fit.train_rms, fit.held_out_rms, strict=True)
    for joint, sizes, floor, unit, r2 in zip(
        fit.joints, columns, fit.noise_floor, fit.unit, fit.held_out_r2, strict=True
    ):
        yield joint, *map(figure, sizes), figure(floor, 2), unit, determination(r2)


def excited_words(excitation: ExcitationVerdict) -> str:
    """The verdict on the excitation in one or two sentences."""
    least = share(max(float(excitation.shares[0]), 0.0)) if len(excitation.shares) else "0 %"
    reached = f"the weakest direction has {least} of the information of a random motion of the same size"
    verdict = "sufficient" if excitation.sufficient else "insufficient"
    sentence = f"Excitation {verdict}: {reached} ({share(MIN_INFO)} needed)."
    if excitation.small:
        be = "is" if len(excitation.small) == 1 else "are"
        sentence += f" {plural(len(excitation.small), 'base parameter')} {be} too small to affect this torque."
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


def identification_page(result: Identification, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of an identification; `inputs` besides the recordings default to the description."""
    name, base, order = result.robot.name, result.base, worst(result.fit)
    numbers = [n for numbers in identified_numbers(result) for n in numbers]
    laws = [(n.place, spaced(n.law), spaced(n.name), *n.interval("in combination"), n.unit) for n in numbers]
    pairs = [
        f"{base.expressions[i]} and {base.expressions[k]}: {size:.3f}"
        for i, k, size in tied(result.estimate.covariance)[:MAX_CORRELATED_PAIRS]
    ]
    together = "Strongly correlated pairs:" if pairs else "No two parameters are correlated by more than 0.95."
    method = f"{result.estimate.method}, {result.method}; torque low-passed at {figure(result.cutoff)} Hz."
    title, heads = "Fit on held-out data", ("rms in training>", "rms held out>", "noise floor>", "unit", "R2 held out>")
    course, whole = held_out_rows(result.session, result.judged)
    before = replace(result.fit, held_out_rms=rms(course.before))
    rows = list(fit_rows(result.fit, before.held_out_rms))
    note = f"Residual is measured - predicted torque, low-passed at {figure(result.cutoff)} Hz. Thick lines: means."
    note += "" if whole else " Beginning of the held-out data."
    folds = Folds(note, joint_plots(course, before, result.fit, order))
    bounds = []
    columns = (result.base.expressions, result.base.units, result.base_value.tolist(), result.estimate.std.tolist())
    for number, (combination, unit, value, std) in enumerate(zip(*columns, strict=True), 1):
        percent = 100 * TWO_SIDED * std / abs(value) if value and np.isfinite(std) else None
        bar = "" if percent is None else Bar(f"{figure(percent, 2)} %", percent)
        bounds.append((str(number), combination, *with_interval(value, std), unit, bar))
    sections = [
        Section(title, (Cells(("joint", "rms as described>", *heads), rows), Key(CURVE_KEY), folds)),
        *([] if result.signs is None else drawn_signs(result.signs, torque_units(result.robot), level=3)),
        Section("Laws at the joints", (Cells(("joint", "law", "parameter", "value>", "± 95 %>", "unit"), laws),)),
        Section(
            "Base parameters",
            (
                Legend(BASE_LEGEND),
                Cells(("#>", "combination", "value>", "± 95 %>", "unit", "of value>"), bounds),
                Plots([correlation_plot(result.estimate.covariance)]),
                Legend(together),
                Sentences(pairs),
            ),
        ),
        Section("Bodies", (Plain(consistent_words(result)), Cells(BODIES, _links(result)), Legend(CONSISTENT))),
        Section("Excitation", (Plain(excited_words(result.excitation)), Plots([excitation_plot(result.excitation)]))),
        Section("Method", (Legend(method),)),
    ]
    counted, r2 = plural(base.rank, "base parameter"), result.fit.held_out_r2[np.isfinite(result.fit.held_out_r2)]
    quality = f"; held-out R2 at least {determination(r2.min())}" if len(r2) else ""
    header = Header(
        f"{name}: {counted}",
        f"identification of {name}: dynamics model from recordings",
        [card for card in _cards(result, order[0]) if "-" not in card.figure.split()],
        "unreliable" if result.flags else "",
        f"{name}: {counted} of {plural(len(result.robot.joints), 'joint')}{quality}",
    )
    return sections_page(header, sections, shared(result, [result.robot], inputs, command))


def _cards(result: Identification, j: int) -> Iterator[Card]:
    fit = result.fit
    beside = f"worst joint; noise floor {figure(fit.noise_floor[j], 2)} {fit.unit[j]}"
    size = f"{figure(fit.held_out_rms[j])} {fit.unit[j]}"
    yield Card(f"residual torque of {fit.joints[j]}, held out", size, beside)
    shares = result.excitation.shares
    least = share(max(float(shares[0]), 0.0)) if len(shares) else "-"
    yield Card("excitation, weakest direction", least, f"{share(MIN_INFO)} of the information of random motion needed")
    yield from (Card(*x.titled) for x in whole_numbers(result))


def _links(result: Identification) -> list[tuple[str, ...]]:
    """Described and identified mass and centre of mass, and smallest eigenvalue of the pseudo-inertia, per link."""
    rows = []
    columns = (result.robot.links, stated_inertials(result.robot), result.parameters.bodies())
    for link, stated, identified in zip(*columns, strict=True):
        masses, centres = [float(body[0]) for body in (stated, identified)], []
        for mass, body in zip(masses, (stated, identified), strict=True):  # less than a nanometre is rounding error
            in_mm = [round(1e3 * float(moment) / mass, 6) for moment in body[1:4]] if mass else []
            centres.append(", ".join(map(figure, in_mm)) or "-")
        least = float(np.linalg.eigvalsh(pseudo_inertia(identified))[0])
        rows.append((link, *map(figure, masses), *centres, figure(least, 2)))
    return rows


def inspection_document(inspection: Inspection, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid inspect --json`; `inputs` defaults to the robot description."""
    robot = inspection.robot
    return {
        "schema": "signid.inspection/1",
        "robot": robot.name,
        "joints": joint_documents(robot),
        "links": list(robot.links),
        "base_parameters": base_documents(inspection.base),
        **picked(inspection, "invisible combined"),
        "suspect": [suspect._asdict() for suspect in inspection.suspect],
        "flags": list(inspection.flags),
        "notes": list(robot.notes),
        **provenance((), inputs or [description(robot)], seed),
    }


def inspection_tables(inspection: Inspection) -> list[RenderableType]:
    """Joints, links, base parameters as formulas, and unidentifiable parameters."""
    robot, base = inspection.robot, inspection.base
    formulas = new_table("base parameter", "unit", rows=zip(base.expressions, base.units, strict=True))
    bodies: dict[int | None, list[str]] = {}
    for label in base.invisible:
        bodies.setdefault(label.body, []).append(label.name)
    hidden = new_table("link", "standard parameters")
    for body, names in bodies.items():
        hidden.add_row("(actuators)" if body is None else f"{body + 1}  {robot.links[body]}", ", ".join(names))
    size = f"{plural(len(robot.joints), 'joint')}, {plural(len(robot.links), 'moving link')}"
    counted = f"{base.rank} base parameters, combinations of {len(base.labels)} standard parameters"
    return [
        heading(f"{robot.name}: {size}", below=False),
        *joint_table(robot),
        heading(f"{counted} (indices: moving links)"),
        formulas,
        *([heading("Unidentifiable from any motion"), hidden] if base.invisible else []),
        paragraph(f"{plural(len(inspection.combined), 'standard parameter')}: identifiable only in combination."),
        *note_lines(robot.notes),
    ]


def joint_table(robot: Robot) -> list[RenderableType]:
    """Joints with their limits; a type or unit that all joints have stands once, below the table."""
    joints = joint_documents(robot)
    equal = {key: joints[0][key] for key in ("type", "unit") if len({joint[key] for joint in joints}) == 1}
    common = ["type", "unit"] if len(equal) == 2 and len(joints) > 1 else []
    table = new_table(*(head for head in HEADS if head not in common))
    for joint in joints:
        name, number, kind, link, *limits, unit = joint.values()
        cells = dict(zip(HEADS, (name, str(number), kind, name_cell(link), *map(figure, limits), unit), strict=True))
        table.add_row(*(cell for head, cell in cells.items() if head not in common))
    effort = "N" if equal.get("type") == "prismatic" else "N.m"
    said = f"All joints are {equal.get('type')}: limits in {equal.get('unit')}, {equal.get('unit')}/s and {effort}."
    return [table, *([paragraph(said)] if common else [])]


def joint_documents(robot: Robot) -> list[Document]:
    """Actuated joints; limits in `unit`, `unit`/s and N.m or N, infinite if not stated."""
    bounded = np.isfinite(robot.upper - robot.lower)
    return [
        {
            "name": name,
            "number": robot.numbers[j],
            "type": "prismatic" if robot.prismatic[j] else "revolute" if bounded[j] else "continuous",
            "link": _link(robot, j),
            "lower": float(robot.lower[j]),
            "upper": float(robot.upper[j]),
            "velocity_limit": float(robot.velocity_limit[j]),
            "effort_limit": float(robot.effort_limit[j]),
            "unit": unit,
        }
        for j, (name, unit) in enumerate(zip(robot.joints, position_units(robot), strict=True))
    ]


def _link(robot: Robot, j: int) -> str:
    """Name of the link that the joint moves; a joint's own link precedes links of mimic joints."""
    rows = np.flatnonzero(robot.drive[:, j])
    bodies = zip(list(robot.model.names)[1:], list(robot.model.joints)[1:], robot.links, strict=True)
    moved = [
        (name != robot.joints[j], link)
        for name, joint, link in bodies
        if np.any((rows >= joint.idx_v) & (rows < joint.idx_v + joint.nv))
    ]
    return min(moved, key=lambda entry: entry[0])[1] if moved else ""


def payload_document(payload: Payload, inputs: Sequence[Input] = ()) -> Document:
    """Build the output of `signid payload --json`; `inputs` besides the recordings default to the description."""
    parts: dict[str, Any] = {}
    if payload.found:
        parts = {"mass": (payload.mass, "kg"), "centre": (payload.centre, "m"), "inertia": (payload.inertia, "kg.m^2")}
    effect = {"effect": payload.law.effect.name, "parameters": dict(payload.law.parameters)} if payload.found else None
    moments = [{"t": m.t, "std": m.std, "unit": "s", "picked_up": m.picked_up} for m in payload.moments]
    return {
        "schema": "signid.payload/1",
        "robot": payload.robot.name,
        "link": payload.link,
        "found": payload.found,
        **{key: {"value": value, "std": std, "unit": unit} for key, ((value, std), unit) in parts.items()},
        "effect": effect,
        "moments": moments,
        "physically_consistent": payload.found,
        **picked(payload, "moved misfit"),
        "cutoff": {"torque": payload.cutoff, "unit": "Hz"},
        **ending(payload, payload.inputs, inputs or [description(payload.robot)], payload.seed),
    }


def payload_numbers(payload: Payload) -> list[Quantity]:
    """Numbers of the load and its moments, from which tables and frames follow."""
    centre = zip((f"centre_{axis}" for axis in "xyz"), *payload.centre, ["m"] * 3, strict=True)
    load = [("mass", *payload.mass, "kg"), *centre, *zip(INERTIAL[4:], *payload.inertia, ["kg.m2"] * 6, strict=True)]
    moments = [("picked_up" if x.picked_up else "put_down", x.t, x.std, "s") for x in payload.moments]
    numbers = [*(load if payload.found else []), *moments]
    return [Quantity(name, float(value), float(std), unit) for name, value, std, unit in numbers]


def payload_tables(payload: Payload) -> list[RenderableType]:
    """Mass, centre of mass and inertia with their intervals; moments, or the notes alone without a load."""
    head = heading(f"{payload.robot.name}: payload of {payload.link}, in its joint frame", below=False)
    if not payload.found:
        return [head, paragraph("No load was found."), *note_lines(payload.notes)]
    rows = []
    for x in payload_numbers(payload):
        title = spaced(x.name).replace("centre", "centre of mass") + (
            " at" if x.name in ("picked_up", "put_down") else ""
        )
        rows.append((f"{x.name} about its centre" if x.name in INERTIAL else title, *x.interval("-"), x.unit))
    change = f"this changed the difference of base parameters by at most {payload.moved:.1f} standard deviations"
    sentence = f"The inertia is physically consistent; {change}. Cut-off {payload.cutoff:.3g} Hz."
    section = Section("", (Cells(("payload", "value>", "± (95 %)>", "unit"), rows), Plain(sentence)))
    return [head, *terminal([section], payload.notes)]
