"""Changes found by a fleet: `python -m benchmarks.fleet_changes [--pairs 20] [--json FILE]`.

Pairs of sessions of the simulated 3R arm (10 s of random motion each, encoder and torque noise). The Coulomb friction
of joint_2 is 0.8 N.m in the first session of a pair, and the listed value in the second. All friction differs between
sessions by the listed spread besides: 0, or 6 % (standard deviation), which is what a fleet assumes. Listed: pairs
with a finding at that parameter, and findings elsewhere (false alarms) over all comparisons.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

import signid
from signid.cli.fleet.changes import ComparedSession, find_changes
from signid.cli.fleet.summary import Summary, summarise
from signid.effects.naming import parse_law
from signid.model import Model
from signid.output.report import to_json
from signid.output.report.results.identification import identification_document
from signid.simulation.excite.families import rest_to_rest_motion
from signid.simulation.plant import Sensors, record, simulate, track

from .summary import command_line, write_json

LEVELS = (0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.6)  # Coulomb friction of joint_2 in the second session [N.m]
FRICTION = ((0.6, 0.9), (0.5, 0.8), (0.2, 0.3))  # viscous [N.m.s/rad] and Coulomb friction [N.m] per joint
SPREAD = 0.06  # standard deviation of friction between sessions, as a share
CHANGED = "coulomb_friction of joint_2: level"
NOISE, BITS, RATE, DURATION, STEP = 0.02, 17, 250.0, 10.0, 1e-3  # over rms torque, bits per turn, [Hz], [s], [s]


class Row(NamedTuple):
    """Findings over pairs of sessions."""

    level: float  # [N.m]
    spread: float  # of friction between the sessions [1]
    found: int  # pairs with a finding at the changed parameter
    pairs: int
    alarms: int  # findings at other parameters
    tested: int  # comparisons of parameters


def session(model: Model, level: float, spread: float, seed: int) -> Summary:
    """Simulate and identify one session."""
    rng = np.random.default_rng(seed)
    laws = list(model.laws)
    for j, values in enumerate(FRICTION):
        viscous, coulomb = np.array(values) * np.exp(spread * rng.standard_normal(2))
        coulomb *= level / 0.8 if j == 1 else 1.0
        laws += [
            parse_law(f"viscous_friction@{j + 1}:coefficient={viscous}", model.robot),
            parse_law(f"coulomb_friction@{j + 1}:level={coulomb}", model.robot),
        ]
    motion = rest_to_rest_motion(model.robot, DURATION, STEP, seed)
    moved = simulate(replace(model, laws=tuple(laws)), track(model, motion), DURATION, step=STEP)
    columns = record(model.robot, moved, Sensors(rate=RATE, noise=NOISE, encoder_bits=BITS), seed=seed)
    found = signid.identify(model.robot, [signid.read_recording(columns, model.robot)])
    return summarise("identify", json.loads(to_json(identification_document(found))))


def measure(model: Model, healthy: Sequence[Summary], level: float, spread: float) -> Row:
    """Findings over pairs of sessions, the first of which is healthy."""
    found = alarms = tested = 0
    for k, first in enumerate(healthy):
        second = session(model, level, spread, 1000 * k + 1)
        pair = [ComparedSession("arm", name, "", one) for name, one in (("first", first), ("second", second))]
        changes, count = find_changes([pair])
        names = [change.number.what for change in changes if change.found]
        found += CHANGED in names
        alarms += sum(name != CHANGED for name in names)
        tested += count
    return Row(level, spread, found, len(healthy), alarms, tested)


def main() -> None:
    """Print the table, and write it as JSON."""
    parser = command_line("fleet_changes", __doc__)
    parser.add_argument("--pairs", type=int, default=20)
    given = parser.parse_args()
    model, table = signid.load_model("3r"), Table("second [N.m]", "spread", "found", "false alarms", "comparisons")
    rows = list[Row]()
    for spread in (0.0, SPREAD):
        healthy = [session(model, 0.8, spread, 1000 * k) for k in range(given.pairs)]
        rows += [measure(model, healthy, level, spread) for level in LEVELS]
    for row in rows:
        shown = (f"{row.level:g}", f"{row.spread:.0%}", f"{row.found} of {row.pairs}", row.alarms, row.tested)
        table.add_row(*map(str, shown))
    Console().print(table)
    write_json(given.json, [row._asdict() for row in rows])


if __name__ == "__main__":
    main()
