"""Precision from an exciting motion compared with random motions: `python -m benchmarks.excite [--json FILE]`.

Panda and UR5, 20 s, URDF limits less 5 %, links at least 1 cm apart, torque noise 1 % of each joint's limit. The
baseline is the best of 100 random Fourier motions, with the harmonics of the exciting motion and with the usual five.
Each joint of a random motion is scaled to its limits about a random centre; the motion is then shrunk until torques
and distances are feasible. All motions start and end at rest. The figure of merit is the ratio of predicted standard
deviations of the base parameters, with friction, offset and armature.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

from signid.effects import EFFECT_NAMES
from signid.model import Model, stated_inertials, stated_laws
from signid.robot import load_robot
from signid.simulation.excite import Excitation, build_limits, excite
from signid.simulation.excite.design import CLEARANCE, Precision, make_feasible, predict_precision
from signid.simulation.excite.families import Fourier, random_parameters
from signid.simulation.excite.problem import build_problem, usual_laws

from .summary import command_line, one_thread, print_targets, write_json

JOINTS = {"panda": [f"panda_joint{i}" for i in range(1, 8)], "ur5": None}
DURATION, RATE, GRID = 20.0, 100.0, 0.01  # duration [s], rate [Hz], time step for scaling random motions [s]
USUAL = 5  # harmonics of a common excitation motion
RATIO, SECONDS = 0.6, 60.0  # upper bounds: ratio of standard deviations [1], design time [s]


@dataclass(frozen=True)
class Row:
    """Exciting motion compared with the best of many random motions."""

    robot: str
    rivals: str
    best_by: str
    geometric_mean: float  # ratio of standard deviations [1]
    median: float
    worst: float
    log_det: tuple[float, float]  # exciting, random motion
    condition: tuple[float, float]


@dataclass(frozen=True)
class Run:
    """Statistics of one search."""

    robot: str
    parameters: int
    seconds: float
    evaluations: int
    largest_use: float  # largest share of a limit in use [1], on a 1 ms grid
    distance: float | None  # smallest distance between links [m], on a 5 ms grid


def load(name: str) -> Model:
    """Load the robot with its URDF parameters and held gripper."""
    robot = load_robot(name, joints=JOINTS[name])
    return Model(robot, stated_inertials(robot), stated_laws(robot))


def draw(model: Model, harmonics: int, like: int, count: int) -> list[Precision]:
    """Evaluate random motions with `harmonics`, in the units of an exciting motion with `like` harmonics."""
    limits, family = build_limits(model.robot), Fourier(DURATION, harmonics, 1 / DURATION)
    same = Fourier(DURATION, like, 1 / DURATION)
    problem, _ = build_problem(model, usual_laws(model, EFFECT_NAMES), same, limits, CLEARANCE, 0)
    basis, rng = family.basis(np.arange(0, DURATION, GRID)), np.random.default_rng(1)
    t, found = np.arange(int(DURATION * RATE) + 1) / RATE, []
    for _ in range(count):
        feasible = make_feasible(problem, family, random_parameters(basis, limits, rng))
        found.append(predict_precision(problem, family.sample(model.robot.joints, feasible.x, t)))
    return found


def compare(robot: str, found: Excitation, rivals: str, worths: Sequence[Precision]) -> Iterator[Row]:
    """Compare with the best random motion by each criterion."""
    best = {
        "determinant": max(worths, key=lambda worth: worth.log_det),
        "condition": min(worths, key=lambda worth: worth.condition),
        "mean deviation": min(worths, key=lambda worth: float(np.mean(np.log(worth.std)))),
    }
    for name, worth in best.items():
        ratio = found.std / worth.std
        numbers = float(np.exp(np.mean(np.log(ratio)))), float(np.median(ratio)), float(ratio.max())
        yield Row(robot, rivals, name, *numbers, (found.log_det, worth.log_det), (found.condition, worth.condition))


def check_targets(rows: Sequence[Row], runs: Sequence[Run]) -> Iterator[tuple[str, bool]]:
    """Yield each target and whether it is met."""
    for run in runs:
        worst = max(row.geometric_mean for row in rows if row.robot == run.robot)
        yield (
            f"{run.robot}: standard deviations {worst:.3f} of the best random ones (at most {RATIO:g})",
            worst <= RATIO,
        )
        yield f"{run.robot}: {run.largest_use:.3f} of the limits in use (at most 1)", run.largest_use <= 1
        apart = run.distance is not None and run.distance >= CLEARANCE
        yield f"{run.robot}: links stay {run.distance or np.nan:.4f} m apart (at least {CLEARANCE:g})", apart
        yield f"{run.robot}: {run.seconds:.1f} s (at most {SECONDS:g})", run.seconds <= SECONDS


def show(rows: Sequence[Row], runs: Sequence[Run]) -> Table:
    """Format the numbers as a table."""
    table = Table(title="standard deviation ratio, exciting over best random motion")
    for name in ("robot", "random motions", "best by", "geometric mean", "median", "worst", "log det", "condition"):
        table.add_column(name, justify="right" if name in ("geometric mean", "median", "worst") else "left")
    for row in rows:
        numbers = (f"{x:.3f}" for x in (row.geometric_mean, row.median, row.worst))
        pairs = (f"{a:.1f} / {b:.1f}" for a, b in (row.log_det, row.condition))
        table.add_row(row.robot, row.rivals, row.best_by, *numbers, *pairs)
    table.caption = "; ".join(f"{r.robot}: {r.parameters} parameters, {r.evaluations} motions evaluated" for r in runs)
    return table


def main() -> None:
    """Measure, print the table and write the numbers; exit with 1 when a target is missed."""
    one_thread()
    parser = command_line("excite", __doc__)
    parser.add_argument("--robot", choices=list(JOINTS), action="append", help="run only this robot (repeatable)")
    parser.add_argument("--count", type=int, default=100, help="number of random motions of each kind (100)")
    parser.add_argument("--harmonics", type=int, default=10, help="harmonics of the exciting motion (10)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    console, rows, runs = Console(), list[Row](), list[Run]()
    for name in options.robot or JOINTS:
        model = load(name)
        with console.status(name):
            start = time.perf_counter()
            found = excite(model, duration=DURATION, rate=RATE, harmonics=options.harmonics, seed=options.seed)
            seconds = time.perf_counter() - start
            runs.append(Run(name, len(found.std), seconds, found.evaluations, found.use.largest, found.distance))
            for harmonics in dict.fromkeys((options.harmonics, USUAL)):
                worths = draw(model, harmonics, options.harmonics, options.count)
                rows += compare(name, found, f"{options.count} of {harmonics} harmonics", worths)
    console.print(show(rows, runs))
    targets = list(check_targets(rows, runs))
    met = print_targets(console, targets)
    machine = {"python": platform.python_version(), "pinocchio": pin.__version__, "numpy": np.__version__}
    numbers = {"rows": rows, "runs": runs}
    write_json(options.json, {"machine": machine, **numbers, "targets": dict(targets)})
    raise SystemExit(0 if met else 1)


if __name__ == "__main__":
    main()
