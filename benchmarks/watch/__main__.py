"""Contacts and changes of a robot at work: `python -m benchmarks.watch [--hours 0.1] [--pushes 25] [--json FILE]`.

Models are identified from 30 s in MuJoCo; the streams are other motions there, at 1 kHz, with 17 bit encoders and 2 %
torque noise. Pushes last 0.3 s (10 to 40 N at the outer half of the links). UR10e: recordings of a real robot, of which
the last has a load (needs SIGNID_DATA). The last line: seven joints at 1 kHz in chunks of 16 ms on one core.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np
from rich.console import Console

from signid.watch import Watcher

from ..measure_command import peak
from ..summary import finite, frame, print_targets
from .cases import CHANGES, Detection, Naming, changed, learnt, pushes, quiet, stream
from .real import MASS, splice

ROBOTS = ("panda", "ur10", "3r")
CHUNK = 16  # rows
PART = 120.0  # [s] of one quiet stream
WITHIN, RATE, RIGHT, SHARE = 0.05, 1.0, 0.9, 0.1  # [s], [1/h], [1], [1] targets


def cost() -> tuple[float, float]:
    """Share of one core for the Panda, and growth of memory [MB] from the first half of the stream to its end."""
    columns = stream("panda", 60.0, (), 9)
    _, _, model = learnt("panda")
    t, n = columns["t"], len(model.robot.joints)
    q, tau = (np.column_stack([columns[f"{key}_{j + 1}"] for j in range(n)]) for key in ("q", "tau"))
    watcher, spent, sizes = Watcher(model), 0.0, list[float]()
    for start in range(0, len(t), CHUNK):
        rows = slice(start, start + CHUNK)
        begin = time.process_time()
        watcher.feed(t[rows], q[rows], tau[rows])
        spent += time.process_time() - begin
        if start in (len(t) // 2 // CHUNK * CHUNK, (len(t) - 1) // CHUNK * CHUNK):
            sizes.append(peak())
    return spent / float(t[-1]), sizes[-1] - sizes[0]


def main() -> int:
    """Run all parts; 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=0.1)
    parser.add_argument("--pushes", type=int, default=25)
    parser.add_argument("--json", type=Path)
    given, console = parser.parse_args(), Console()
    detected = [pushes(name, given.pushes, 11) for name in ROBOTS]
    parts = max(1, round(given.hours * 3600 / PART))
    still = [quiet(ROBOTS[k % len(ROBOTS)], PART, 100 + k) for k in range(parts)]
    named = [changed(name, change, 31) for name, change in CHANGES]
    share, grown = cost()
    real = splice() if "SIGNID_DATA" in os.environ else None
    _show(console, detected, still, named)
    if real is not None:
        console.print(
            f"UR10e: {real.unloaded:.0f} s unloaded with {real.false} false alarms; then {real.named or 'nothing'} of "
            f"{real.mass:.3g} ± {1.96 * real.std:.2g} kg (scale: {MASS} kg) named after {real.after:.1f} s, "
            f"contact after {real.contact:.2f} s, {real.later} contacts in the rest",
            highlight=False,
        )
    console.print(f"seven joints at 1 kHz: {share:.1%} of a core, memory +{grown:.1f} MB", highlight=False)
    times = np.concatenate([one.times for one in detected])
    hours = sum(one.seconds for one in (*detected, *still)) / 3600
    false = sum(one.false for one in (*detected, *still))
    right = float(np.mean([one.right for one in named]))
    targets = [
        (f"median detection {np.median(times) * 1e3:.0f} ms, at most {WITHIN * 1e3:.0f}", np.median(times) <= WITHIN),
        (f"{false} false alarms in {hours:.2f} h, at most {RATE:g} per hour", false <= max(RATE * hours, 0)),
        (f"named first {right:.0%}, at least {RIGHT:.0%}", right >= RIGHT),
        (f"{share:.1%} of a core, at most {SHARE:.0%}", share <= SHARE),
    ]
    met = print_targets(console, targets)
    if given.json:
        rows = {"pushes": detected, "quiet": still, "changes": named}
        content = {key: [one._asdict() for one in value] for key, value in rows.items()}
        content |= {"real": real._asdict() if real else None, "share": share}  # type: ignore[dict-item]
        given.json.write_text(json.dumps(finite(content), indent=1), encoding="utf-8")
    return 0 if met else 1


def _show(console: Console, detected: list[Detection], still: list[Detection], named: list[Naming]) -> None:
    table = frame("pushes", ("arm", "detected", "median [ms]", "90 % [ms]", "right link", "false", "of [s]"))
    for one in detected:
        middle, most = np.percentile(one.times, [50, 90]) * 1e3 if one.times else (np.nan, np.nan)
        hit = f"{len(one.times)} of {one.pushes}"
        table.add_row(
            one.arm, hit, f"{middle:.0f}", f"{most:.0f}", str(one.links), str(one.false), f"{one.seconds:.0f}"
        )
    console.print(table)
    table = frame("quiet", ("arm", "streams", "hours", "false alarms"))
    for name in dict.fromkeys(one.arm for one in still):
        own = [one for one in still if one.arm == name]
        hours, false = sum(one.seconds for one in own) / 3600, sum(one.false for one in own)
        table.add_row(name, str(len(own)), f"{hours:.2f}", str(false))
    console.print(table)
    table = frame("changes", ("arm", "change", "named first", "after [s]", "error", "contacts"), left=3)
    for row in named:
        mark = row.named if not row.right else "right"
        table.add_row(row.arm, row.change, mark or "-", f"{row.after:.1f}", f"{row.error:+.1%}", str(row.contacts))
    console.print(table)


if __name__ == "__main__":
    raise SystemExit(main())
