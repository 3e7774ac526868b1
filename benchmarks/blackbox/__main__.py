"""Physical models and black boxes on real data: `python -m benchmarks.blackbox [--sets S ...] [--json FILE]`.

Needs SIGNID_DATA. Parts A and B of each real set are training data; part C is held out. All methods are evaluated on
the same filtered rows of C: rms and R2 of each joint. `diagnose` identifies A and B and diagnoses both; `diagnose, B`
identifies A and diagnoses B. figaroh and mujoco.sysid run in their own Python; without it their rows show a dash.
"""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from signid.errors import SignidError

from ..concealed_real.sets import SETS
from ..peers.ask import Peer
from ..summary import command_line, data, one_thread, write_json
from . import methods
from .methods import ask
from .run import BASE, SetResult, run, set_table, summary, totals
from .task import Method

LIMIT = methods.LIMIT
DIAGNOSES = {"signid diagnose, B": methods.diagnose, "signid diagnose": methods.diagnose_all}
PEERS = {"figaroh": "figaroh_peer.py torque", "mujoco.sysid": "mujoco_peer.py torque"}
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
    own = [*NAMES, *PEERS]
    known = [path for path in os.environ.get("SIGNID_PEER_PYTHON", "").split(os.pathsep) if path]
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="SET", help=", ".join(SETS))
    parser.add_argument(
        "--limit", type=float, default=LIMIT, metavar="S", help=f"time limit of a diagnosis (default {LIMIT:g})"
    )
    parser.add_argument("--skip", nargs="+", choices=own, default=[], metavar="METHOD", help=", ".join(own))
    parser.add_argument(
        "--peer-python", action="append", default=known, metavar="PATH", help="interpreter with a peer (repeatable)"
    )
    options = parser.parse_args()
    for path in options.peer_python:
        if not Path(path).is_file():
            parser.error(f"{path} does not exist; give the Python interpreter of an environment with a peer")
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
    with ExitStack() as stack:
        selected = _methods(options, stack)
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


def _methods(options: argparse.Namespace, stack: ExitStack) -> dict[str, Method]:
    """Selected methods by name, with peers after least squares; peers end with the stack."""
    selected = {key: x for key, x in NAMES.items() if key not in options.skip}
    selected |= {key: partial(x, limit=options.limit) for key, x in DIAGNOSES.items() if key in selected}
    for name, script in PEERS.items():
        if name not in options.skip:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            peer = Peer(script, [*options.peer_python, sys.executable], folder)
            stack.callback(peer.close)
            selected[name] = partial(ask, peer=peer, name=name)
    order = ["description", BASE, *PEERS, *NAMES]
    return dict(sorted(selected.items(), key=lambda x: order.index(x[0])))


if __name__ == "__main__":
    raise SystemExit(main())
