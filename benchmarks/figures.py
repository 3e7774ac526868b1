"""The table of accuracy in README.md, written from JSON files of the benchmarks.

`python -m benchmarks.figures --json-dir DIR [--readme README.md] [--check]`

DIR holds NAME.json of `python -m benchmarks.NAME --json DIR/NAME.json`, or leave_out.json of `concealed_real
--leave-out`. Rows without a file stay. `--check` writes nothing; it exits with 1 if the table differs from the files or
lacks a command or a commit. It also lists sections of benchmarks/README.md whose tables lack one.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SECTION = "## Accuracy"
COMMAND, COMMIT = re.compile(r"`[^`]*\bpython [^`]+`"), re.compile(r"\b(?=\w*[a-f])(?=\w*\d)[0-9a-f]{7}\b")
Document = Mapping[str, Any]


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    quantity: str
    result: str
    source: str  # command and commit

    def __str__(self) -> str:
        return f"| {self.quantity} | {self.result} | {self.source} |"


def coverage(document: Document) -> str:
    """Coverage of nominal intervals by robot, white noise."""
    return ", ".join(f"{x['coverage']:.1f} % ({x['robot']})" for x in document["rows"] if x["noise"] == "white")


def concealed(document: Document) -> str:
    """Sessions with exact inertials and the right first cause, by size of the effect."""
    some = [x for x in document["targets"] if x["words"].startswith("exact, 3 joints and more")]
    return ", ".join(f"{round((x['share'] or 0) * x['of'])} of {x['of']}" for x in some)


def concealed_real(document: Document) -> str:
    """Fair cases that are named first or flagged."""
    return _counted(document["totals"]["named first or flagged (85 %)"])


def leave_out(document: Document) -> str:
    """The same, with constants as they are, chosen without the robot, and with ties decided against it."""
    names = ("constants chosen without the robot", "ties decided against the robot")
    left, worst = (_counted(document["totals"][f"the same, {name}"]) for name in names)
    usual = _counted(document["totals"]["named first or flagged, constants as they are"])
    return f"{usual}; {left}, {worst} if ties are decided against it"


def public(document: Document) -> str:
    """Errors on the EMPS test file: all of signid (the best would be chosen by that file) and the best of others."""
    tested = sorted((x for x in document["rows"] if x["test"] is not None), key=lambda x: float(x["test"]))
    own = [x for x in tested if x["method"].startswith("signid")]
    others = [x for x in tested if x not in own][:1]
    return "; ".join(f"{x['method']}: {x['test']:.3g} mm" for x in (*own, *others))


TABLE: dict[str, tuple[str, Callable[[Document], str]]] = {  # by name of the file: quantity and result
    "coverage": ("nominal 95 % intervals hold the truth (MuJoCo, 5 % noise)", coverage),
    "concealed": (
        "first cause right in MuJoCo, exact inertials, effects of 2 / 5 / 15 % of torque, three joints and more",
        concealed,
    ),
    "concealed_real": ("known changes in identified models of real robots, named first or flagged", concealed_real),
    "leave_out": (
        "known changes of real robots, named; with constants chosen without the robot that judges",
        leave_out,
    ),
    "public": ("EMPS, public test file, simulated open loop: rms error of position", public),
}


def rows(documents: Mapping[str, Document]) -> list[Row]:
    """Rows of the table."""
    found = []
    for name, (quantity, result) in TABLE.items():
        if name in documents:
            origin = documents[name]["origin"]
            found.append(Row(quantity, result(documents[name]), f"`{origin['command']}`, {origin['commit']}"))
    return found


def filled(text: str, new: Sequence[Row]) -> str:
    """Page with rows of the same quantity replaced and others appended to the table of its section."""
    head, tail = text.split(f"{SECTION}\n", 1)
    lines = tail.split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("|"))
    last = next(i for i in range(first, len(lines)) if not lines[i].startswith("|"))
    by_quantity = {row.quantity: str(row) for row in new}
    kept = [by_quantity.pop(line.split("|")[1].strip(), line) for line in lines[first:last]]
    return "\n".join([head + SECTION, *lines[:first], *kept, *by_quantity.values(), *lines[last:]])


def unsourced(text: str) -> Iterator[str]:
    """Yield the headings of sections (##) with figures in a table that lack a command or a commit."""
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        heading, _, body = section.partition("\n")
        figures = re.search(r"^\|[^|\n]*\|[^`\n]*\d", body, re.MULTILINE)
        if figures and not (COMMAND.search(body) and COMMIT.search(body)):
            yield heading


def unsourced_rows(text: str) -> Iterator[str]:
    """Yield the quantities of the table of accuracy that lack a command or a commit."""
    section = text.split(f"{SECTION}\n", 1)[1].split("\n## ", 1)[0]
    for line in [line for line in section.split("\n") if line.startswith("|")][2:]:
        source = line.split("|")[3] if line.count("|") > 3 else ""
        if not (COMMAND.search(source) and COMMIT.search(source)):
            yield line.split("|")[1].strip()


def _counted(share: str) -> str:
    """`67 of 91` of `74 % (67 of 91)`."""
    return share.partition("(")[2].rstrip(")") or share


def main() -> int:
    """Write or check the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.figures", description=__doc__)
    parser.add_argument("--json-dir", type=Path, required=True, metavar="DIR", help="folder of NAME.json")
    parser.add_argument("--readme", type=Path, default=ROOT / "README.md", metavar="FILE", help="page to write")
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if the page is not as written")
    options = parser.parse_args()
    files = {name: options.json_dir / f"{name}.json" for name in TABLE}
    documents = {name: json.loads(file.read_text("utf-8")) for name, file in files.items() if file.exists()}
    text = options.readme.read_text("utf-8")
    written = filled(text, rows(documents))
    lacking = list(unsourced_rows(written))
    for quantity in lacking:
        print(f"no command or commit: {quantity}", file=sys.stderr)
    for heading in unsourced((ROOT / "benchmarks" / "README.md").read_text("utf-8")) if options.check else ():
        print(f"benchmarks/README.md, no command or commit: {heading}", file=sys.stderr)
    if options.check:
        return int(bool(lacking) or written != text)
    options.readme.write_text(written, "utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
