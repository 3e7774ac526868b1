"""Command: `python -m benchmarks.servo_faults [--seeds 100 101] [--robots pendulum] [--json FILE]`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console

from ..servo.robots import benches
from ..summary import command_line, frame, print_targets, write_json
from .trial import FAULTS, Outcome, run_trial

NAMED, WRONG = 0.9, 0.01  # [1] targets of issue 18


def main() -> int:
    """Run all trials; return 1 if a target is missed."""
    parser = command_line("servo_faults", __doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[100, 101])
    parser.add_argument("--robots", nargs="+", default=["pendulum", "go2_leg", "so101"])
    parser.add_argument("--faults", nargs="+", default=None)
    given, console, outcomes = parser.parse_args(), Console(), list[Outcome]()
    with tempfile.TemporaryDirectory() as place:
        for bench in benches(Path(place), tuple(given.robots)):
            for seed in given.seeds:
                for fault in (None, *FAULTS):
                    if given.faults and (fault.name if fault else "healthy") not in given.faults:
                        continue
                    outcomes.append(run_trial(bench, fault, seed, Path(place)))
                    print_outcome(console, outcomes[-1])
    met = summary(console, outcomes)
    write_json(given.json, outcomes)
    return 0 if met else 1


def print_outcome(console: Console, x: Outcome) -> None:
    """One line a trial."""
    mark = "[green]right[/]" if x.right else "[red]WRONG AND SURE[/]" if x.sure else "[yellow]wrong[/]"
    named = f"{x.first}@{x.first_joint} {x.probability:.2f}" if x.first else x.verdict
    console.print(
        f"{x.robot:9} {x.seed:4} {x.fault:13} {x.joint:15} -> {named:40} {mark} "
        f"{1e3 * x.before:7.2f} -> {1e3 * x.after:6.2f} mrad {x.seconds:5.1f} s",
        highlight=False, soft_wrap=True,
    )  # fmt: skip


def summary(console: Console, outcomes: list[Outcome]) -> bool:
    """Table by robot, and the targets."""
    table = frame(
        "faults of position drives", ["robot", "faults", "named first", "wrong and sure", "healthy silent", "s"]
    )
    for robot in dict.fromkeys(x.robot for x in outcomes):
        table.add_row(robot, *_counts([x for x in outcomes if x.robot == robot]))
    table.add_row("all", *_counts(outcomes))
    console.print(table)
    faulty = [x for x in outcomes if x.fault != "healthy"]
    named = np.mean([x.right for x in faulty]) if faulty else 1.0
    wrong = np.mean([x.sure for x in outcomes])
    silent = all(x.right for x in outcomes if x.fault == "healthy")
    targets = [
        (f"named first: {100 * named:.0f} % (target {100 * NAMED:.0f} %)", bool(named >= NAMED)),
        (f"wrong and sure: {100 * wrong:.1f} % (target {100 * WRONG:.0f} %)", bool(wrong <= WRONG)),
    ]
    return print_targets(console, [*targets, ("healthy robots are silent", silent)])


def _counts(outcomes: list[Outcome]) -> list[str]:
    faulty, well = [x for x in outcomes if x.fault != "healthy"], [x for x in outcomes if x.fault == "healthy"]
    return [
        str(len(faulty)),
        str(sum(x.right for x in faulty)),
        str(sum(x.sure for x in outcomes)),
        f"{sum(x.right for x in well)} of {len(well)}",
        f"{np.median([x.seconds for x in outcomes]):.1f}",
    ]


if __name__ == "__main__":
    raise SystemExit(main())
