"""Physical models and black boxes on real data: `python -m benchmarks.blackbox [--sets S ...] [--json FILE]`.

Needs SIGNID_DATA. Parts A and B of each real set are training data; part C is held out. All methods are evaluated on
the same filtered rows of C: rms and R2 of each joint. `diagnose` identifies A and B and diagnoses both; `diagnose, B`
identifies A and diagnoses B.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial

from rich.console import Console

from signid.errors import SignidError

from ..concealed_real.sets import SETS
from ..summary import command_line, data, one_thread, write_json
from . import methods
from .run import BASE, SetResult, run, set_table, summary, totals
from .task import Method

LIMIT = methods.LIMIT
DIAGNOSES = {"signid diagnose, B": methods.diagnose, "signid diagnose": methods.diagnose_all}
NAMES: dict[str, Method] = {
    "description": methods.description,
    BASE: methods.least_squares_answer,
    "boosted residual": methods.boosted,
    "GP residual": methods.gaussian,
    "signid identify": methods.identify,
    "signid identify, A": methods.identify_first,
    **DIAGNOSES,
}


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = command_line("blackbox", __doc__)
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="SET", help=", ".join(SETS))
    parser.add_argument(
        "--limit", type=float, default=LIMIT, metavar="S", help=f"time limit of a diagnosis (default {LIMIT:g})"
    )
    parser.add_argument("--skip", nargs="+", choices=NAMES, default=[], metavar="METHOD", help=", ".join(NAMES))
    options = parser.parse_args()
    if BASE in options.skip:
        parser.error(f"{BASE} cannot be skipped: the other methods are compared with it")
    return options


def main() -> int:
    """Run every set; print its table and the summary."""
    one_thread()
    options, console = parse(), Console(width=240)
    data()
    if problem := methods.missing():
        sys.exit(problem)
    found: list[SetResult] = []
    selected = {name: method for name, method in NAMES.items() if name not in options.skip}
    selected |= {name: partial(x, limit=options.limit) for name, x in DIAGNOSES.items() if name in selected}
    for name in options.sets:
        try:
            found.append(run(SETS[name], selected))
        except SignidError as error:
            console.print(f"{name}: {error}", soft_wrap=True, highlight=False, markup=False)
            continue
        console.print(set_table(found[-1]))
        write_json(options.json, {"sets": found, "totals": totals(found)})
    console.print(summary(totals(found)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
