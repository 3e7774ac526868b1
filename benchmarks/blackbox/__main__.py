"""Physical models against black boxes: `python -m benchmarks.blackbox [--sets S ...] [--json FILE]`, with SIGNID_DATA.

Parts A and B of each real set are learned from; part C takes no part in any fit. All methods are judged on the same
filtered rows of C: rms and R2 of each joint. `diagnose` identifies A and B and diagnoses both again, `diagnose, B`
identifies A and diagnoses B. figaroh and mujoco.sysid run in their own Python; without it they have a dash.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from signid.errors import SignidError

from ..concealed_real.sets import SETS
from ..one_thread import one_thread
from ..peers.ask import Peer
from ..told import finite
from . import methods, residual_fit
from .peers import ask
from .run import BASE, Judged, run
from .show import set_table, summary, totals
from .task import Method

LIMIT = methods.LIMIT
DIAGNOSES = {"signid diagnose, B": methods.diagnose, "signid diagnose": methods.diagnose_all}
PEERS = {"figaroh": "figaroh_torque.py", "mujoco.sysid": "mujoco_torque.py"}
NAMES: dict[str, Method] = {
    "description": methods.description,
    BASE: methods.least_squares_answer,
    "boosted residual": residual_fit.boosted,
    "GP residual": residual_fit.gaussian,
    "signid identify": methods.identify,
    "signid identify, A": methods.identify_first,
    **DIAGNOSES,
}


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blackbox", description=__doc__)
    own = [*NAMES, *PEERS]
    known = [path for path in os.environ.get("SIGNID_PEER_PYTHON", "").split(os.pathsep) if path]
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="SET", help=", ".join(SETS))
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, each set when it finishes")
    parser.add_argument("--limit", type=float, default=LIMIT, metavar="S", help=f"of a diagnosis (default {LIMIT:g})")
    parser.add_argument("--skip", nargs="+", choices=own, default=[], metavar="METHOD", help=", ".join(own))
    parser.add_argument("--peer-python", action="append", default=known, metavar="PATH", help="repeatable")
    options = parser.parse_args()
    for path in options.peer_python:
        if not Path(path).is_file():
            parser.error(f"there is no Python at {path}; give the interpreter of the environment that has a peer")
    if BASE in options.skip:
        parser.error(f"{BASE} cannot be skipped: the other methods are compared with it")
    return options


def main() -> int:
    """Every set, its table, and the summary."""
    one_thread()
    options, console = parse(), Console(width=240)
    if not os.environ.get("SIGNID_DATA"):
        sys.exit("SIGNID_DATA is unset: real recordings are not part of the repository")
    if sentence := residual_fit.missing():
        sys.exit(sentence)
    found: list[Judged] = []
    with ExitStack() as stack:
        asked = _methods(options, stack)
        for name in options.sets:
            try:
                found.append(run(SETS[name], asked))
            except SignidError as error:
                console.print(f"{name}: {error}", soft_wrap=True, highlight=False, markup=False)
                continue
            console.print(set_table(found[-1]))
            if options.json:
                _write(options.json, found)
    console.print(summary(totals(found)))
    return 0


def _methods(options: argparse.Namespace, stack: ExitStack) -> dict[str, Method]:
    """Methods by their names, peers after least squares; peers end with the stack."""
    asked = {key: x for key, x in NAMES.items() if key not in options.skip}
    asked |= {key: partial(x, limit=options.limit) for key, x in DIAGNOSES.items() if key in asked}
    for name, script in PEERS.items():
        if name not in options.skip:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            peer = Peer(script, [*options.peer_python, sys.executable], folder)
            stack.callback(peer.close)
            asked[name] = partial(ask, peer=peer, name=name)
    order = ["description", BASE, *PEERS, *NAMES]
    return dict(sorted(asked.items(), key=lambda x: order.index(x[0])))


def _write(path: Path, found: Sequence[Judged]) -> None:
    """Write the whole file or nothing."""
    document = {"sets": [asdict(x) for x in found], "totals": [asdict(x) for x in totals(found)]}
    part = path.with_name(f"{path.name}.part")
    part.write_text(json.dumps(finite(document), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    part.replace(path)


if __name__ == "__main__":
    raise SystemExit(main())
