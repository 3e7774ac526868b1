"""Exported position drives beside signid's closed loop and the recording, rolled out without signid.

MuJoCo rolls out the exported MJCF, and the drives that the files of Isaac Lab and mjlab state, from the first row of
recordings of simulated robots with known drives (also at their limits), and of the real Go2 (needs SIGNID_DATA).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from rich.console import Console

from signid.model import Model, load_model, with_servos
from signid.output.export import STARTING, export
from signid.recording import read_recording
from signid.robot import load_robot
from signid.servo.identify import identify_servos
from signid.servos import Servo

from .servo.drive import Drive, Truth
from .servo.identified import RATE, SECONDS, STEP, drawn, saturated
from .servo.plant import record
from .servo.robots import Bench, benches, data_folder, motion
from .summary import command_line, frame, one_thread, print_targets, write_json

CLOSE, BESIDE = 1.0, 1.0  # [mrad] targets: MJCF from signid, other simulators beyond the rounding of delays
STEPS = (0.005, 0.001)  # [s] of the physics in Isaac Lab and mjlab
KNOWN = "kp=20"  # of the Go2, as commanded [N.m/rad]
WIDTH = 150  # of the table


@dataclass(frozen=True)
class Row:
    """Errors of all joints together of one roll-out [mrad]."""

    robot: str
    limits: str  # law at whose limit the drives are, or none
    file: str
    first_signid: float  # over the first 0.2 s
    first_recording: float
    whole_signid: float
    whole_recording: float
    rounding: float  # what whole steps of delay cost


def main() -> int:
    """Print the errors; return 1 if a target is missed."""
    parser = command_line("export_loop", __doc__)
    parser.add_argument("--robots", nargs="+", default=["pendulum", "go2_leg", "so101", "go2"])
    parser.add_argument("--seed", type=int, default=1)
    given, console = parser.parse_args(), Console(width=WIDTH)
    with tempfile.TemporaryDirectory() as place:
        rows = [row for case in cases(Path(place), given.robots, given.seed) for row in rolled(case, Path(place))]
    table = frame(
        "rms position error of all joints [mrad]",
        [
            "robot",
            "at limits",
            "export",
            ".2 s: signid",
            "recording",
            "whole: signid",
            "recording",
            "rounding of delays",
        ],
    )
    for row in rows:
        robot, limits, file, *numbers = asdict(row).values()
        table.add_row(robot, limits, file, *(f"{x:.2f}" for x in numbers))
    console.print(table)
    write_json(given.json, {"rows": [asdict(row) for row in rows]})
    inside = [max(row.first_signid, row.whole_signid) for row in rows if row.file == "mjcf"]
    free = [row for row in rows if row.file != "mjcf" and row.limits == "none"]
    beyond = [row.whole_signid - row.rounding for row in free]
    targets = [
        (f"MJCF from signid: at most {max(inside):.2f} mrad (target {CLOSE:g})", max(inside) <= CLOSE),
        (f"others without limits, beyond the rounding: at most {max(beyond, default=0):.2f} mrad (target {BESIDE:g})",
         max(beyond, default=0) <= BESIDE),
    ]  # fmt: skip
    return 0 if print_targets(console, targets) else 1


class Case(NamedTuple):
    """A robot with its drives, and a recording of it."""

    robot: str
    limits: str
    model: Model
    recording: Path


def cases(folder: Path, names: Sequence[str], seed: int) -> Iterator[Case]:
    """Simulated robots with random drives, free and at the limits of each law, and the real Go2."""
    for bench in benches(folder, tuple(names)):
        rng = np.random.default_rng([seed, 3])
        drives = {joint: drawn(drive, rng) for joint, drive in bench.drives.items()}
        command = motion(bench, seed, SECONDS, RATE, fast=3.0)
        yield recorded(bench, drives, seed)
        for law in ("effort", "duty", "torque_speed"):
            limited = saturated(bench, drives, command, seed, law, rng)
            yield recorded(bench, limited, seed, law)
    data = data_folder()
    if "go2" in names and data:
        recording = data / "go2_dls" / "held_base_first.csv.gz"
        found = identify_servos(load_robot(data / "go2_dls" / "go2.urdf"), [recording], known=KNOWN)
        yield Case("go2, real", "one calf", found.model, recording)


def recorded(bench: Bench, drives: dict[str, Drive], seed: int, limits: str = "none") -> Case:
    """Record a robot in MuJoCo; its model has the true numbers of the drives."""
    path = bench.urdf.with_name(f"{bench.name}_{limits}.csv")
    columns = record(bench.urdf, Truth(drives), motion(bench, seed, SECONDS, RATE, fast=3.0), RATE, seed, step=STEP)
    pl.DataFrame(columns).write_csv(path)
    numbers = {joint: {k: x for k, x in asdict(drive).items() if k != "backlash"} for joint, drive in drives.items()}
    servos = {joint: Servo(**{**x, "delay": x["delay"] - STEP / 2}) for joint, x in numbers.items()}
    return Case(bench.name, limits, with_servos(load_model(bench.urdf), servos), path)


def rolled(case: Case, folder: Path) -> Iterator[Row]:
    """Roll-outs of all exports of a model, by the script that they bring along."""
    model, name = case.model, (case.robot, case.limits)
    read = read_recording(case.recording, model.robot)
    files = {"mjcf": "arm.xml", "isaaclab": "isaaclab.py", "mjlab": "mjlab.py"}
    for kind in STARTING:
        made = export(model, kind, start=read)
        for file, text in {files[kind]: made.text, **{f"arm{end}": x for end, x in made.beside.items()}}.items():
            (folder / file).write_text(text, encoding="utf-8")
    arguments = [str(folder / file) for file in ("arm_check_loop.py", "arm.xml", "arm_loop.json")]
    yield Row(*name, "mjcf", *_errors(arguments)[0])
    for kind in STARTING[1:]:
        text = (folder / files[kind]).read_text(encoding="utf-8")
        for step in STEPS:
            (folder / "set.py").write_text(
                text.replace("PHYSICS_STEP = 0.005", f"PHYSICS_STEP = {step}"), encoding="utf-8"
            )
            each = _errors([*arguments, "--actuators", str(folder / "set.py")])
            best = min(each, key=lambda numbers: numbers[-1])  # of delays rounded down and up
            yield Row(*name, f"{kind}, {1e3 * step:g} ms", *best)


def _errors(arguments: Sequence[str]) -> list[list[float]]:
    """Numbers of all joints together that the script prints, one list a roll-out; signid cannot be imported there."""
    done = subprocess.run([sys.executable, "-I", *arguments], capture_output=True, encoding="utf-8", check=True)
    return [[float(x) for x in line.split()[1:]] for line in done.stdout.splitlines() if line.startswith("all ")]


if __name__ == "__main__":
    one_thread()
    raise SystemExit(main())
