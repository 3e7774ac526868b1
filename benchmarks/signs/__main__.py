"""Recovery of torque signs: `python -m benchmarks.signs [--only CASE ...] [--quick] [--json FILE]`.

Signs are removed and recovered. The results are compared with the true signs and with identification from the signed
recordings. The cases paper, real, hobby and speed need SIGNID_DATA.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

import mujoco
from rich.console import Console
from rich.table import Table

from signid.errors import SignidError

from ..summary import command_line, one_thread, write_json
from . import paper, real, simulated, speed, summary
from .summary import reliability, summarise
from .trial import Row, TargetResult

NEED_DATA = ("paper", "real", "hobby", "speed")
Tables = tuple[Table, ...]


class Bench:
    """Results of the cases run so far."""

    def __init__(self, quick: bool, workers: int) -> None:
        self.quick, self.workers = quick, workers
        self.rows: list[Row] = []
        self.results: list[TargetResult] = []
        self.more: dict[str, Any] = {}

    def add(self, rows: Iterator[Row]) -> list[Row]:
        """Run and keep the rows of a case."""
        done = list(rows)
        self.rows += done
        return done

    def paper(self) -> Tables:
        """Recordings of the paper, by both methods."""
        rows = self.add(paper.rows(tree=not self.quick))
        self.results += summary.of_rows(rows)
        keys = ("case", "method", "segments", "mixed", "samples", "b", "error", "off", "seconds", "proof", "nodes")
        more = (
            ("paper", lambda row: f"{paper.PAPER[row.case.partition(',')[0]]:.1e}"),
            ("search", lambda row: f"{row.error_search:.1e}"),
            ("signed", lambda row: f"{row.error_known:.1e}"),
            ("held out, N.m", lambda row: f"{max(row.held_out):.1e}"),
        )
        return (summary.show_rows("recordings of the paper: 1R and 3R, no noise", rows, keys, more),)

    def table(self) -> Tables:
        """Coefficient table of the paper."""
        self.results.append(summary.of_table())
        return summary.show_entries(), summary.show_identifiable(), summary.show_quoted()

    def bullet(self) -> Tables:
        """Arm in PyBullet."""
        rows = self.add(paper.bullet_rows(2 if self.quick else paper.MOTIONS, self.workers))
        self.results += summary.of_rows(rows)
        keys = ("case", "segments", "mixed", "samples", "b", "off", "ratio", "worse", "seconds", "proof", "flags")
        more = (
            ("ten, error", lambda row: f"{row.error:.2g}"),
            ("signed", lambda row: f"{row.error_known:.2g}"),
            ("ratio", lambda row: f"{row.error / row.error_known:.2f}"),
        )
        return (summary.show_rows("3R in PyBullet, 2 % noise", rows, keys, more),)

    def real(self) -> Tables:
        """Real robots."""
        rows = self.add(real.rows())
        self.results += summary.of_rows(rows)
        keys = ("case", "segments", "mixed", "samples", "small", "b", "off", "worse", "seconds", "proof", "flags")
        return (summary.show_rows("real robots, signs removed", rows, keys, (("robot", lambda row: row.group),)),)

    def hobby(self) -> Tables:
        """Recordings with unknown true signs."""
        report = real.report()
        self.more["hobby"] = asdict(report)
        self.results.append(summary.of_hobby(report))
        return (summary.show_hobby(report),)

    def simulated(self) -> Tables:
        """Arms of six and seven joints."""
        rows = self.add(simulated.rows(1 if self.quick else simulated.SEEDS, self.workers))
        self.results += summary.of_groups(rows)
        return (summary.show_groups("arms of six and seven joints in MuJoCo", summarise(rows)),)

    def constants(self) -> Tables:
        """Currents with unknown torque constants."""
        found = list(simulated.found(workers=self.workers))
        kinds = list(simulated.summarise(found))
        self.more |= {"constants": found, "kinds": kinds}
        self.results += summary.of_constants(kinds)
        return (summary.show_constants(kinds),)

    def speed(self) -> Tables:
        """Speed of the exact search against the classical tree and its fast form."""
        rows = list(speed.races(self.rows, tree=not self.quick))
        self.more["speed"] = rows
        self.results += [row.result for row in rows]
        return (speed.show(rows),)

    def confidence(self) -> Tables:
        """Calibration of the confidence over all runs."""
        bins = list(reliability(self.rows))
        self.results += [summary.of_bins(bins), summary.of_all(self.rows)]
        return (summary.show_bins(bins),)


WORDS = {True: ("met", ""), False: ("NOT MET", "red"), None: ("info", "")}
CASES = ("table", "paper", "bullet", "real", "hobby", "simulated", "constants", "speed")


def run(bench: Bench, cases: Sequence[str], console: Console) -> None:
    """Run and print the selected cases, then the calibration of confidence over all of them."""
    for name in (*cases, "confidence"):
        if name in NEED_DATA and not os.environ.get("SIGNID_DATA"):
            console.print(f"{name}: skipped, SIGNID_DATA is not set", highlight=False)
            continue
        work: Callable[[], Tables] = getattr(bench, name)
        start, before = time.perf_counter(), len(bench.results)
        try:
            tables = work()
        except SignidError as error:
            tables = ()
            bench.results.append(TargetResult(f"{name}: refused: {error}", False))
        for table in tables:
            console.print(table)
        for result in bench.results[before:]:
            word, style = WORDS[result.met]
            console.print(f"{word}: {result.sentence}", style=style, highlight=False, soft_wrap=True)
        console.print(f"{name}: {time.perf_counter() - start:.1f} s\n", highlight=False, style="dim")


def main() -> None:
    """Run, print and write the numbers; exit with 1 when a target is missed."""
    one_thread()
    parser = command_line("signs", __doc__)
    parser.add_argument(
        "--only", nargs="+", choices=CASES, metavar="CASE", help=f"run only these of {', '.join(CASES)}"
    )
    parser.add_argument("--quick", action="store_true", help="fewer motions, no tree")
    parser.add_argument("--workers", type=int, default=2, help="number of parallel processes (%(default)s)")
    options, console = parser.parse_args(), Console(width=160)
    bench = Bench(options.quick, options.workers)
    run(bench, options.only or CASES, console)
    if options.json:
        import pybullet  # not a dependency of the tests

        versions = {"mujoco": mujoco.__version__, "pybullet": pybullet.getAPIVersion()}
        machine = {"python": platform.python_version(), "processor": platform.machine(), **versions}
        groups = summarise([row for row in bench.rows if "noise" in row.group or row.group in simulated.FAILURES])
        document = {
            "machine": machine,
            "rows": bench.rows,
            "groups": groups,
            "reliability": [asdict(one) for one in reliability(bench.rows)],
            "verdicts": [result._asdict() for result in bench.results],
            **bench.more,
        }
        write_json(options.json, document)
    sys.exit(any(result.met is False for result in bench.results))


if __name__ == "__main__":
    main()
