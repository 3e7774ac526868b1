"""Physics concealed from the diagnosis: `python -m benchmarks.concealed [--only SUITE ...] [--quick] [--json FILE]`.

Robots with something wrong move in MuJoCo (`--plant bullet`: in Bullet); what the simulation knows of them and their
recordings go to `CACHE/sessions/NAME` (robot.urdf, actuators.toml, recording_1.parquet ...), what is wrong to
`CACHE/answers/NAME.json`, which the diagnosis never opens, and what it says to `CACHE/diagnoses/NAME.json`.

    python -m benchmarks.concealed --make-only --only exact none --robots 3r ur5 --cache DIR     sessions alone
    python -m benchmarks.concealed --only exact --sizes 0.05 --sample 50 --cache DIR             a part, quickly
    python -m benchmarks.concealed --judge-only --cache DIR                                      judge what is there

Suites: exact (inertials as stated), hard (5 % wrong, and dry friction that creeps), none (healthy, half of them hard),
pairs (two at 5 %), foreign (laws that the library has in other words), absent (laws that it has not), removed (the
library without the effect). `--base 100` draws other seeds than those that something was tuned on.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from ..one_thread import one_thread
from ..summary import finite
from .cases import SIZES, SUITES, Case, cases, quick, sample
from .judge import Verdict, judge
from .robots import ROBOTS
from .show import tables, targets_table
from .summary import Target, by_robot, by_size, cells, confusion, reliability, targets
from .work import judged, process_all

USUAL = ("1r", "3r", "ur5", "panda", "kinova", "xarm7")


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.concealed", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=SUITES, default=SUITES, metavar="SUITE", help="some suites")
    parser.add_argument("--robots", nargs="+", choices=tuple(ROBOTS), default=USUAL, metavar="ROBOT")
    parser.add_argument("--effects", nargs="+", default=[], metavar="EFFECT", help="cases with one of these alone")
    parser.add_argument("--sizes", nargs="+", type=float, choices=SIZES, default=SIZES, metavar="SIZE")
    parser.add_argument("--seeds", type=int, default=3, help="of every cell, by default %(default)s")
    parser.add_argument("--base", type=int, default=0, help="the first seed")
    parser.add_argument("--sample", type=int, metavar="N", help="that many of the cases, at random")
    parser.add_argument("--quick", action="store_true", help="a small fixed subset")
    parser.add_argument("--plant", choices=("mujoco", "bullet"), default="mujoco")
    parser.add_argument("--workers", type=int, default=2, help="processes at once, by default %(default)s")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keep sessions and diagnoses there")
    parser.add_argument("--make-only", action="store_true", help="record, and diagnose nothing")
    parser.add_argument("--judge-only", action="store_true", help="diagnose nothing anew")
    parser.add_argument("--list", action="store_true", help="name every session that was not judged right")
    parser.add_argument("--again", action="store_true", help="diagnose anew what was diagnosed before")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    return parser.parse_args()


def chosen(options: argparse.Namespace) -> list[Case]:
    """The cases that are asked for."""
    if options.quick:
        return quick()
    seeds = range(options.base, options.base + options.seeds)
    found = cases(options.only, options.robots, options.sizes, seeds, options.plant)
    found = [case for case in found if not options.effects or set(case.effects) & set(options.effects)]
    return found if options.sample is None else sample(found, options.sample, options.base)


def told(verdicts: Sequence[Verdict], found: Sequence[Target]) -> dict[str, object]:
    """All numbers, as JSON has them."""
    machine = {"python": platform.python_version(), "processor": platform.machine()}
    return {
        "machine": machine,
        "targets": [{**asdict(target), "met": target.met} for target in found],
        "cells": [cell._asdict() for by in (by_size, by_robot) for cell in cells(verdicts, by)],
        "confusion": confusion(verdicts),
        "reliability": [one._asdict() for one in reliability(verdicts)],
        "sessions": [asdict(verdict) for verdict in verdicts],
    }


def record(wanted: Sequence[Case], cache: Path, options: argparse.Namespace, console: Console) -> int:
    """Record and diagnose; how often something went wrong."""
    wrong = 0
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
        for reason in process_all(wanted, cache, options.workers, progress, not options.make_only, options.again):
            console.print(reason, style="red", highlight=False, soft_wrap=True)
            wrong += 1
    return wrong


def main() -> None:
    """Record, diagnose, judge, print; exit 1 when a target is missed or a case could not be tried."""
    one_thread()
    options, console = parse(), Console(width=150)
    with tempfile.TemporaryDirectory() as spare:
        cache, wanted = options.cache or Path(spare), chosen(options)
        wrong = 0 if options.judge_only else record(wanted, cache, options, console)
        if options.make_only:
            sys.exit(bool(wrong))
        verdicts = [judge(answer, result) for answer, result in judged(wanted, cache)]
    found = list(targets(verdicts))
    for table in (*tables(verdicts), targets_table(found)):
        console.print(table)
    for v in verdicts if options.list else ():
        if v.outcome not in ("right", "both") or v.spurious:
            console.print(f"{v.name} {v.key}: {v.outcome}, {v.first}, {v.spurious} spurious", highlight=False)
    console.print(f"{len(verdicts)} of {len(wanted)} sessions judged", highlight=False)
    if options.json:
        options.json.write_text(json.dumps(finite(told(verdicts, found)), indent=1, allow_nan=False), encoding="utf-8")
    sys.exit(bool(wrong) or any(target.met is False for target in found))


if __name__ == "__main__":
    main()
