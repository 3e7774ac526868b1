"""Nine injected faults, and what is said of them: `python -m benchmarks.peers [--peer-python PATH]... [--json FILE]`.

A UR10 with something wrong moves in MuJoCo; a first recording is to learn from, a second motion to judge by. signid is
given the description and the true drives, and asked what is missing; figaroh fits base parameters with friction, rotors
and offsets, mujoco.sysid rotors and friction of the simulated loop, and their reports are searched for the cause. Each
peer runs in an environment of its own; without it its columns say so. Exits 1 when signid misses a cause.
"""

from __future__ import annotations

import argparse
import json
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

from ..one_thread import one_thread
from ..summary import finite
from .ask import Peer
from .faults import Arm, cases
from .handed import describe
from .row import Row, measure
from .show import tables

DURATIONS, SHORT = (40.0, 20.0, 10.0), (12.0, 10.0, 3.0)  # s of two recordings, and of the loop that is simulated
FEW = ("clean", "payload 1.5 kg", "torque gain 0.9, one joint")  # of --quick
FIGAROH, MUJOCO = "figaroh_report.py", "mujoco_sysid.py"


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    known = [path for path in os.environ.get("SIGNID_PEER_PYTHON", "").split(os.pathsep) if path]
    parser.add_argument("--peer-python", action="append", default=known, metavar="PATH", help="repeatable")
    parser.add_argument("--quick", action="store_true", help=f"{', '.join(FEW)} alone, on short recordings")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    options = parser.parse_args()
    for path in options.peer_python:
        if not Path(path).is_file():
            parser.error(f"there is no Python at {path}; give the interpreter of the environment that has a peer")
    return options


def told(rows: Sequence[Row], versions: dict[str, str]) -> dict[str, Any]:
    """All numbers, as JSON has them; but for seconds the same every time."""
    machine = {"python": platform.python_version(), "numpy": np.__version__, **versions}
    return {"machine": machine, "rows": [finite(_row(row)) for row in rows]}


def _row(row: Row) -> dict[str, Any]:
    faults = [{"effect": x.effect, "joint": x.joint, "parameters": dict(x.parameters)} for x in row.case.faults]
    said = {name: asdict(getattr(row, name)) for name in ("signid", "figaroh", "mujoco")}
    return {"case": row.case.name, "faults": faults, **said}


def main() -> int:
    """Every case, a table of each, and 1 where signid misses a cause."""
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
    faulty = [row for row in rows if row.case.effect and not row.case.told]
    counts = [("signid", [row.signid.right for row in faulty])]
    counts += [("figaroh", [row.figaroh.named for row in faulty])] if versions[0] else []
    counts += [("mujoco.sysid", [row.mujoco.named for row in faulty])] if versions[1] else []
    for name, named in counts:
        console.print(f"{name}: {sum(named)} of {len(faulty)} causes named", highlight=False)
    if options.json:
        document = told(rows, dict(zip(("figaroh", "mujoco"), versions, strict=True)))
        options.json.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return 0 if all(row.signid.right for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
