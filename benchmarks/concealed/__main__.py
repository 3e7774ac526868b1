"""Diagnosis of concealed faults: `python -m benchmarks.concealed [--only SUITE ...] [--quick] [--json FILE]`.

Robots with planted faults move in MuJoCo. Their description and recordings are written to
`CACHE/sessions/NAME` (robot.urdf, actuators.toml, recording_1.parquet ...), the faults to `CACHE/answers/NAME.json`,
which the diagnosis never reads, and the diagnosis to `CACHE/diagnoses/NAME.json`.

    python -m benchmarks.concealed --make-only --only exact none --robots 3r ur5 --cache DIR     record sessions only
    python -m benchmarks.concealed --only exact --sizes 0.05 --sample 50 --cache DIR             random subset of cases
    python -m benchmarks.concealed --judge-only --cache DIR                                      evaluate cached results

Suites: exact (inertials as stated), hard (5 % failures inertials, creeping dry friction), none (healthy, half of them
hard), pairs (two faults at 5 %), foreign (laws that the library describes by similar effects), absent (laws missing in
the library), removed (library without the effect). `--base 100` draws seeds that were not used for tuning.

`--stranger` runs robots whose description is 30 % off and states no drives; its options: `--stranger --help`.
"""

from __future__ import annotations

import argparse
import platform
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from ..summary import command_line, one_thread, origin, write_json
from . import stranger
from .cases import SIZES, SUITES, Case, cases, quick, sample
from .evaluate import Evaluation, evaluate
from .scene import ROBOTS
from .session import process_all, results
from .summary import Target, by_robot, by_size, cells, confusion, reliability, tables, targets, targets_table

USUAL = ("1r", "3r", "ur5", "panda", "kinova", "xarm7")


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = command_line("concealed", __doc__)
    parser.add_argument("--only", nargs="+", choices=SUITES, default=SUITES, metavar="SUITE", help="suites to run")
    parser.add_argument("--robots", nargs="+", choices=tuple(ROBOTS), default=USUAL, metavar="ROBOT")
    parser.add_argument(
        "--effects", nargs="+", default=[], metavar="EFFECT", help="run only cases with one of these effects"
    )
    parser.add_argument("--sizes", nargs="+", type=float, choices=SIZES, default=SIZES, metavar="SIZE")
    parser.add_argument("--seeds", type=int, default=3, help="seeds per cell (%(default)s)")
    parser.add_argument("--base", type=int, default=0, help="the first seed")
    parser.add_argument("--sample", type=int, metavar="N", help="run N random cases")
    parser.add_argument("--quick", action="store_true", help="a small fixed subset")
    parser.add_argument("--workers", type=int, default=2, help="number of parallel processes (%(default)s)")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keep sessions and diagnoses in DIR")
    parser.add_argument("--make-only", action="store_true", help="record sessions without diagnosis")
    parser.add_argument("--judge-only", action="store_true", help="evaluate existing diagnoses only")
    parser.add_argument("--list", action="store_true", help="list every session that is not named right")
    parser.add_argument("--again", action="store_true", help="repeat existing diagnoses")
    return parser.parse_args()


def chosen(options: argparse.Namespace) -> list[Case]:
    """Select the cases of the options."""
    if options.quick:
        return quick()
    seeds = range(options.base, options.base + options.seeds)
    found = cases(options.only, options.robots, options.sizes, seeds)
    found = [case for case in found if not options.effects or set(case.effects) & set(options.effects)]
    return found if options.sample is None else sample(found, options.sample, options.base)


def document(evaluations: Sequence[Evaluation], found: Sequence[Target]) -> dict[str, object]:
    """All numbers as a JSON document."""
    machine = {"python": platform.python_version(), "processor": platform.machine()}
    return {
        "origin": origin("concealed", sys.argv[1:], ("--json", "--cache", "--workers")),
        "machine": machine,
        "targets": [{**asdict(target), "met": target.met} for target in found],
        "cells": [cell._asdict() for by in (by_size, by_robot) for cell in cells(evaluations, by)],
        "confusion": confusion(evaluations),
        "reliability": [one._asdict() for one in reliability(evaluations)],
        "sessions": evaluations,
    }


def record(wanted: Sequence[Case], cache: Path, options: argparse.Namespace, console: Console) -> int:
    """Record and diagnose; return the number of failed cases."""
    failures = 0
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
        for reason in process_all(wanted, cache, options.workers, progress, not options.make_only, options.again):
            console.print(reason, style="red", highlight=False, soft_wrap=True)
            failures += 1
    return failures


def main() -> None:
    """Record, diagnose, evaluate and print; exit with 1 when a target is missed or a case failed."""
    one_thread()
    if "--stranger" in sys.argv:
        stranger.main()
    options, console = parse(), Console(width=150)
    with tempfile.TemporaryDirectory() as temporary:
        cache, wanted = options.cache or Path(temporary), chosen(options)
        failures = 0 if options.judge_only else record(wanted, cache, options, console)
        if options.make_only:
            sys.exit(bool(failures))
        evaluations = [evaluate(answer, result) for answer, result in results(wanted, cache)]
    found = list(targets(evaluations))
    for table in (*tables(evaluations), targets_table(found)):
        console.print(table)
    for v in evaluations if options.list else ():
        if v.outcome not in ("right", "both") or v.spurious:
            console.print(f"{v.name} {v.key}: {v.outcome}, {v.first}, {v.spurious} spurious", highlight=False)
    console.print(f"{len(evaluations)} of {len(wanted)} sessions evaluated", highlight=False)
    write_json(options.json, document(evaluations, found))
    sys.exit(bool(failures) or any(target.met is False for target in found))


if __name__ == "__main__":
    main()
