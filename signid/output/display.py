"""Results in a Python session: text of at most 40 lines, HTML in notebooks, tables by name, saved models."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from html import escape
from io import StringIO
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..errors import OutputError
from ..model import stated_inertials
from ..servos import SERVO_NUMBERS, SERVO_UNITS
from ..types import Recording, Robot
from .frames import frame as frame, frame_names
from .report.documents import rms, tables as command_tables, to_json
from .report.layout import figure, heading, new_table, note_lines, paragraph, plural, share, with_interval
from .report.quantities import law_document
from .report.results.fleet import fleet_tables
from .report.results.identification import fit_rows, joint_table
from .report.results.signs import signs_tables
from .report.write import write_files

if TYPE_CHECKING:
    from ..model import Model

MAX_LINES, WIDTH = 40, 100  # lines, and characters per line, of a repr
MIN_SECTION_LINES = 3  # lines that a shortened section keeps: blank line, heading, number of the others
SHORTENED_FIRST = ("Alternatives", "Small corrections", "Residual of the simulation")  # headings
ROWS, MAX_FLAGS, MAX_BLOCKS = 12, 12, 20  # in HTML: rows per table, flags, and tables and sentences
CELL_STYLE = "text-align:{};white-space:nowrap;padding:2px 10px 2px 0"
Renderables = list[RenderableType]
MAX_FORMULA_LENGTH = 60  # characters of a formula, before the number of its other terms


def text(result: Any) -> str:
    """Text of a result as the terminal shows it, without colours; long sections are shortened."""
    shown = tables(result)
    flags = [line for flag in _flags(result, shown) for line in _lines(Text(f"flag: {flag}"))]
    last = [line for names in _names(result) for line in _lines(Text(names))]
    blocks: list[list[str]] = [[]]
    for line in (line for block in shown for line in _lines(block)):
        if not line and blocks[-1]:
            blocks.append([])
        blocks[-1] += [line] if line or len(blocks) > 1 else []
    sections, max_lines = [*blocks, flags], MAX_LINES - len(last)
    limits = [len(section) for section in sections]
    if sum(limits) > max_lines:
        aside = ["".join(lines[1:2]).startswith(SHORTENED_FIRST) for lines in sections]  # headings below a blank line
        limits = [min(n, MIN_SECTION_LINES) if small else n for n, small in zip(limits, aside, strict=True)]
    while sum(limits) > max_lines and max(limits) > MIN_SECTION_LINES:
        limits[max(range(len(limits)), key=lambda k: (limits[k], k))] -= 1
    printed: list[str] = []
    for section, limit in zip(sections, limits, strict=True):
        hidden = len(section) - limit + 1
        printed += section if len(section) <= limit else [*section[: limit - 1], f"... and {hidden} more lines"]
    if len(printed) > max_lines:
        printed[max_lines - 1 :] = [f"... and {len(printed) - max_lines + 1} more lines"]
    return "\n".join([*printed, *last])


def html(result: Any) -> str:
    """HTML of a result for notebooks; names and sentences are escaped, long tables shortened."""
    blocks = tables(result)
    flags = [_paragraph(f"flag: {flag}", "color:#b3261e") for flag in _flags(result, blocks)[:MAX_FLAGS]]
    more = [_paragraph(f"and {len(blocks) - MAX_BLOCKS} more")] if len(blocks) > MAX_BLOCKS else []
    names = [_paragraph(line, "color:#8a94a0") for line in _names(result)]
    return f'<div class="signid">{"".join([*flags, *map(_element, blocks[:MAX_BLOCKS]), *more, *names])}</div>'


def _flags(result: Any, shown: Sequence[RenderableType]) -> list[str]:
    """Flags that are no sentence of the tables."""
    said = {_plain_text(block) for block in shown}
    return [flag for flag in getattr(result, "flags", ()) if flag not in said]


def _names(result: Any) -> list[str]:
    """A line with the names of the tables, if there are any."""
    return [f"tables, to_frame(name): {', '.join(names)}"] if (names := frame_names(result)) else []


def _lines(block: RenderableType) -> list[str]:
    # force_jupyter: in a notebook, rich would show each block as an output of its own
    console = Console(
        file=StringIO(), width=WIDTH, color_system=None, markup=False, highlight=False, emoji=False, force_jupyter=False
    )
    with console.capture() as shown:
        console.print(block)
    return [line.rstrip() for line in shown.get().splitlines()]


def _element(block: RenderableType) -> str:
    if isinstance(block, Padding):
        return f'<div style="margin-left:16px">{_element(block.renderable)}</div>'
    if isinstance(block, Table):
        return _table(block)
    bold = isinstance(block, Text) and any("bold" in str(part) for part in (block.style, *block.spans))
    return _paragraph(_plain_text(block), "font-weight:600" if bold else "")


def _paragraph(sentence: str, style: str = "") -> str:
    return f'<p style="margin:4px 0;{style}">{escape(sentence.strip())}</p>'


def _table(table: Table) -> str:
    def row(kind: str, cells: Iterable[RenderableType]) -> str:
        styled = zip(cells, (CELL_STYLE.format(column.justify) for column in table.columns), strict=True)
        return "".join(f'<{kind} style="{style}">{escape(_plain_text(cell))}</{kind}>' for cell, style in styled)

    rows = list(zip(*(column.cells for column in table.columns), strict=True))
    heads, body = row("th", (column.header for column in table.columns)), [row("td", cells) for cells in rows[:ROWS]]
    lines = "".join(f"<tr>{line}</tr>" for line in body)
    more = _paragraph(f"and {len(rows) - ROWS} more rows") if len(rows) > ROWS else ""
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{lines}</tbody></table>{more}"


def _plain_text(block: RenderableType) -> str:
    return block.plain if isinstance(block, Text) else str(block)


def tables(result: Any) -> Renderables:
    """Heading, tables and notes of a result."""
    return TABLES.get(type(result).__name__, command_tables)(result)


def _robot(robot: Robot) -> Renderables:
    size = f"{plural(len(robot.joints), 'joint')}, {plural(len(robot.links), 'moving link')}"
    return [heading(f"{robot.name}: {size}", below=False), *joint_table(robot), *note_lines(robot.notes)]


def _recording(recording: Recording) -> Renderables:
    rows = len(recording)
    first, last = (float(recording.read(k, k + 1).t[0]) if rows else 0.0 for k in (0, rows - 1))
    title = f"{Path(recording.path).name or 'recording'}: {plural(rows, 'row')}, {figure(last - first)} s"
    table = new_table("joint", "columns", "torque")
    columns = [group for key, group in recording.columns.items() if key != "t" and group]
    for j, joint in enumerate(recording.joints):
        known = ("signed" if recording.signed[j] else "absolute") if recording.columns["tau"][j] else "not recorded"
        table.add_row(joint, ", ".join(group[j] for group in columns if group[j]), known)
    return [heading(title, below=False), table, *note_lines(recording.notes)]


def _model(model: Any) -> Renderables:
    robot, laws, servos = model.robot, model.laws_beside_drives, model.servos
    title = f"{robot.name}: model of {plural(len(robot.links), 'link')} with {plural(len(laws), 'law')}"
    bodies = new_table("link", "mass>", "stated>", "unit", "centre of mass [m]")
    for link, x, stated in zip(robot.links, model.inertials, stated_inertials(robot), strict=True):
        centre = ", ".join(figure(round(float(c), 9)) for c in x[1:4] / x[0]) if x[0] else "-"  # 1 nm: rounding
        bodies.add_row(link, figure(float(x[0])), figure(float(stated[0])), "kg", centre)
    numbers = new_table("law", "joint", "parameter", "value>", "unit")
    for law in laws:
        entry = law_document(robot, law)
        for key, number in entry["parameters"].items() or [("", {"value": "", "unit": ""})]:
            value = figure(number["value"]) if isinstance(number["value"], float) else str(number["value"])
            numbers.add_row(entry["effect"], entry["joint"] or "(robot)", key, value, number["unit"])
    used = [name for name in SERVO_NUMBERS if any(0 < abs(getattr(x, name)) < inf for x in servos.values())]
    heads = [f"{name.replace('_', ' ')}\n[{SERVO_UNITS[name]}]>" for name in used]
    rows = ([joint, x.law, *(figure(getattr(x, name)) for name in used)] for joint, x in servos.items())
    drives = [heading("Position drives"), new_table("joint", "law", *heads, rows=rows)] if servos else []
    return [heading(title, below=False), bodies, *([heading("Laws"), numbers] if laws else []), *drives]


def _base(base: Any) -> Renderables:
    sees = (plural(int(count), "joint") for count in base.sees.sum(axis=0))
    rows = zip(map(_brief, base.expressions), base.units, sees, strict=True)
    title = heading(f"{plural(base.rank, 'base parameter')} of {len(base.labels)} standard parameters", below=False)
    table = new_table("base parameter", "unit", "in the torque of", rows=rows)
    return [title, table, paragraph("Values and intervals: estimate of an identification.")]


def _estimate(result: Any) -> Renderables:
    count = len(result.value)
    names, units = result.names or [str(k + 1) for k in range(count)], result.units or [""] * count
    numbers = (with_interval(float(x), float(std)) for x, std in zip(result.value, result.std, strict=True))
    rows = ((_brief(name), *number, unit) for name, number, unit in zip(names, numbers, units, strict=True))
    title = heading(f"{plural(count, 'base parameter')} by {result.method}", below=False)
    return [title, new_table("base parameter", "value>", "± (95 %)>", "unit", rows=rows), *note_lines(result.notes)]


def _brief(formula: str) -> str:
    """A formula of at most LONGEST characters: its first terms, and the number of the others."""
    terms = re.split(r" (?=[+-] )", formula)
    if len(formula) <= MAX_FORMULA_LENGTH or len(terms) == 1:
        return formula
    kept, text = 1, terms[0]
    while len(longer := f"{text} {terms[kept]}") <= MAX_FORMULA_LENGTH - len(" ... and 99 more"):
        kept, text = kept + 1, longer
    return f"{text} ... and {len(terms) - kept} more"


def _fit(fit: Any) -> Renderables:
    heads = ("joint", "training>", "held out>", "noise floor>", "unit", "R2 held out>")
    return [heading("Fit: rms of the residual torque", below=False), new_table(*heads, rows=fit_rows(fit))]


def _roll_out(rolled: Any) -> Renderables:
    errors = (map(figure, rolled.rms(horizon)) for horizon in rolled.horizons)
    heads = (f"after {horizon:g} s>" for horizon in rolled.horizons)
    table = new_table("joint", *heads, "unit", rows=zip(rolled.joints, *errors, rolled.unit, strict=True))
    title = f"{plural(len(rolled.start), 'roll-out')} from measured states: rms position error"
    return [heading(title, below=False), table, *note_lines(rolled.notes)]


def _validated(model: Any) -> Renderables:
    rolled = [] if model.rollout is None else _roll_out(model.rollout)
    return [heading(model.name, below=False), *_fit(model.fit), *rolled]


def _validated_drives(model: Any) -> Renderables:
    rows = zip(model.rollout.joints, map(figure, model.rollout.whole_rms), model.rollout.units, strict=True)
    table = new_table("joint", "rms of a whole recording>", "unit", rows=rows)
    return [heading(f"{model.name}: closed loop from commands alone", below=False), table]


def _simulation(simulation: Any) -> Renderables:
    sizes = (map(figure, x) for x in (simulation.q.min(axis=0), simulation.q.max(axis=0), rms(simulation.tau)))
    heads = ("joint", "lowest position>", "highest position>", "rms torque>")
    seconds = figure(float(simulation.t[-1] - simulation.t[0]))
    title = f"simulation: {plural(len(simulation.t), 'row')}, {seconds} s; rad or m, N.m or N"
    return [heading(title, below=False), new_table(*heads, rows=zip(simulation.joints, *sizes, strict=True))]


def _motion(result: Any) -> Renderables:
    """Use of the limits of an exciting or a separating motion."""
    names, motion = ("position", "velocity", "acceleration", "torque"), result.trajectory
    uses = (map(share, getattr(result.use, name)) for name in names)
    rows = zip(motion.joints, *uses, strict=True)
    table = new_table("share of limit", *(f"{name}>" for name in names), rows=rows)
    size = f"{plural(len(motion.t), 'row')}, {figure(float(motion.t[-1]))} s"
    title = f"motion of {plural(len(motion.joints), 'joint')}: {size}"
    return [heading(title, below=False), table, *note_lines(result.notes)]


TABLES: dict[str, Callable[[Any], Renderables]] = {
    "BaseMap": _base,
    "Estimate": _estimate,
    "Excitation": _motion,
    "Fit": _fit,
    "Fleet": lambda fleet: fleet_tables(fleet.document(), fleet.reused),
    "Model": _model,
    "Recording": _recording,
    "Robot": _robot,
    "RollOut": _roll_out,
    "Separation": _motion,
    "ServoValidatedModel": _validated_drives,
    "Signs": signs_tables,
    "Simulation": _simulation,
    "ValidatedModel": _validated,
}


def save_model(model: Model, path: str | Path) -> Path:
    """Write a model.json; it appears when it is complete.

    Raises:
        OutputError: the name does not end in .json, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix != ".json":
        better = target.with_suffix(".json").name
        raise OutputError(f"a model is saved as JSON, and {target.name} does not end in .json; name it {better}")
    return write_files(target.parent, {target.name: to_json(model.document())}, "another path", named=True)[0]
