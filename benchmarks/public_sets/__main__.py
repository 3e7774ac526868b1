"""Real sets as specifications of IdentiBench: `python -m benchmarks.public_sets DIR [--sets S ...] [--check]`.

Needs SIGNID_DATA, and IdentiBench (`pip install identibench==0.4.0`). Part A of each set is training, B validation and
C test data; rows are those of `benchmarks.blackbox`. `--check` runs three simple models through IdentiBench and
compares its score of least squares with `benchmarks.blackbox`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from signid.errors import SignidError
from signid.regression.motion import Motion
from signid.simulation.rollout.windows import restrict_joints

from ..blackbox import methods
from ..blackbox.task import Task, build
from ..concealed_real.sets import SETS
from ..summary import command_line, data, frame, one_thread, print_targets, write_json
from .specification import Model, read, specifications
from .write import PARTS, SetFiles, missing, refusal, set_files, write_readme, write_set, write_specification

Builder = Callable[[Any], Model]  # context of IdentiBench -> model


@dataclass(frozen=True)
class Checked:
    """Scores of a set by IdentiBench."""

    zero: float  # headline of a model that predicts no torque
    affine: float  # headline of a fit of an affine function
    least_squares: float  # headline of signid's least squares; 1 if all rows agree
    difference: float  # largest relative difference of its rms from `benchmarks.blackbox`, over joints


def zero(context: Any) -> Model:
    """Build the model that predicts zero torque."""
    width = len(context.spec.y_cols)
    return lambda u, y_init, attributes: np.zeros((len(u), width))


def affine(context: Any) -> Model:
    """Fit torque by an affine function of q, dq, ddq and the signs of dq, on training and validation rows."""
    spec = context.spec
    columns, targets = [], []
    for path in (*spec.train_files(), *spec.valid_files()):
        u, y, rows, _ = read(path, spec.task.joints)
        columns.append(rows(_features(u)))
        targets.append(np.where(rows.counts, rows(y), np.nan))
    x, tau = np.concatenate(columns), np.concatenate(targets)
    counts = np.isfinite(tau).T
    weights = np.column_stack([np.linalg.lstsq(x[own], t[own])[0] for t, own in zip(tau.T, counts, strict=True)])
    return lambda u, y_init, attributes: _features(u) @ weights


def least_squares(task: Task) -> Builder:
    """Builder of the least-squares model of a task; it is fitted to the recordings, not to the files."""
    own = restrict_joints(task.least_squares, [task.c])[0]

    def model(u: Any, y_init: Any, attributes: dict[str, Any]) -> Any:
        q, v, a = np.split(np.asarray(u, float), 3, axis=1)
        t = np.arange(len(u)) / float(attributes["fs"])
        return own.inverse(Motion(own.robot, t, q, v, a, slow=np.asarray(attributes["slow"], float)))

    return lambda context: model


def check(spec: Any, found: SetFiles) -> Checked:
    """Run three models through IdentiBench."""
    from identibench import run_benchmark

    scores = [run_benchmark(spec, build, seed=0) for build in (zero, affine, least_squares(found.task))]
    here = np.array([scores[-1]["test_sets"]["test"][f"rms_{joint}"] for joint in found.task.joints])
    there = np.array(found.least_squares_rms)
    return Checked(*(x["metric_score"] for x in scores), float(np.nanmax(np.abs(here / there - 1))))


def size(place: Path) -> float:
    """Size of the files of a set [MB]."""
    return sum(x.stat().st_size for x in place.rglob("*.hdf5")) / 1e6


def _features(u: Any) -> np.ndarray:
    u = np.asarray(u, float)
    n = u.shape[1] // 3
    return np.column_stack([u, np.sign(u[:, n : 2 * n]), np.ones(len(u))])


CLOSE = 1e-4  # [1] largest relative difference of least squares: files have single precision
Row = dict[str, Any]


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = command_line("public_sets", __doc__)
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder to write; outside of the repository")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="SET", help=", ".join(SETS))
    parser.add_argument("--check", action="store_true", help="run simple models through IdentiBench")
    return parser.parse_args()


def main() -> int:
    """Write the sets and print a table; with `--check`, return 1 if a score differs."""
    one_thread()
    options, console, found = parse(), Console(width=160), list[Row]()
    data()
    if problem := missing() or refusal(options.folder):
        sys.exit(problem)
    write_specification(options.folder)
    for name in options.sets:
        try:
            found.append(_run(options, name))
        except SignidError as error:
            console.print(f"{name}: {error}", soft_wrap=True, highlight=False, markup=False)
    if not found:
        return 1
    write_readme(options.folder)
    console.print(table(found))
    write_json(options.json, found)
    differences = [x["difference"] for x in found if "difference" in x]
    if not differences:
        return 0
    worst = max(differences)
    sentence = f"least squares as in benchmarks.blackbox within {CLOSE:g}: largest difference {worst:.1g}"
    return int(not print_targets(console, [(sentence, worst <= CLOSE)]))


def table(rows: Sequence[Row]) -> Table:
    """Table with one line per set."""
    names = ("set", "joints", "Hz", "MB", *(f"rows, {part}" for part in PARTS), "zero", "affine", "least squares")
    out = frame("rows per joint, and rms over least squares by IdentiBench", (*names, "difference"))
    for row in rows:
        scores = (f"{row[key]:.3g}" if key in row else "-" for key in ("zero", "affine", "least_squares", "difference"))
        counts = (f"{max(row['rows'][part])}" for part in PARTS)
        out.add_row(row["set"], str(row["joints"]), f"{row['cutoff']:.3g}", f"{row['size']:.1f}", *counts, *scores)
    return out


def _run(options: argparse.Namespace, name: str) -> Row:
    """Write a set, and check it if wanted."""
    task = build(SETS[name], methods.least_squares)
    found = set_files(task)
    place = write_set(options.folder, SETS[name], found)
    counts = {part: found.rows(part) for part in PARTS}
    row = {"set": name, "joints": len(task.joints), "cutoff": task.cutoff, "size": size(place), "rows": counts}
    return row | asdict(check(specifications(options.folder)[name], found)) if options.check else row


if __name__ == "__main__":
    raise SystemExit(main())
