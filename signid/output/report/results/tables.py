"""Terminal tables of inspection, check and identification."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ....estimation.excitation import ENOUGH, ExcitationVerdict
from ....estimation.fit_quality import Fit
from ....identify import Identification
from ....recording.sampling import Sampling
from ....types import TWO_SIDED, Label
from ..joints import describe_joints
from ..layout import heading, new_table, note_lines, paragraph, plural
from ..numbers import determination, figure, share, with_interval
from ..quantities import LawNumber, law_numbers, rigid_rows
from .signs import signs_tables

if TYPE_CHECKING:
    from ....check import Check
    from ....inspect import Inspection
    from ....recording_faults import RecordingFaults

WIDE = 4  # maximum number of columns of law parameters
VERDICTS = {"right": "green", "uncertain": "yellow", "wrong": "red"}
STYLES = {"identifiable": "green", "weak": "yellow", "unidentifiable": "red"}


def inspection_tables(found: Inspection) -> list[RenderableType]:
    """Joints, links, base parameters as formulas, and unidentifiable parameters."""
    robot, base = found.robot, found.base
    joints = new_table("joint", "#>", "type", "carries link", "lower>", "upper>", "velocity>", "effort>", "unit")
    for j in describe_joints(robot):
        limits = (figure(x) for x in (j.lower, j.upper, j.velocity_limit, j.effort_limit))
        joints.add_row(j.name, str(j.number), j.type, j.link, *limits, j.unit)
    formulas = new_table("base parameter", "unit")
    for expression, unit in zip(base.expressions, base.units, strict=True):
        formulas.add_row(expression, unit)
    hidden = new_table("link", "standard parameters")
    for body, names in _by_body(base.invisible):
        hidden.add_row("(actuators)" if body is None else f"{body + 1}  {robot.links[body]}", ", ".join(names))
    counted = f"{base.rank} base parameters, combinations of {len(base.labels)} standard parameters"
    return [
        heading(
            f"{robot.name}: {plural(len(robot.joints), 'joint')}, {plural(len(robot.links), 'moving link')}",
            below=False,
        ),
        joints,
        heading(f"{counted} (indices: moving links)"),
        formulas,
        *([heading("Unidentifiable from any motion"), hidden] if base.invisible else []),
        paragraph(f"{plural(len(found.combined), 'standard parameter')}: identifiable only in combination."),
        *note_lines(robot.notes),
    ]


def check_tables(found: Check) -> list[RenderableType]:
    """Sampling, cut-offs, and identifiability of the base parameters."""
    sampling = new_table("recording", "rate [Hz]>", "duration [s]>", "samples>", "gaps>", "step [ms]>")
    for name, s in zip(_short([r.path for r in found.recordings]), found.samplings, strict=True):
        sampling.add_row(name, *_sampling(s))
    joints = new_table("joint", "highest cut-off [Hz]>", "rows used>", "torque noise>", "unit")
    columns = (found.robot.joints, found.band.per_joint, found.used, found.band.torque_floor, found.robot.prismatic)
    for joint, cutoff, used, floor, prismatic in zip(*columns, strict=True):
        joints.add_row(joint, figure(cutoff), share(used), figure(floor, 2), "N" if prismatic else "N.m")
    expected = new_table("base parameter", "± (95 %)>", "unit", "verdict")
    for expression, std, unit, verdict in zip(
        found.base.expressions, found.std, found.base.units, found.verdicts, strict=True
    ):
        expected.add_row(expression, figure(TWO_SIDED * std, 2), unit, Text(verdict, STYLES.get(verdict, "")))
    given = f"{plural(len(found.recordings), 'recording')} of {plural(len(found.robot.joints), 'joint')}"
    counts = ", ".join(f"{found.verdicts.count(verdict)} {verdict}" for verdict in STYLES)
    return [
        heading(f"{found.robot.name}: {given}", below=False),
        sampling,
        heading("Bandwidth allowed by encoder noise"),
        joints,
        paragraph(f"{_cutoffs(found.band.cutoff, found.band.position_cutoff)}."),
        heading("Comparison of the torque with the description"),
        _faults(found.faults),
        heading(f"{found.base.rank} base parameters: {counts}"),
        expected,
        paragraph(excited_words(found.excitation)),
        *(paragraph(f"advice: {sentence}") for sentence in found.advice),
        *note_lines(found.notes),
    ]


def _faults(found: RecordingFaults) -> Table:
    """Share of the torque that the description explains, and verdicts on sign and order, per joint."""
    table = new_table("joint", "explained>", "factor>", "sign", "order")
    columns = (found.joints, found.explained, found.factor, found.signs, found.order)
    for joint, explained, factor, *verdicts in zip(*columns, strict=True):
        texts = (Text(str(verdict), VERDICTS[str(verdict)]) for verdict in verdicts)
        table.add_row(joint, share(float(explained)), figure(float(factor), 2), *texts)
    return table


def identification_tables(result: Identification) -> list[RenderableType]:
    """Base parameters and laws with their intervals, fit, excitation and physical consistency."""
    base = new_table("base parameter", "value>", "± (95 %)>", "unit")
    for row in rigid_rows(result.base):
        interval = with_interval(float(result.base_value[row]), float(result.estimate.std[row]))
        base.add_row(result.base.expressions[row], *interval, result.base.units[row])
    counted = f"{plural(result.base.rank, 'base parameter')}, {plural(len(result.robot.joints), 'joint')}"
    laws = [number for numbers in law_numbers(result) for number in numbers]
    return [
        heading(f"{result.robot.name}: {counted}", below=False),
        base,
        *_laws(laws),
        *([] if result.signs is None else signs_tables(result.signs)),
        heading("Fit: rms of the residual torque"),
        _fit(result.fit),
        paragraph(excited_words(result.excitation)),
        paragraph(consistent_words(result)),
        paragraph(f"{_cutoffs(result.cutoff, result.position_cutoff)}; {result.estimate.method}."),
        *note_lines(result.notes),
    ]


def _short(paths: Sequence[str]) -> Sequence[str]:
    """File names, or paths if two files have the same name."""
    names = [Path(path).name or "(arrays)" for path in paths]
    return names if len(set(names)) == len(names) else paths


def _sampling(found: Sampling) -> tuple[str, ...]:
    """Rate, duration, samples, gaps, jitter."""
    shortest, longest = (figure(1e3 * x) for x in found.jitter)
    spacing = shortest if shortest == longest else f"{shortest} to {longest}"
    rate = figure(1 / found.period, 4)
    return rate, figure(found.duration), str(found.rows), str(len(found.spans) - 1), spacing


def _laws(numbers: Sequence[LawNumber]) -> list[RenderableType]:
    """A table with one row per joint, or one row per parameter if there are too many columns."""
    kinds = list(dict.fromkeys((n.effect, n.key) for n in numbers))
    if not kinds:
        return []
    table = _law_grid(numbers, kinds) if len(kinds) <= WIDE else _law_list(numbers)
    combined = any(n.std is None for n in numbers)
    note = [paragraph("In parentheses: identifiable only in combination with other parameters.")] if combined else []
    return [heading("Laws at the joints, ± 95 %"), table, *note]


def _law_list(numbers: Sequence[LawNumber]) -> Table:
    table = new_table("joint", "law", "parameter", "value>", "unit")
    for n in numbers:
        table.add_row(n.joint or "(robot)", n.effect.replace("_", " "), n.key.replace("_", " "), _law_cell(n), n.unit)
    return table


def _law_grid(numbers: Sequence[LawNumber], kinds: Sequence[tuple[str, str]]) -> Table:
    lines: dict[str, dict[tuple[str, str], LawNumber]] = {}
    for n in numbers:
        lines.setdefault(n.joint or "(robot)", {})[n.effect, n.key] = n
    heads = [f"{effect.replace('_', ' ')}\n{key} [{_units(numbers, effect, key)}]>" for effect, key in kinds]
    table = new_table("joint", *heads)
    for joint, line in lines.items():
        table.add_row(joint, *(_law_cell(line.get(kind)) for kind in kinds))
    return table


def _law_cell(number: LawNumber | None) -> str:
    if number is None:
        return ""
    if number.std is None:
        return f"({figure(number.value)})"
    return " ± ".join(text for text in with_interval(number.value, number.std) if text != "-")


def _units(numbers: Iterable[LawNumber], effect: str, key: str) -> str:
    return " or ".join(dict.fromkeys(n.unit for n in numbers if (n.effect, n.key) == (effect, key)))


def _fit(fit: Fit) -> Table:
    table = new_table("joint", "training>", "held out>", "noise floor>", "unit", "R2 held out>")
    columns = (fit.joints, fit.train_rms, fit.held_out_rms, fit.noise_floor, fit.unit, fit.held_out_r2)
    for joint, train, held_out, floor, unit, r2 in zip(*columns, strict=True):
        table.add_row(joint, figure(train), figure(held_out), figure(floor, 2), unit, determination(r2))
    return table


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


def _cutoffs(torque: float, position: float) -> str:
    return f"Cut-off {figure(torque)} Hz for torque and {figure(position)} Hz for positions (set with --cutoff)"


def _by_body(labels: Sequence[Label]) -> list[tuple[int | None, list[str]]]:
    bodies: dict[int | None, list[str]] = {}
    for label in labels:
        bodies.setdefault(label.body, []).append(label.name)
    return list(bodies.items())
