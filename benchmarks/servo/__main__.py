"""Command: `python -m benchmarks.servo [truth coverage real models] [--seeds 1 2] [--json F]`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console

from ..summary import command_line, frame, print_targets, write_json
from .coverage import Interval, cases, intervals
from .identified import KNOWN_LOAD, NUMBERS, Row, Trial, run
from .real import friction_models, sets
from .robots import Bench, benches

WORST = {"kp": 0.03, "damping": 0.03, "coulomb_friction": 0.03, "armature": 0.05, "delay": 3e-4}
MEDIAN = {"kp": 0.01, "damping": 0.01, "coulomb_friction": 0.01, "armature": 0.02, "delay": 3e-4}
LAWS = ("effort", "duty")
SIDES = 1.96  # standard deviations of a 95 % interval
COVERED: dict[str, Callable[[Interval], object]] = {
    "": lambda row: row.number,
    "bits": lambda row: row.case.bits,
    "command": lambda row: row.case.kind,
    "rate": lambda row: row.case.rate,
    "plant": lambda row: row.case.plant,
    "saturated": lambda row: row.case.limited,
}  # what intervals are grouped by
WIDTH = 150  # of the tables


def main() -> int:
    """Run the parts that were asked for; return 1 if a target is missed."""
    parser = command_line("servo", __doc__)
    parser.add_argument("parts", nargs="*", default=["truth", "coverage", "real", "models"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--robots", nargs="+", default=["pendulum", "go2_leg", "so101"])
    given, console, kept, met = parser.parse_args(), Console(width=WIDTH), dict[str, object](), True
    with tempfile.TemporaryDirectory() as place:
        found = benches(Path(place), tuple(given.robots))
        if "truth" in given.parts:
            free = _trials(found, given.seeds, Path(place), None)
            clipped = [t for law in LAWS for t in _trials(found, given.seeds[:2], Path(place), law)]
            met &= show_truth(console, free, clipped)
            kept["truth"] = [asdict(row) for trial in (*free, *clipped) for row in trial.rows]
        if "coverage" in given.parts:
            held, kept["coverage"] = show_coverage(console, given.seeds, Path(place))
            met &= held
        if "real" in given.parts:
            kept["real"] = show_real(console, Path(place))
        if "models" in given.parts:
            kept["models"] = show_models(console, Path(place))
    write_json(given.json, kept)
    return 0 if met else 1


def _trials(found: Sequence[Bench], seeds: Sequence[int], folder: Path, law: str | None) -> list[Trial]:
    return [run(bench, seed, folder, law) for bench in found for seed in seeds]


def show_truth(console: Console, free: Sequence[Trial], clipped: Sequence[Trial]) -> bool:
    """Errors and coverage of unsaturated and saturated drives."""
    rows = [row for trial in free for row in trial.rows if row.load > KNOWN_LOAD]
    hard = [row for trial in clipped for row in trial.rows if row.load > KNOWN_LOAD]
    table = frame(
        "MuJoCo, truth known: relative error (delay: s)",
        ["number", "median", "worst", "coverage", "of", "clipped: median", "worst"],
    )
    for name in NUMBERS:
        some, more = ([row for row in each if row.number == name] for each in (rows, hard))
        if some or more:
            table.add_row(name, *_errors(some), _coverage(some), str(len(some)), *_errors(more))
    console.print(table)
    everything = [row.covered for row in rows if row.covered is not None]
    named = [true == law for trial in clipped for true, law in trial.laws]
    targets = [
        (f"{name}: median {_median(rows, name):.4f} (target {MEDIAN[name]:g}), worst {_worst(rows, name):.4f} "
         f"(target {WORST[name]:g})", _median(rows, name) <= MEDIAN[name] and _worst(rows, name) <= WORST[name])
        for name in MEDIAN
    ]  # fmt: skip
    share = float(np.mean(everything)) if everything else 0.0
    targets.append((f"coverage {share:.2f} of {len(everything)} intervals (target .93 to .97)", 0.93 <= share <= 0.97))
    targets.append(
        (f"law of saturated drives: {sum(named)} of {len(named)} (target 9 of 10)", sum(named) >= 0.9 * len(named))
    )
    seconds = [trial.seconds for trial in free]
    console.print(f"processor seconds a robot: {min(seconds):.1f} to {max(seconds):.1f}", highlight=False)
    return print_targets(console, targets)


def show_coverage(console: Console, seeds: Sequence[int], folder: Path) -> tuple[bool, list[dict[str, object]]]:
    """Coverage of 95 % intervals on two plants: whether it is as it should be, and all intervals."""
    rows = [one for case in cases(seeds) for one in intervals(case, folder)[0]]
    table = frame("95 % intervals of drives in two plants", ["", "held", "of", "rms of error / std"])
    table.add_row("all", *_held(rows))
    for title, kind in COVERED.items():
        for value in sorted({kind(row) for row in rows}):
            table.add_row(f"{title} {value}".strip(), *_held([row for row in rows if kind(row) == value]))
    console.print(table)
    share = float(np.mean([abs(row.score) <= SIDES for row in rows]))
    said = f"coverage {share:.3f} of {len(rows)} intervals (target .93 to .97)"
    kept: list[dict[str, object]] = [asdict(row) for row in rows]
    return print_targets(console, [(said, 0.93 <= share <= 0.97)]), kept


def _held(rows: Sequence[Interval]) -> tuple[str, str, str]:
    score = np.array([row.score for row in rows])
    return f"{np.mean(np.abs(score) <= SIDES):.3f}", str(len(score)), f"{np.sqrt(np.mean(score**2)):.2f}"


def show_real(console: Console, folder: Path) -> list[dict[str, object]]:
    """Held-out errors of real servos."""
    table = frame(
        "real servos: rms [rad] of held-out recordings from commands alone",
        ["set", "joints", "whole", "1 s", "q = q_des", "target", "s", "still missing"],
    )
    kept = []
    for row in sets(folder):
        sizes = (f"{x:.4f}" for x in (row.whole, row.second, row.ideal))
        table.add_row(row.name, str(row.joints), *sizes, row.target, f"{row.seconds:.1f}", row.missing)
        kept.append(asdict(row))
    console.print(table)
    return kept


def show_models(console: Console, folder: Path) -> list[dict[str, object]]:
    """Friction models of a real servo beside each other."""
    table = frame(
        "XL330, friction models: errors in mrad of held-out recordings from commands alone",
        ["held out", "model", "mean |error|", "rms", "log Bayes factor", "probability", "s"],
    )
    kept = list[dict[str, object]]()
    for held, one in friction_models(folder):
        sizes = (1e3 * float(one.mean_absolute[0]), 1e3 * float(one.rms[0]), one.log_bayes_factor)
        share = "-" if np.isnan(one.probability) else f"{one.probability:.2f}"
        table.add_row(held, one.name, *(f"{x:.1f}" for x in sizes), share, f"{one.seconds:.1f}")
        kept.append({"held_out": held, "model": one.name, "errors": sizes, "seconds": one.seconds})
    console.print(table)
    return kept


def _errors(rows: Sequence[Row]) -> tuple[str, str]:
    sizes = [row.error for row in rows if np.isfinite(row.error)]
    return (f"{np.median(sizes):.4f}", f"{max(sizes):.4f}") if sizes else ("-", "-")


def _coverage(rows: Sequence[Row]) -> str:
    held = [row.covered for row in rows if row.covered is not None]
    return f"{np.mean(held):.2f}" if held else "-"


def _median(rows: Sequence[Row], name: str) -> float:
    return float(np.nanmedian([row.error for row in rows if row.number == name] or [np.inf]))


def _worst(rows: Sequence[Row], name: str) -> float:
    return float(np.nanmax([row.error for row in rows if row.number == name] or [np.inf]))


if __name__ == "__main__":
    raise SystemExit(main())
