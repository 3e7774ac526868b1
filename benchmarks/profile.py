"""Processor time by stage: `python -m benchmarks.profile [--minutes 1 60] [--robots panda g1] [--json FILE]`.

Robots with 7 and 29 joints are recorded at 1 kHz: five harmonics within the limits, repeated each minute with
independent noise; torque by Pinocchio, with friction missing in the description. `signid identify` and `signid
diagnose` run twice in separate processes: plainly for time and memory, and under cProfile for the shares. The time of a
function without a stage is attributed to the stages of its callers, in proportion to the time that each causes.

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import signid
from signid.regression.motion import Motion
from signid.types import Array, Robot

from .long import ONE_THREAD, RATE, write
from .summary import command_line, frame, write_json

Function = tuple[str, int, str]  # file, line, name

ROBOTS, MINUTES, COMMANDS = ("panda", "g1"), (1.0, 60.0), ("identify", "diagnose")
PERIOD, WAVES, SLOWEST, FASTEST = 60.0, 5, 6, 54  # period [s], waves per joint, least and most cycles per period
REACH = 0.8  # share of the joint range [1]; joints without limits use +-2 rad
VISCOUS, COULOMB = 0.3, 0.5  # friction of every joint [N.m.s/rad], [N.m]
ROUNDS = 60  # iterations of the attribution, above the depth of any call chain
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
        "regression/session.py:_band": "band",
        "regression/session.py:_reach": "band",
        "regression/motion.py:build_motion": "motion",
        "regression/motion.py:base_rows": "regressor, low-pass",
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
        "faults/examine.py:examine": "recording faults",
        "diagnose/preparation.py:build": "rows",
        "diagnose/search/iterate.py:select": "search",
        "diagnose/findings/alternatives.py:replace_weak": "search",
        "diagnose/search/prune.py:prune": "search",
        "diagnose/findings/findings.py:conclude": "numbers",
        "diagnose/findings/held_out_prediction.py:add_empirical_torque": "numbers",
        "diagnose/extend/holdout.py:predict": "comparison",
        "diagnose/extend/holdout.py:compare": "comparison",
        "diagnose/run.py:_roll_out": "roll-outs",
        "cli/files.py:deliver_diagnosis": "report",
    },
}


@dataclass(frozen=True)
class Case:
    """Results of one command on one recording."""

    command: str
    robot: str
    joints: int
    minutes: float
    seconds: float  # processor time without profiler
    memory: float  # peak [MB]
    profiled: float  # processor time under cProfile [s]
    stages: Mapping[str, float]  # time of each stage [s], scaled to `seconds`

    @property
    def name(self) -> str:
        """Column heading."""
        return f"{self.robot}, {self.minutes:g} min"


def load(name: str) -> Robot:
    """Load a robot with its fingers held."""
    robot = signid.load_robot(name)
    return signid.load_robot(name, joints=[joint for joint in robot.joints if "finger" not in joint])


def move(robot: Robot, seed: int = 0) -> tuple[Array, Array]:
    """Noise-free positions and torque over one period, (N, n) each [rad or m], [N.m or N]."""
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
    """Run a command in a separate process; return its numbers and the path of the cProfile output."""
    numbers_file = recording.with_suffix(f".{command}{'.profile' if profile else ''}.json")
    result = recording.with_suffix(f".{command}")
    arguments = [command, robot, str(recording), "-o", str(result)]
    wrapper = [sys.executable, "-m", "benchmarks.measure_command", str(numbers_file), *["--profile"] * profile]
    environment = {**os.environ, **ONE_THREAD}
    done = subprocess.run(
        [*wrapper, *arguments], env=environment, capture_output=True, text=True, encoding="utf-8", check=True
    )
    numbers = json.loads(numbers_file.read_text(encoding="utf-8"))
    if numbers["code"] not in (0, 3):
        raise SystemExit(f"signid {' '.join(arguments)} ended with code {numbers['code']:g}: {done.stderr}")
    return numbers, numbers_file.with_name(f"{numbers_file.name}.prof")


def attribute(stats: Mapping[Function, Any], stages: Mapping[str, str]) -> dict[str, float]:
    """Time of each stage [s]: its own functions and all called functions without a stage.

    Args:
        stats: `stats` of `pstats.Stats`: own time and callers of each function, with the time caused by each caller.
        stages: stage names by the end of a function's path and its name.
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
    """Stage shares of all callers, weighted by the caused time (3: cumulative, 2: own)."""
    weights = {caller: max(edge[which], 1e-12) for caller, edge in callers.items()}
    total, found = sum(weights.values()), Counter[str]()
    for caller, weight in weights.items():
        found.update({stage: part * weight / total for stage, part in shares[caller].items()})
    return dict(found)


def _stage(function: Function, stages: Mapping[str, str]) -> str:
    place = f"{function[0]}:{function[2]}"
    return next((stage for end, stage in stages.items() if place.endswith(end)), "")


def measure(command: str, name: str, recording: Path, minutes: float) -> Case:
    """Run one command on one recording twice, without and with the profiler."""
    plain, (profiled, file) = run(command, name, recording, False)[0], run(command, name, recording, True)
    found = attribute(pstats.Stats(str(file)).stats, STAGES[command])  # type: ignore[attr-defined]
    found[START] = found.get(START, 0.0) + profiled["started"]
    scale = plain["seconds"] / sum(found.values())
    stages = {
        stage: scale * found[stage] for stage in dict.fromkeys((*STAGES[command].values(), REST)) if stage in found
    }
    size = len(load(name).joints)
    return Case(command, name, size, minutes, plain["seconds"], plain["memory"], profiled["seconds"], stages)


def show(command: str, cases: Sequence[Case]) -> Table:
    """Table of seconds and shares: one row per stage, one column per case."""
    table = frame(f"signid {command}: processor time, one thread", ["", *(case.name for case in cases)])
    for stage in dict.fromkeys(stage for case in cases for stage in case.stages):
        table.add_row(stage, *(_share(case.stages.get(stage, 0.0), case.seconds) for case in cases))
    table.add_section()
    table.add_row("all", *(f"{case.seconds:.2f} s      " for case in cases))
    table.add_row("peak memory", *(f"{case.memory:.0f} MB     " for case in cases))
    return table


def _share(seconds: float, whole: float) -> str:
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
    """Record, run, print a table for each command and write the numbers."""
    parser = command_line("profile", __doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=MINUTES, help="durations of the recordings [min]")
    parser.add_argument("--robots", nargs="+", default=ROBOTS, help="names of the robots; fingers are held")
    parser.add_argument("--commands", nargs="+", default=COMMANDS, choices=COMMANDS)
    parser.add_argument("--folder", type=Path, help="keep recordings, results and profiles there and reuse them")
    options, console = parser.parse_args(), Console()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        cases = list(_cases(options, folder, console))
    for command in options.commands:
        console.print(show(command, [case for case in cases if case.command == command]))
    write_json(options.json, cases)


if __name__ == "__main__":
    main()
