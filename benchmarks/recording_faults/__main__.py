"""Detection rate of planted recording faults, and false alarms on intact recordings.

MuJoCo moves the healthy robots of the blind benchmark, every second one with 5 % wrong inertials and creeping dry
friction. Faults are planted in the columns of their recordings. Each fault must be found at its joints, and nothing
else. Intact recordings, and those of robots with an effect of 15 % of torque (`--effects`), must pass. `--senseless`:
answers of check, identify and diagnose to senseless recordings of the 3r.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from rich.console import Console
from rich.table import Table

import signid
from signid.check import check
from signid.faults import RecordingFault, examine
from signid.model import Model, load_model
from signid.recording import read_recording
from signid.regression.session import prepare
from signid.types import Recording, Robot

from ..concealed.cases import Case, cases
from ..concealed.session import make
from ..summary import command_line, one_thread, write_json
from .faults import ALONE, FAULTS, spoiled
from .senseless import Columns, senseless

ROBOT = Path(__file__).parents[2] / "robots" / "3r"
COMMANDS = ("check", "identify", "diagnose")


class Said(NamedTuple):
    """Exit codes of the three commands for a recording, and the first sentence."""

    name: str
    codes: tuple[int, ...]  # 0 silent, 2 refused, 3 flagged
    sentence: str


def answers() -> Iterator[Said]:
    """Yield the answers for the good recording, and for each senseless one."""
    robot, model = signid.load_robot("3r"), signid.load_model("3r")
    rows, other = (signid.read_recording(ROBOT / f"{name}.parquet", robot).read() for name in ("recording", "held_out"))
    made: dict[str, Columns] = {"good": {"t": rows.t, "q": rows.q, "tau": rows.tau}}
    for name, columns in (made | senseless(rows.t, rows.q, rows.tau, other.tau)).items():
        results = [_answer(command, robot, model, columns) for command in COMMANDS]
        sentence = next((flags[0] for _, flags in results if flags), "")
        yield Said(name, tuple(code for code, _ in results), sentence)


def _answer(command: str, robot: Robot, model: Model, columns: Columns) -> tuple[int, tuple[str, ...]]:
    """Exit code and flags."""
    runs: dict[str, Callable[[Recording], tuple[str, ...]]] = {
        "check": lambda recording: check(robot, [recording]).flags,
        "identify": lambda recording: signid.identify(robot, [recording]).flags,
        "diagnose": lambda recording: tuple(signid.diagnose(model, [recording]).flags),
    }
    try:
        flags = runs[command](signid.read_recording(columns, robot))
    except ValueError as error:
        return 2, (str(error),)
    return (3 if flags else 0), flags


def show_answers(found: list[Said]) -> Table:
    """Table of exit codes and first sentences."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for head in ("recording", *COMMANDS, "first sentence"):
        table.add_column(head, no_wrap=True)
    for said in found:
        table.add_row(said.name, *map(str, said.codes), said.sentence[:100])
    return table


ROBOTS = ("1r", "3r", "ur5", "panda", "kinova", "xarm7", "z1")
COMMANDED = "torque_saturation"  # records the commanded torque, so `unexplained torque` is a correct finding
MEANT = ("torque_sign", "channel_swap")  # effects that are recording faults themselves
SILENT = ("good", "time_double")  # friction and rotors explain a slow motion with half the speed as well
FOUND, WRONG, FALSE = 0.97, 0.01, 0.01  # bounds [1]: found (lower), misnamed (upper), false alarms (upper)


@dataclass(frozen=True)
class Row:
    """Result of one examined recording session."""

    fault: str
    robot: str
    seed: int
    joints: tuple[str, ...]
    outcome: str  # "found", "or": as an alternative, "more": with a further finding, "other", "silent"
    said: tuple[str, ...]  # all findings
    seconds: float


def examined(model: Model, logs: Sequence[Columns]) -> tuple[Sequence[RecordingFault] | None, str, float]:
    """Findings (or the error that refuses the recordings) and processor time [s]."""
    start = time.process_time()
    try:
        recordings = [read_recording(columns, model.robot) for columns in logs]
        session = prepare(model.robot, recordings, recordings)
        return examine(model, session).findings, "", time.process_time() - start
    except ValueError as error:
        return None, str(error), time.process_time() - start


def outcome(
    found: Sequence[RecordingFault] | None, error: str, kind: str, about: tuple[str, ...]
) -> tuple[str, tuple[str, ...]]:
    """Outcome for a planted fault, and the kinds and joints of all findings."""
    if found is None:
        return ("found" if kind in error or (kind == "too little data" and "short" in error) else "other"), (error,)
    flagged = [f for f in found if f.severity != "note" and f.kind not in ("excitation", "torque limit")]
    kinds = tuple(f"{f.kind} {' '.join(f.joints)}" for f in flagged)
    if any(f.kind == kind and (not about or f.joints == about) for f in flagged):
        return "found" if len(flagged) == 1 else "more", kinds
    if any((kind, about) in f.alternatives for f in flagged):
        return "or", kinds
    return "other" if flagged else "silent", kinds


def rows(case: Case, cache: Path, faults: Sequence[str]) -> Iterator[Row]:
    """Yield the results of an intact session (fault `""`) and of the session with each fault."""
    folder = make(case, cache)
    model = load_model(folder / "robot.urdf", folder / "actuators.toml")
    logs = [dict(pl.read_parquet(path).to_dict(as_series=False)) for path in sorted(folder.glob("*.parquet"))]
    whole = [{key: np.array(x) for key, x in columns.items()} for columns in logs]
    for fault in faults:
        rng = np.random.default_rng([case.number % 2**32, len(fault)])
        planted = (whole, ()) if not fault else spoiled(fault, whole, model.robot.joints, rng)
        if planted is None or (fault in ALONE and len(model.robot.joints) == 1):
            continue
        found, error, seconds = examined(model, planted[0])
        kind = FAULTS[fault][0] if fault else ""
        result, kinds = outcome(found, error, kind, planted[1])
        yield Row(fault or (*case.effects, "healthy")[0], case.robot, case.seed, planted[1], result, kinds, seconds)


def false_alarm(row: Row) -> bool:
    """Whether any finding is wrong."""
    return any(not (row.fault == COMMANDED and kind.startswith("unexplained torque")) for kind in row.said)


def show(found: Sequence[Row]) -> Table:
    """Table of outcome counts by fault."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    heads = ("found", "or", "more", "other", "silent")
    table.add_column("fault")
    for head in ("sessions", *heads, "s"):
        table.add_column(head, justify="right")
    for fault in dict.fromkeys(row.fault for row in found):
        own = [row for row in found if row.fault == fault]
        counts = (str(sum(row.outcome == head for row in own) or "") for head in heads)
        table.add_row(fault, str(len(own)), *counts, f"{np.mean([row.seconds for row in own]):.2f}")
    return table


def main() -> None:
    """Examine all sessions, print the table and write the numbers; exit with 1 when a target is missed."""
    one_thread()
    parser = command_line("recording_faults", __doc__)
    parser.add_argument("--quick", action="store_true", help="3r and ur5, two sessions each")
    parser.add_argument("--effects", action="store_true", help="add robots with an effect of 15 %% of torque")
    parser.add_argument("--senseless", action="store_true", help="give senseless recordings of the 3r to each command")
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=ROBOTS)
    parser.add_argument("--seed", type=int, default=0, help="seed of motions, noise and planted faults")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keep sessions in DIR")
    options = parser.parse_args()
    if options.senseless:
        answered = list(answers())
        Console().print(show_answers(answered))
        raise SystemExit(any(0 in said.codes for said in answered if said.name not in SILENT))
    console, found, robots = Console(), [], ("3r", "ur5") if options.quick else options.robots
    with tempfile.TemporaryDirectory() as folder:
        healthy = [c for c in cases(("none",), robots, (0.15,), (options.seed,)) if not options.quick or c.seed % 6 < 2]
        others = cases(("exact",), robots, (0.15,), (options.seed,)) if options.effects else []
        work = [(c, ("", *FAULTS)) for c in healthy] + [(c, ("",)) for c in others if c.effects[0] not in MEANT]
        for case, faults in work:
            with console.status(case.key):
                found += list(rows(case, options.cache or Path(folder), faults))
    console.print(show(found))
    for row in found:
        if row.outcome in ("more", "other") or (row.outcome == "silent" and row.fault in FAULTS):
            finding = f"{row.fault} {' '.join(row.joints)}, {row.robot} {row.seed}: {'; '.join(row.said) or 'nothing'}"
            console.print(finding, highlight=False)
    write_json(options.json, found)
    planted = [row for row in found if row.fault in FAULTS]
    right = np.mean([row.outcome in ("found", "or") for row in planted])
    wrong = np.mean([row.outcome == "other" for row in planted])
    false_alarms = np.mean([false_alarm(row) for row in found if row.fault not in FAULTS])
    console.print(f"found {right:.1%}, misnamed {wrong:.1%}, false alarms {false_alarms:.1%}", highlight=False)
    raise SystemExit(0 if right >= FOUND and wrong <= WRONG and false_alarms <= FALSE else 1)


if __name__ == "__main__":
    main()
