"""Diagnosis of known changes on real robots: `python -m benchmarks.concealed_real [--sets S ...] [--json FILE]`.

Needs SIGNID_DATA. Part A of each set is identified. One known change is made to the model or to the recording B, which
is diagnosed. The extended and the given model are compared on the held-out recording C. A case is fair if its torque is
at least as large as the residual of the unchanged model on B, and if the control (no change) does not name the change.
`--leave-out --cache DIR` runs all cases under other values of tuned constants and chooses these for each robot by the
cases of the other robots; rows that DIR holds are not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import Manager
from pathlib import Path
from queue import Empty
from typing import Any

from rich.console import Console

from ..summary import command_line, data, one_thread, origin, write_json
from . import leave_out
from .run import Row, run
from .sets import SETS
from .summary import line, tables, totals
from .trials import CONSTANTS, Setting, fill, load

WAIT = 1.0  # between polls of the processes [s]


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = command_line("concealed_real", __doc__)
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="SET", help=", ".join(SETS))
    parser.add_argument("--cases", nargs="+", default=[], metavar="KIND", help="kinds of changes (default: all)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes; each runs one set at a time")
    parser.add_argument("--limit", type=float, metavar="S", help="time limit of a diagnosis")
    parser.add_argument("--show", type=Path, metavar="FILE", help="print the tables of an existing JSON file")
    parser.add_argument("--leave-out", action="store_true", help="choose constants without the robot that judges")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="folder of the rows of --leave-out")
    parser.add_argument(
        "--constants", nargs="+", choices=CONSTANTS, default=[], metavar="NAME", help=f"of {', '.join(CONSTANTS)}"
    )
    options = parser.parse_args()
    if options.leave_out and not options.cache:
        parser.error("--leave-out needs --cache DIR")
    return options


def main() -> int:
    """Run the cases and print the tables."""
    one_thread()
    options, console = parse(), Console(width=240)
    if options.show:
        rows: list[Row] = json.loads(options.show.read_text(encoding="utf-8"))["rows"]
        console.print(*tables(rows))
        return 0
    data()
    if options.leave_out:
        return _leave_out(options, console)
    rows = []
    for row in _rows(options.sets, options.cases, options.limit, options.jobs):
        rows.append(row)
        console.print(line(row), soft_wrap=True, highlight=False, markup=False)
        write_json(options.json, _document(rows, totals(rows)))
    console.print(*tables(rows))
    return 0


def _leave_out(options: argparse.Namespace, console: Console) -> int:
    """Run what the folder lacks, choose the constants for each robot, and print the tables."""
    constants = [CONSTANTS[name] for name in options.constants or CONSTANTS]
    robots = list(dict.fromkeys(map(leave_out.robot_of, options.sets)))
    options.cache.mkdir(parents=True, exist_ok=True)
    _fill({name: leave_out.settings_of(constants) for name in options.sets}, options)
    rows = load(options.cache, options.sets)
    for tie in (False, True):
        chosen = {x: leave_out.chosen_without(rows, constants, x, robots, tie) for x in robots}
        _fill({name: [(), chosen[leave_out.robot_of(name)]] for name in options.sets}, options)
    rows = load(options.cache, options.sets)
    found = leave_out.leave_out(rows, constants, robots)
    console.print(*leave_out.tables(found, list(leave_out.choices(rows, constants, robots))))
    write_json(options.json, _document(rows, leave_out.totals(found)))
    return 0


def _fill(settings: Mapping[str, Sequence[Setting]], options: argparse.Namespace) -> None:
    """Run what the folder lacks, by set."""
    if options.jobs == 1:
        for name, some in settings.items():
            fill(SETS[name], some, options.cache)
        return
    with ProcessPoolExecutor(options.jobs) as pool:
        for future in [pool.submit(fill, SETS[name], some, options.cache) for name, some in settings.items()]:
            future.result()


def _document(rows: Sequence[Row], figures: Mapping[str, str]) -> dict[str, Any]:
    return {"origin": origin("concealed_real", sys.argv[1:]), "totals": figures, "rows": rows}


def _rows(sets: Sequence[str], kinds: Collection[str], limit: float | None, jobs: int) -> Iterator[Row]:
    if jobs == 1:
        for name in sets:
            yield from run(SETS[name], kinds, limit)
        return
    with Manager() as manager, ProcessPoolExecutor(jobs) as pool:
        queue = manager.Queue()
        futures = [pool.submit(_feed, queue, name, kinds, limit) for name in sets]
        while not (done := all(future.done() for future in futures)) or not queue.empty():
            try:
                yield queue.get(timeout=0.01 if done else WAIT)
            except Empty:
                continue
        for future in futures:
            future.result()


def _feed(queue: Any, name: str, kinds: Collection[str], limit: float | None) -> None:
    for row in run(SETS[name], kinds, limit):
        queue.put(row)


if __name__ == "__main__":
    raise SystemExit(main())
