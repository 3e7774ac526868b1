"""Identification of a robot: JSON document, terminal tables and page; parameters and sentences."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType

from ....effects.base import Effect
from ....estimation.excitation import MIN_INFO
from ....model import standard_parameters, stated_inertials
from ....types import TWO_SIDED, Array, BaseMap, Input, Law, pseudo_inertia
from ..documents import Document, description, ending, excitation_verdict, fit_document, opening, recorded, rms
from ..layout import determination, figure, heading, plural, share, torque_units, with_interval
from ..plots.courses import held_out_rows, joint_plots, worst
from ..plots.frame import Header, sections_page, shared
from ..plots.heat import correlation_plot, excitation_plot, tied
from ..quantities import Quantity, effect_document, grid, law_numbers, spaced
from ..sections import Bar, Card, Cells, Folds, Key, Legend, Plain, Plots, Section, Sentences, terminal
from .laws import law_document
from .signs import drawn_signs, signs_document, signs_sections

if TYPE_CHECKING:
    from ....estimation.excitation import ExcitationVerdict
    from ....estimation.fit_quality import Fit
    from ....identify import Identification
    from ....simulation.refine import Refinement

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


def identified_numbers(result: Identification) -> list[list[Quantity]]:
    """Parameters of each law of the model, from which all outputs follow; std is None in combinations alone."""
    singles, places = _alone(result.base), defaultdict[int, list[int]](list)
    for k, label in enumerate(result.base.labels):
        if label.law is not None:
            places[label.law].append(k)
    found = [(x, _deviations(result, x, [singles.get(k) for k in places[i]])) for i, x in enumerate(result.model.laws)]
    own = [(law, dict(zip(law.effect.linear(), std, strict=True))) for law, std in result.currents]
    currents = [[x._replace(unit=_in_amperes(x.unit)) for x in law_numbers(result.robot, *pair)] for pair in own]
    return [*(law_numbers(result.robot, *pair) for pair in found), *currents]


def whole_numbers(result: Identification) -> list[Quantity]:
    """Numbers of the whole result, from which all outputs follow."""
    verdict = "consistent" if result.physically_consistent else "inconsistent"
    card = ("physical consistency", verdict, f"changed by at most {result.moved:.1f} standard deviations")
    return [Quantity("moved", float(result.moved), None, "1", words=consistent_words(result), card=card)]


def _in_amperes(unit: str) -> str:
    """Unit of a number of a law in the current of a joint without a torque constant."""
    return "A.s2/rad" if unit == "kg.m2" else unit.replace("N.m", "A").replace("N", "A")


def _alone(base: BaseMap) -> dict[int, int]:
    """Individually identifiable standard parameters: index of each -> index of its base parameter."""
    terms = np.count_nonzero(base.combination, axis=1)
    return {int(lead): row for row, lead in enumerate(base.independent) if terms[row] == 1}


def _rigid_rows(base: BaseMap) -> list[int]:
    """Base parameters other than a single coefficient of a law."""
    singles = _alone(base)
    laws = {singles[k] for k, label in enumerate(base.labels) if label.law is not None and k in singles}
    return [row for row in range(base.rank) if row not in laws]


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
    robot, values = result.robot, zip(result.base_value, result.estimate.std, result.estimate.value, strict=True)
    return {
        **opening("signid.identification/1", robot),
        "base_parameters": [
            {**combination, "value": float(value), "std": float(std), "estimate": float(estimate)}
            for combination, (value, std, estimate) in zip(base_documents(result.base), values, strict=True)
        ],
        "standard_parameters": standard_parameters(robot, result.parameters.bodies()),
        "physically_consistent": result.physically_consistent,
        **{x.name: x.value if x.known else None for x in whole_numbers(result)},
        "effects": [effect_document(some[0].law, some[0].joint, some) for some in identified_numbers(result)],
        "signs": None if result.signs is None else signs_document(result.signs),
        "fit": {**fit_document(result.fit), "refit": result.fit.refit},
        "lacks": [{key: x for key, x in list(vars(lack).items())[:4]} for lack in result.lacks],
        "varies": [one._asdict() for one in result.varies],
        **({} if result.refinement is None else {"refinement": _refinement(result, result.refinement)}),
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
    rows = [
        (base.expressions[k], *with_interval(result.base_value[k], result.estimate.std[k]), base.units[k])
        for k in _rigid_rows(base)
    ]
    sentences = (
        excited_words(result.excitation),
        *(x.sentence for x in whole_numbers(result)),
        f"{cutoff_words(result.cutoff, result.position_cutoff)}; {result.estimate.method}.",
    )
    sections = [
        Section("", (Cells(("base parameter", "value>", "± (95 %)>", "unit"), rows),)),
        _laws([number for numbers in identified_numbers(result) for number in numbers]),
        *([] if result.signs is None else signs_sections(result.signs)),
        Section("Fit: rms of the residual torque", (Cells(heads, list(fit_rows(result.fit))), Sentences(sentences))),
        _refined(result),
    ]
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


def excited_words(found: ExcitationVerdict) -> str:
    """The verdict on the excitation in one or two sentences."""
    least = share(max(float(found.shares[0]), 0.0)) if len(found.shares) else "0 %"
    reached = f"the weakest direction has {least} of the information of a random motion of the same size"
    verdict = "sufficient" if found.sufficient else "insufficient"
    sentence = f"Excitation {verdict}: {reached} ({share(MIN_INFO)} needed)."
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


def _refinement(result: Identification, found: Refinement) -> Document:
    """Build the block `refinement` of identification.json."""
    return {
        "kept": found.kept,
        "windows": list(found.lengths),
        "before": [float(x) for x in found.before],
        "after": [float(x) for x in found.after],
        "unit": list(found.unit),
        "effects": [
            {
                **law_document(result.robot, law),
                "parameters": {x.name: x.value for x in law_numbers(result.robot, law, {})},
            }
            for law in result.best.laws
        ],
    }


def _refined(result: Identification) -> Section:
    """Numbers of the laws in model.json, if roll-outs refined them."""
    found, model = result.refinement, result.refined
    if found is None or model is None:
        return Section("", ())
    numbers = [n for law in model.laws for n in law_numbers(model.robot, law, {})]
    rows = [(n.place, spaced(n.law), n.name, n.text, n.unit) for n in numbers]
    table = Cells(("joint", "law", "parameter", "value>", "unit"), rows)
    return Section("Refined by roll-outs: laws of model.json", (table, Plain(f"{found.sentence}.".capitalize())))


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
    sections = [
        _held_out(result, order),
        *([] if result.signs is None else drawn_signs(result.signs, torque_units(result.robot), level=3)),
        Section("Laws at the joints", (Cells(("joint", "law", "parameter", "value>", "± 95 %>", "unit"), laws),)),
        Section(
            "Base parameters",
            (
                Legend(BASE_LEGEND),
                Cells(("#>", "combination", "value>", "± 95 %>", "unit", "of value>"), list(_bounds(result))),
                Plots([correlation_plot(result.estimate.covariance)]),
                Legend(together),
                Sentences(pairs),
            ),
        ),
        Section("Bodies", (Plain(consistent_words(result)), Cells(BODIES, list(_links(result))), Legend(CONSISTENT))),
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


def _held_out(result: Identification, order: Sequence[int]) -> Section:
    """Fit on what was held out, beside that of the description, and torque over time."""
    title, heads = "Fit on held-out data", ("rms in training>", "rms held out>", "noise floor>", "unit", "R2 held out>")
    course, whole = held_out_rows(result.session, result.judged)
    before = replace(result.fit, held_out_rms=rms(course.before))
    rows = list(fit_rows(result.fit, before.held_out_rms))
    note = f"Residual is measured - predicted torque, low-passed at {figure(result.cutoff)} Hz. Thick lines: means."
    note += "" if whole else " Beginning of the held-out data."
    folds = Folds(note, joint_plots(course, before, result.fit, order))
    return Section(title, (Cells(("joint", "rms as described>", *heads), rows), Key(CURVE_KEY), folds))


def _cards(result: Identification, j: int) -> Iterator[Card]:
    fit = result.fit
    beside = f"worst joint; noise floor {figure(fit.noise_floor[j], 2)} {fit.unit[j]}"
    size = f"{figure(fit.held_out_rms[j])} {fit.unit[j]}"
    yield Card(f"residual torque of {fit.joints[j]}, held out", size, beside)
    shares = result.excitation.shares
    least = share(max(float(shares[0]), 0.0)) if len(shares) else "-"
    yield Card("excitation, weakest direction", least, f"{share(MIN_INFO)} of the information of random motion needed")
    yield from (Card(*x.titled) for x in whole_numbers(result))


def _bounds(result: Identification) -> Iterator[tuple[str, ...]]:
    """Base parameters with their intervals, and the half-width over the value."""
    columns = (result.base.expressions, result.base.units, result.base_value.tolist(), result.estimate.std.tolist())
    for number, (name, unit, value, std) in enumerate(zip(*columns, strict=True), 1):
        percent = 100 * TWO_SIDED * std / abs(value) if value and np.isfinite(std) else None
        bar = "" if percent is None else Bar(f"{figure(percent, 2)} %", percent)
        yield str(number), name, *with_interval(value, std), unit, bar


def _links(result: Identification) -> Iterator[tuple[str, ...]]:
    """Described and identified mass and centre of mass, and smallest eigenvalue of the pseudo-inertia, per link."""
    columns = (result.robot.links, stated_inertials(result.robot), result.parameters.bodies())
    for link, stated, found in zip(*columns, strict=True):
        least = float(np.linalg.eigvalsh(pseudo_inertia(found))[0])
        centres = (_centre(inertial) for inertial in (stated, found))
        yield link, figure(float(stated[0])), figure(float(found[0])), *centres, figure(least, 2)


def _centre(inertial: Array) -> str:
    """Format a centre of mass [mm]; less than a nanometre is rounding error."""
    mass = float(inertial[0])
    return ", ".join(figure(round(1e3 * float(x) / mass, 6)) for x in inertial[1:4]) if mass else "-"
