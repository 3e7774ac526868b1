"""Diagnosis of nine injected faults by three tools: `python -m benchmarks.peers [--peer-python PATH]... [--json FILE]`.

A UR10 with a fault moves in MuJoCo; a first motion is training data, a second one is held out. signid diagnoses with
the description and the true drives. figaroh fits base parameters with friction, rotors and offsets; mujoco.sysid fits
rotors and friction of the simulated loop; their reports are searched for the cause. Each peer runs in its own
environment; a missing one is marked in the tables. Exits with 1 when signid misses a cause.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from ..summary import command_line, finite, one_thread, write_json
from .ask import Peer
from .job import Arm, cases, describe
from .results import Row, measure, tables

# durations of the two recordings and of the simulated loop [s]
DURATIONS, SHORT = (40.0, 20.0, 10.0), (12.0, 10.0, 3.0)
FEW = ("clean", "payload 1.5 kg", "torque gain 0.9, one joint")  # cases of --quick
FIGAROH, MUJOCO = "figaroh_peer.py report", "mujoco_peer.py sysid"


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = command_line("peers", __doc__)
    known = [path for path in os.environ.get("SIGNID_PEER_PYTHON", "").split(os.pathsep) if path]
    parser.add_argument(
        "--peer-python", action="append", default=known, metavar="PATH", help="interpreter with a peer (repeatable)"
    )
    parser.add_argument("--quick", action="store_true", help=f"only {', '.join(FEW)}, on short recordings")
    options = parser.parse_args()
    for path in options.peer_python:
        if not Path(path).is_file():
            parser.error(f"{path} does not exist; give the Python interpreter of an environment with a peer")
    return options


def summarise(rows: Sequence[Row], versions: dict[str, str]) -> dict[str, Any]:
    """All numbers as a JSON document, reproducible except for times."""
    machine = {"python": platform.python_version(), "numpy": np.__version__, **versions}
    return {"machine": machine, "rows": [finite(_row(row)) for row in rows]}


def _row(row: Row) -> dict[str, Any]:
    faults = [{"effect": x.effect, "joint": x.joint, "parameters": dict(x.parameters)} for x in row.case.faults]
    results = {name: asdict(getattr(row, name)) for name in ("signid", "figaroh", "mujoco")}
    return {"case": row.case.name, "faults": faults, **results}


def main() -> int:
    """Run every case and print the tables; return 1 when signid misses a cause."""
    one_thread()
    options, console, arm = parse(), Console(width=160), Arm.ur10()
    chosen = [case for case in cases(arm) if case.name in FEW or not options.quick]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        peers = (Peer(FIGAROH, options.peer_python, folder), Peer(MUJOCO, options.peer_python, folder))
        describe(arm, folder)
        for row in measure(arm, chosen, peers, SHORT if options.quick else DURATIONS, folder):
            rows.append(row)
            print(f"{row.case.name}: {row.signid.outcome}", file=sys.stderr, flush=True)
        for peer in peers:
            peer.close()
    versions = (peers[0].version, peers[1].version)
    console.print(*tables(rows, versions))
    faulty = [row for row in rows if row.case.effect and not row.case.declared]
    counts = [("signid", [row.signid.right for row in faulty])]
    counts += [("figaroh", [row.figaroh.named for row in faulty])] if versions[0] else []
    counts += [("mujoco.sysid", [row.mujoco.named for row in faulty])] if versions[1] else []
    for name, named in counts:
        console.print(f"{name}: {sum(named)} of {len(faulty)} causes named", highlight=False)
    document = summarise(rows, dict(zip(("figaroh", "mujoco"), versions, strict=True)))
    write_json(options.json, document)
    return 0 if all(row.signid.right for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
