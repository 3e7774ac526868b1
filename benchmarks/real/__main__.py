"""Diagnosis of known missing physics on real robots: `python -m benchmarks.real [--only CASE ...] [--json FILE]`.

Needs SIGNID_DATA. Simulations without a known property of the robot are compared with its recordings: the payload of a
UR10e, the coupled wrist of a TX40, the asymmetric friction of the EMPS, the friction of a Panda and a hand that it does
not carry, the speed dependence of the UR10e's friction, and an LWR4+ with insufficient excitation. `repeat` diagnoses
the recordings of one robot one by one. Exits with 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from ..one_thread import one_thread
from . import others, repeat, ur
from .row import Row
from .show import show_left, show_repeats, show_rows, show_targets

CASES: dict[str, Callable[[], Iterator[Row]]] = {
    "ur10e": ur.payload,
    "jointwise": ur.jointwise,
    "tx40": others.tx40,
    "emps": others.emps,
    "panda": others.panda,
    "lwr4": others.lwr4,
}
REPEAT = "repeat"


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real", description=__doc__)
    names = (*CASES, REPEAT)
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="CASE", help=", ".join(names))
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all rows to FILE as JSON")
    return parser.parse_args()


def main() -> int:
    """Run every case and print the tables; return 1 when a target is missed."""
    one_thread()
    options, console = parse(), Console(width=200)
    if not os.environ.get("SIGNID_DATA"):
        sys.exit("SIGNID_DATA is not set; real recordings are not in the repository; set it to their folder")
    rows: list[Row] = []
    for name in CASES:
        if name in options.only:
            for row in CASES[name]():
                rows.append(row)
                console.print(f"{row.robot}, {row.concealed}: {'targets met' if row.holds else 'NOT MET'}")
    if rows:
        console.print(show_rows(rows), show_targets(rows), show_left(rows))
    groups = list(repeat.repeats()) if REPEAT in options.only else []
    agreements = [repeat.agree(group) for group in groups]
    if groups:
        console.print(show_repeats(groups, agreements))
    if options.json:
        document = {
            "rows": [{**asdict(row), "holds": row.holds} for row in rows],
            "repeats": [asdict(row) for group in groups for row in group],
            "agreements": [{**asdict(one), "holds": one.holds} for one in agreements],
        }
        options.json.write_text(json.dumps(document, indent=1, default=str) + "\n", encoding="utf-8")
    return 0 if all(row.holds for row in rows) and all(one.holds for one in agreements) else 1


if __name__ == "__main__":
    raise SystemExit(main())
