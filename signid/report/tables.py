"""What is found, for the eye: tables and sentences that rich prints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ..check import Check
from ..excitation import ENOUGH, Excitation
from ..fit import Fit
from ..identify import Identification
from ..inspect import Inspection
from ..sampling import Sampling
from ..types import Label
from .joints import describe_joints
from .numbers import TWO_SIDED, determination, figure, share, with_interval
from .quantities import LawNumber, law_numbers, rigid_rows

WIDE = 4  # kinds of numbers side by side, at most
STYLES = {"told": "green", "weak": "yellow", "not told": "red"}


def inspection_tables(found: Inspection) -> list[RenderableType]:
    """Joints, links, base parameters as formulas, and what no motion can tell."""
    robot, base = found.robot, found.base
    joints = _table("joint", "#>", "type", "carries link", "lower>", "upper>", "velocity>", "effort>", "unit")
    for j in describe_joints(robot):
        limits = (figure(x) for x in (j.lower, j.upper, j.velocity_limit, j.effort_limit))
        joints.add_row(j.name, str(j.number), j.type, j.link, *limits, j.unit)
    formulas = _table("base parameter", "unit")
    for expression, unit in zip(base.expressions, base.units, strict=True):
        formulas.add_row(expression, unit)
    hidden = _table("link", "standard parameters")
    for body, names in _by_body(base.invisible):
        hidden.add_row("(drives)" if body is None else f"{body + 1}  {robot.links[body]}", ", ".join(names))
    counted = f"{base.rank} base parameters: what torque can tell of {len(base.labels)} standard parameters"
    return [
        _head(
            f"{robot.name}: {_count(len(robot.joints), 'joint')}, {_count(len(robot.links), 'moving link')}",
            below=False,
        ),
        joints,
        _head(f"{counted} (numbers count moving links)"),
        formulas,
        *([_head("No motion can tell"), hidden] if base.invisible else []),
        _sentence(f"{_count(len(found.combined), 'standard parameter')} can be told only in combination with others."),
        *_notes(robot.notes),
    ]


def check_tables(found: Check) -> list[RenderableType]:
    """Sampling, cut-offs, and which base parameters the recordings can tell."""
    sampling = _table("recording", "rate [Hz]>", "duration [s]>", "samples>", "gaps>", "step [ms]>")
    for name, s in zip(_short([r.path for r in found.recordings]), found.samplings, strict=True):
        sampling.add_row(name, *_sampling(s))
    joints = _table("joint", "highest cut-off [Hz]>", "rows used>", "torque noise>", "unit")
    columns = (found.robot.joints, found.band.per_joint, found.used, found.band.torque_floor, found.robot.prismatic)
    for joint, cutoff, used, floor, prismatic in zip(*columns, strict=True):
        joints.add_row(joint, figure(cutoff), share(used), figure(floor, 2), "N" if prismatic else "N.m")
    told = _table("base parameter", "± to expect (95 %)>", "unit", "verdict")
    for expression, std, unit, verdict in zip(
        found.base.expressions, found.std, found.base.units, found.verdicts, strict=True
    ):
        told.add_row(expression, figure(TWO_SIDED * std, 2), unit, Text(verdict, STYLES.get(verdict, "")))
    given = f"{_count(len(found.recordings), 'recording')} of {_count(len(found.robot.joints), 'joint')}"
    counts = ", ".join(f"{found.verdicts.count(verdict)} {verdict}" for verdict in STYLES)
    return [
        _head(f"{found.robot.name}: {given}", below=False),
        sampling,
        _head("What encoder noise allows"),
        joints,
        _sentence(f"{_cutoffs(found.band.cutoff, found.band.position_cutoff)}."),
        _head(f"{found.base.rank} base parameters: {counts}"),
        told,
        _sentence(_excited(found.excitation)),
        *(_sentence(f"advice: {sentence}") for sentence in found.advice),
        *_notes(found.notes),
    ]


def identification_tables(result: Identification) -> list[RenderableType]:
    """Base parameters and laws with their intervals, the fit, and how far it can be trusted."""
    base = _table("base parameter", "value>", "± (95 %)>", "unit")
    for row in rigid_rows(result.base):
        interval = with_interval(float(result.base_value[row]), float(result.estimate.std[row]))
        base.add_row(result.base.expressions[row], *interval, result.base.units[row])
    counted = f"{_count(result.base.rank, 'base parameter')}, {_count(len(result.robot.joints), 'joint')}"
    laws = [number for numbers in law_numbers(result) for number in numbers]
    return [
        _head(f"{result.robot.name}: {counted}", below=False),
        base,
        *_laws(laws),
        _head("Fit: rms of the torque that the model leaves unexplained"),
        _fit(result.fit),
        _sentence(_excited(result.excitation)),
        _sentence(_consistent(result)),
        _sentence(f"{_cutoffs(result.cutoff, result.position_cutoff)}; {result.estimate.method}."),
        *_notes(result.notes),
    ]


def _short(paths: Sequence[str]) -> Sequence[str]:
    """Names of files, or their paths where two files have one name."""
    names = [Path(path).name or "(arrays)" for path in paths]
    return names if len(set(names)) == len(names) else paths


def _sampling(found: Sampling) -> tuple[str, ...]:
    """Rate, duration, samples, gaps, jitter."""
    shortest, longest = (figure(1e3 * x) for x in found.jitter)
    spacing = shortest if shortest == longest else f"{shortest} to {longest}"
    rate = figure(1 / found.period, 4)
    return rate, figure(found.duration), str(found.rows), str(len(found.spans) - 1), spacing


def _laws(numbers: Sequence[LawNumber]) -> list[RenderableType]:
    """A line for each joint, a column for each kind of number; a line for each number where those would not fit."""
    kinds = list(dict.fromkeys((n.effect, n.key) for n in numbers))
    if not kinds:
        return []
    table = _law_grid(numbers, kinds) if len(kinds) <= WIDE else _law_list(numbers)
    combined = any(n.std is None for n in numbers)
    told = [_sentence("In brackets: told only in combination with other parameters.")] if combined else []
    return [_head("Laws at the joints, ± 95 %"), table, *told]


def _law_list(numbers: Sequence[LawNumber]) -> Table:
    table = _table("joint", "law", "number", "value>", "unit")
    for n in numbers:
        table.add_row(n.joint or "(robot)", n.effect.replace("_", " "), n.key.replace("_", " "), _law_cell(n), n.unit)
    return table


def _law_grid(numbers: Sequence[LawNumber], kinds: Sequence[tuple[str, str]]) -> Table:
    lines: dict[str, dict[tuple[str, str], LawNumber]] = {}
    for n in numbers:
        lines.setdefault(n.joint or "(robot)", {})[n.effect, n.key] = n
    heads = [f"{effect.replace('_', ' ')}\n{key} [{_units(numbers, effect, key)}]>" for effect, key in kinds]
    table = _table("joint", *heads)
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
    table = _table("joint", "training>", "held out>", "noise floor>", "unit", "R2 held out>")
    columns = (fit.joints, fit.train_rms, fit.held_out_rms, fit.noise_floor, fit.unit, fit.held_out_r2)
    for joint, train, held_out, floor, unit, r2 in zip(*columns, strict=True):
        table.add_row(joint, figure(train), figure(held_out), figure(floor, 2), unit, determination(r2))
    return table


def _excited(found: Excitation) -> str:
    least = share(max(float(found.shares[0]), 0.0)) if len(found.shares) else "0 %"
    told = f"the weakest direction got {least} of the information that random motion of the same size would give"
    verdict = "sufficient" if found.sufficient else "insufficient"
    said = f"Excitation {verdict}: {told} ({share(ENOUGH)} is needed)."
    if found.small:
        be = "is" if len(found.small) == 1 else "are"
        said += f" {_count(len(found.small), 'base parameter')} {be} too small to matter for the torque here."
    return said


def _consistent(result: Identification) -> str:
    if not result.physically_consistent:
        advice = " (method wls does not ask for it)" if result.method == "wls" else ""
        return f"No real robot could have these inertials{advice}."
    if result.method == "wls":
        return "A real robot could have these inertials."
    moved = f"this moved base parameters by at most {result.moved:.1f} standard deviations"
    return f"A real robot could have these inertials; {moved}."


def _cutoffs(torque: float, position: float) -> str:
    return f"Cut-off {figure(torque)} Hz for torque and {figure(position)} Hz for positions (set with --cutoff)"


def _by_body(labels: Sequence[Label]) -> list[tuple[int | None, list[str]]]:
    bodies: dict[int | None, list[str]] = {}
    for label in labels:
        bodies.setdefault(label.body, []).append(label.name)
    return list(bodies.items())


def _table(*heads: str) -> Table:
    """Columns by their heads, to the right where a head ends in >; formulas may wrap, numbers may not."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for head in heads:
        right = head.endswith(">")
        table.add_column(head.removesuffix(">"), justify="right" if right else "left", no_wrap=right, overflow="fold")
    return table


def _head(text: str, below: bool = True) -> RenderableType:
    return Text.assemble("\n" if below else "", (text, "bold"))


def _sentence(text: str) -> RenderableType:
    return Text(text)


def _notes(notes: Iterable[str]) -> list[RenderableType]:
    return [_sentence(f"note: {note}") for note in dict.fromkeys(notes)]


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
