"""Where does the time go? `python -m benchmarks.profile [--minutes 1 60] [--robots panda g1] [--json FILE]`.

Robots of 7 and of 29 joints, recorded at 1 kHz: five harmonics within the limits, repeated each minute with other
noise; torque by Pinocchio, with friction that the description does not state. `signid identify` and `signid diagnose`
run twice each in a process of their own: as they are, for time and memory, and under cProfile, for the shares. A
function that no stage names counts for the stages that call it, by the time that it takes for each.

Source: attribution to callers: Graham, Kessler, McKusick, gprof: a call graph execution profiler, ACM SIGPLAN 1982.
"""

from __future__ import annotations

import argparse
import json
import os
import pstats
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import signid
from signid.regression.motion import Motion
from signid.types import Robot

from .long import ONE_THREAD, RATE, write
from .told import frame

Array = NDArray[np.float64]
Function = tuple[str, int, str]  # file, line, name

ROBOTS, MINUTES, COMMANDS = ("panda", "g1"), (1.0, 60.0), ("identify", "diagnose")
PERIOD, WAVES, SLOWEST, FASTEST = 60.0, 5, 6, 54  # s, waves a joint, and how often they fit into the period
REACH = 0.8  # of the room between limits; 2 rad either side where there are none
VISCOUS, COULOMB = 0.3, 0.5  # N.m.s/rad, N.m
ROUNDS = 60  # of attribution, more than any chain of calls is deep
START, REST = "start, imports", "other"
COMMON = {
    "_bootstrap>:_find_and_load": START,
    "robot/load.py:load_robot": "robot",
    "recording/read.py:read_recording": "reading",
    "recording/sampling/survey.py:survey": "survey",
}
STAGES = {
    "identify": {
        **COMMON,
        "recording/sampling/grid.py:samples": "reading",
        "regression/base_parameters.py:build_base": "base map",
        "regression/prepare.py:_band": "band",
        "regression/prepare.py:_reach": "band",
        "regression/motion.py:build_motion": "motion",
        "regression/regressor.py:base_rows": "regressor, low-pass",
        "regression/rows.py:_window_rows": "rows",
        "regression/factors.py:reduce_rows": "factors",
        "estimation/least_squares.py:estimate": "estimate",
        "estimation/excitation.py:judge_excitation": "excitation",
        "estimation/standard.py:choose_standard": "feasible fit",
        "cli/files.py:deliver": "report",
    },
    "diagnose": {
        **COMMON,
        "diagnose/preparation.py:prepare_session": "preparation",
        "recording_faults/examine.py:examine": "recording faults",
        "diagnose/preparation.py:build": "rows",
        "diagnose/search/iterate.py:select": "search",
        "diagnose/findings/alternatives.py:replace_weak": "search",
        "diagnose/search/prune.py:prune": "search",
        "diagnose/findings/findings.py:conclude": "numbers",
        "diagnose/findings/empirical.py:add_empirical_torque": "numbers",
        "diagnose/extend/holdout.py:predict": "comparison",
        "diagnose/extend/holdout.py:compare": "comparison",
        "diagnose/run.py:_roll_out": "roll-outs",
        "cli/files.py:deliver_diagnosis": "report",
    },
}


@dataclass(frozen=True)
class Case:
    """One command on one recording."""

    command: str
    robot: str
    joints: int
    minutes: float
    seconds: float  # of processor time, without a profiler
    memory: float  # MB, most ever held
    profiled: float  # s of processor time under cProfile
    stages: Mapping[str, float]  # s, scaled to `seconds`

    @property
    def name(self) -> str:
        """Over its column."""
        return f"{self.robot}, {self.minutes:g} min"


def load(name: str) -> Robot:
    """A robot without its fingers."""
    robot = signid.load_robot(name)
    return signid.load_robot(name, joints=[joint for joint in robot.joints if "finger" not in joint])


def move(robot: Robot, seed: int = 0) -> tuple[Array, Array]:
    """One period: positions and torque without noise, (N, n) each [rad or m], [N.m or N]."""
    t, n, rng = np.arange(round(PERIOD * RATE)) / RATE, len(robot.joints), np.random.default_rng(seed)
    lower = np.where(np.isfinite(robot.lower), robot.lower, -2.0)
    upper = np.where(np.isfinite(robot.upper), robot.upper, 2.0)
    size = rng.uniform(0.3, 1.0, (WAVES, n))
    size *= REACH * (upper - lower) / 2 / size.sum(axis=0)
    wave = size * np.exp(1j * rng.uniform(0, 2 * np.pi, (WAVES, n)))
    speed = 2 * np.pi / PERIOD * rng.integers(SLOWEST, FASTEST, (WAVES, n))
    turns = [np.exp(1j * np.outer(t, w)) * x for w, x in zip(speed, wave, strict=True)]
    q, v, a = (sum(np.imag((1j * w) ** k * x) for w, x in zip(speed, turns, strict=True)) for k in range(3))
    load_torque = Motion(robot, t, (lower + upper) / 2 + q, v, a).load
    return (lower + upper) / 2 + q, load_torque + VISCOUS * v + COULOMB * np.sign(v)


def run(command: str, robot: str, recording: Path, profile: bool) -> tuple[dict[str, float], Path]:
    """What a process of its own took, and where what cProfile saw is, if that was asked for."""
    told = recording.with_suffix(f".{command}{'.profile' if profile else ''}.json")
    result = recording.with_suffix(f".{command}")
    asked = [command, robot, str(recording), "-o", str(result)]
    watched = [sys.executable, "-m", "benchmarks.watched", str(told), *["--profile"] * profile, *asked]
    done = subprocess.run(
        watched, env={**os.environ, **ONE_THREAD}, capture_output=True, text=True, encoding="utf-8", check=True
    )
    numbers = json.loads(told.read_text(encoding="utf-8"))
    if numbers["code"] not in (0, 3):
        raise SystemExit(f"signid {' '.join(asked)} ended with code {numbers['code']:g}: {done.stderr}")
    return numbers, told.with_name(f"{told.name}.prof")


def attribute(stats: Mapping[Function, Any], stages: Mapping[str, str]) -> dict[str, float]:
    """Seconds of each stage: its own functions' and those of all that they call and that has no stage itself.

    Args:
        stats: of `pstats.Stats`: by function, its own time, callers and the time that each of them caused.
        stages: by the end of a function's file and its name.
    """
    own = {function: stage for function in stats if (stage := _stage(function, stages))}
    shares: dict[Function, dict[str, float]] = {function: {own.get(function, REST): 1.0} for function in stats}
    for _ in range(ROUNDS):
        shares |= {f: _inherited(stats[f][4], shares) for f in stats if f not in own and stats[f][4]}
    found = Counter[str]()
    for function, (_, _, time, _, callers) in stats.items():
        share = shares[function] if function in own else _inherited(callers, shares, 2) or shares[function]
        found.update({stage: time * part for stage, part in share.items()})
    return dict(found)


def _inherited(callers: Mapping[Function, Any], shares: Mapping[Function, Any], which: int = 3) -> dict[str, float]:
    """Of all callers' stages, each caller counted by the time (3: all, 2: own) that it causes."""
    weights = {caller: max(edge[which], 1e-12) for caller, edge in callers.items()}
    total, found = sum(weights.values()), Counter[str]()
    for caller, weight in weights.items():
        found.update({stage: part * weight / total for stage, part in shares[caller].items()})
    return dict(found)


def _stage(function: Function, stages: Mapping[str, str]) -> str:
    place = f"{function[0]}:{function[2]}"
    return next((stage for end, stage in stages.items() if place.endswith(end)), "")


def measure(command: str, name: str, recording: Path, minutes: float) -> Case:
    """One command on one recording, twice."""
    plain, (watched, file) = run(command, name, recording, False)[0], run(command, name, recording, True)
    found = attribute(pstats.Stats(str(file)).stats, STAGES[command])  # type: ignore[attr-defined]
    found[START] = found.get(START, 0.0) + watched["started"]
    scale = plain["seconds"] / sum(found.values())
    stages = {
        stage: scale * found[stage] for stage in dict.fromkeys((*STAGES[command].values(), REST)) if stage in found
    }
    size = len(load(name).joints)
    return Case(command, name, size, minutes, plain["seconds"], plain["memory"], watched["seconds"], stages)


def show(command: str, cases: Sequence[Case]) -> Table:
    """Stages down, cases across: seconds and shares."""
    table = frame(f"signid {command}: processor time, one thread", ["", *(case.name for case in cases)])
    for stage in dict.fromkeys(stage for case in cases for stage in case.stages):
        table.add_row(stage, *(_told(case.stages.get(stage, 0.0), case.seconds) for case in cases))
    table.add_section()
    table.add_row("all", *(f"{case.seconds:.2f} s      " for case in cases))
    table.add_row("most memory", *(f"{case.memory:.0f} MB     " for case in cases))
    return table


def _told(seconds: float, whole: float) -> str:
    return f"{seconds:.2f} s {100 * seconds / whole:3.0f} %"


def _cases(options: argparse.Namespace, folder: Path, console: Console) -> Iterator[Case]:
    for name in options.robots:
        robot = load(name)
        for minutes in options.minutes:
            recording = folder / f"{name}_{minutes:g}.parquet"
            if not recording.exists():
                with console.status(f"recording {name} for {minutes:g} min"):
                    write(recording, round(60 * minutes * RATE), robot.joints, *move(robot))
            for command in options.commands:
                with console.status(f"{command}, {name}, {minutes:g} min"):
                    yield measure(command, name, recording, minutes)


def main() -> None:
    """Record, run, print a table for each command, write the numbers."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.profile", description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=MINUTES, help="how long recordings are")
    parser.add_argument("--robots", nargs="+", default=ROBOTS, help="by name; their fingers are held")
    parser.add_argument("--commands", nargs="+", default=COMMANDS, choices=COMMANDS)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    parser.add_argument("--folder", type=Path, help="where recordings, results and profiles stay, to be used again")
    options, console = parser.parse_args(), Console()
    with tempfile.TemporaryDirectory() as passing:
        folder = options.folder or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        cases = list(_cases(options, folder, console))
    for command in options.commands:
        console.print(show(command, [case for case in cases if case.command == command]))
    if options.json:
        options.json.write_text(json.dumps([asdict(case) for case in cases], indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
