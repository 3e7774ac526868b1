"""Real sets as specifications of IdentiBench: `python -m benchmarks.public_sets DIR [--sets S ...] [--check]`.

Needs SIGNID_DATA, and IdentiBench (`pip install identibench==0.4.0`). Part A of each set is training, B validation and
C test data; rows are those of `benchmarks.blackbox`. `--check` runs three simple models through IdentiBench and
compares its score of least squares with `benchmarks.blackbox`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from signid.errors import SignidError

from ..blackbox import methods
from ..blackbox.task import build
from ..concealed_real.sets import SETS
from ..one_thread import one_thread
from ..summary import finite, frame, print_targets
from .check import check, size
from .specification import specifications
from .stretches import PARTS, set_files
from .write import missing, refusal, write_readme, write_set, write_specification

CLOSE = 1e-4  # [1] largest relative difference of least squares: files have single precision
Row = dict[str, Any]


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.public_sets", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder to write; outside of the repository")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="SET", help=", ".join(SETS))
    parser.add_argument("--check", action="store_true", help="run simple models through IdentiBench")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE as JSON")
    return parser.parse_args()


def main() -> int:
    """Write the sets and print a table; with `--check`, return 1 if a score differs."""
    one_thread()
    options, console, found = parse(), Console(width=160), list[Row]()
    if not os.environ.get("SIGNID_DATA"):
        sys.exit("SIGNID_DATA is not set; real recordings are not in the repository; set it to their folder")
    if problem := missing() or refusal(options.folder):
        sys.exit(problem)
    write_specification(options.folder)
    for name in options.sets:
        try:
            found.append(_run(options, name))
        except SignidError as error:
            console.print(f"{name}: {error}", soft_wrap=True, highlight=False, markup=False)
    if not found:
        return 1
    write_readme(options.folder)
    console.print(table(found))
    if options.json:
        options.json.write_text(json.dumps(finite(found), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    differences = [x["difference"] for x in found if "difference" in x]
    if not differences:
        return 0
    worst = max(differences)
    sentence = f"least squares as in benchmarks.blackbox within {CLOSE:g}: largest difference {worst:.1g}"
    return int(not print_targets(console, [(sentence, worst <= CLOSE)]))


def table(rows: Sequence[Row]) -> Table:
    """Table with one line per set.

    Args:
        rows: figures of the sets.
    """
    names = ("set", "joints", "Hz", "MB", *(f"rows, {part}" for part in PARTS), "zero", "affine", "least squares")
    out = frame("rows per joint, and rms over least squares by IdentiBench", (*names, "difference"))
    for row in rows:
        scores = (f"{row[key]:.3g}" if key in row else "-" for key in ("zero", "affine", "least_squares", "difference"))
        counts = (f"{max(row['rows'][part])}" for part in PARTS)
        out.add_row(row["set"], str(row["joints"]), f"{row['cutoff']:.3g}", f"{row['size']:.1f}", *counts, *scores)
    return out


def _run(options: argparse.Namespace, name: str) -> Row:
    """Write a set, and check it if wanted."""
    task = build(SETS[name], methods.least_squares)
    found = set_files(task)
    place = write_set(options.folder, SETS[name], found)
    counts = {part: found.rows(part) for part in PARTS}
    row = {"set": name, "joints": len(task.joints), "cutoff": task.cutoff, "size": size(place), "rows": counts}
    return row | asdict(check(specifications(options.folder)[name], found)) if options.check else row


if __name__ == "__main__":
    raise SystemExit(main())
