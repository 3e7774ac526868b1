"""Physical models and black boxes on real data: `python -m benchmarks.blackbox [--sets S ...] [--json FILE]`.

Needs SIGNID_DATA. Parts A and B of each real set are training data; part C is held out. All methods are evaluated on
the same filtered rows of C: rms and R2 of each joint. `diagnose` identifies A and B and diagnoses both; `diagnose, B`
identifies A and diagnoses B.
"""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from signid.errors import SignidError

from ..concealed_real.sets import SETS, RealSet
from ..summary import command_line, data, frame, one_thread, write_json
from . import methods
from .task import Answer, Array, Method, Task, build

BASE = "least squares"
Row = dict[str, Any]
DIAGNOSES = {"signid diagnose, B": partial(methods.diagnose, first=True), "signid diagnose": methods.diagnose}
NAMES: dict[str, Method] = {
    "description": methods.description,
    BASE: methods.least_squares_answer,
    "boosted residual": methods.boosted,
    "GP residual": methods.gaussian,
    "signid identify": methods.identify,
    "signid identify, A": partial(methods.identify, first=True),
    **DIAGNOSES,
}


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = command_line("blackbox", __doc__)
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS), metavar="SET", help=", ".join(SETS))
    parser.add_argument("--limit", type=float, default=methods.LIMIT, metavar="S", help="of a diagnosis (%(default)g)")
    parser.add_argument("--skip", nargs="+", choices=NAMES, default=[], metavar="METHOD", help=", ".join(NAMES))
    options = parser.parse_args()
    if BASE in options.skip:
        parser.error(f"{BASE} cannot be skipped: the other methods are compared with it")
    return options


def main() -> int:
    """Run every set; print its table and the summary."""
    one_thread()
    options, console = parse(), Console(width=240)
    data()
    if problem := methods.missing():
        sys.exit(problem)
    found: list[SetResult] = []
    selected = {name: method for name, method in NAMES.items() if name not in options.skip}
    selected |= {name: partial(x, limit=options.limit) for name, x in DIAGNOSES.items() if name in selected}
    for name in options.sets:
        try:
            found.append(run(SETS[name], selected))
        except SignidError as error:
            console.print(f"{name}: {error}", soft_wrap=True, highlight=False, markup=False)
            continue
        console.print(set_table(found[-1]))
        write_json(options.json, {"sets": found, "totals": totals(found)})
    console.print(summary(totals(found)))
    return 0


@dataclass(frozen=True)
class Score:
    """Figures of a method on a set; empty if it could not run."""

    method: str
    rms: tuple[float, ...] = ()  # [N.m or N] per joint
    r2: tuple[float, ...] = ()
    seconds: float = 0.0  # processor time
    note: str = ""  # the reason if it could not run


@dataclass(frozen=True)
class SetResult:
    """Figures of all methods on one set."""

    name: str
    joints: tuple[str, ...]
    unit: tuple[str, ...]
    rows: tuple[int, ...]  # per joint
    cutoff: float  # [Hz]
    scores: tuple[Score, ...]


def run(one: RealSet, selected: Mapping[str, Method]) -> SetResult:
    """Run all methods on a set; an error of one method becomes its note.

    Raises:
        SignidError: the set cannot be read, or least squares cannot be fitted.
    """
    task = build(one, methods.least_squares)
    found: dict[str, Answer | str] = {name: _answer(method, task) for name, method in selected.items()}
    return evaluate(task, found)


def evaluate(task: Task, found: Mapping[str, Answer | str]) -> SetResult:
    """Compute the figures of each method on the rows that all of them predict."""
    answers = {name: x for name, x in found.items() if isinstance(x, Answer)}
    torque, base = task.held_out.torque, np.isfinite(task.held_out.rest)
    finite = {name: np.isfinite(x.residual) & base for name, x in answers.items() if x.residual.shape == base.shape}
    finite = {name: own for name, own in finite.items() if own.any(axis=0)[base.any(axis=0)].all()}
    counts = np.logical_and.reduce([base, *finite.values()])
    scores = []
    for name, answer in found.items():
        if isinstance(answer, str):
            scores.append(Score(name, note=answer))
        elif name not in finite:
            scores.append(Score(name, seconds=answer.seconds, note="predicts no finite torque on these rows"))
        else:
            scores.append(Score(name, *figures(answer.residual, torque, counts), answer.seconds, answer.note))
    robot = task.least_squares.robot
    unit = tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic)
    return SetResult(task.name, task.joints, unit, tuple(counts.sum(axis=0).tolist()), task.cutoff, tuple(scores))


def figures(residual: Array, torque: Array, counts: np.ndarray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Rms [N.m or N] and R2 per joint of a residual and a torque (M, n) [N.m or N] over the rows that count (M, n)."""
    rms, r2 = [], []
    for rest, measured, own in zip(residual.T, torque.T, counts.T, strict=True):
        square = float(np.mean(rest[own] ** 2)) if own.any() else np.nan
        power = float(np.var(measured[own])) if own.any() else np.nan
        rms.append(float(np.sqrt(square)))
        r2.append(1 - square / power if power > 0 else np.nan)
    return tuple(rms), tuple(r2)


def _answer(method: Method, task: Task) -> Answer | str:
    try:
        return method(task)
    except SignidError as error:
        return str(error)
    except Exception as error:  # one method must not end the others
        return f"{type(error).__name__}: {error} ({traceback.extract_tb(error.__traceback__)[-1].name})"


@dataclass(frozen=True)
class Total:
    """Figures of a method over all sets."""

    method: str
    ratio: float  # geometric mean over joints of rms relative to least squares [1]
    shared: float  # the same over the joints that all methods have in common
    better: int  # joints with a smaller rms than least squares
    joints: int
    sets: int
    seconds: float  # processor time


def ratios(one: SetResult, score: Score) -> list[float]:
    """Rms relative to least squares per joint; NaN without figures."""
    base = next((x.rms for x in one.scores if x.method == BASE), ())
    if not base or not score.rms:
        return [np.nan] * len(one.joints)
    return [x / y if y > 0 else np.nan for x, y in zip(score.rms, base, strict=True)]


def geometric(values: Iterable[float]) -> float:
    """Geometric mean of the positive finite values; NaN without any."""
    own = [x for x in values if np.isfinite(x) and x > 0]
    return float(np.exp(np.mean(np.log(own)))) if own else np.nan


def totals(sets: Sequence[SetResult]) -> list[Total]:
    """One total per method, in the order of the first set."""
    names = list(dict.fromkeys(x.method for one in sets for x in one.scores))
    each = {name: _all(sets, name) for name in names}
    ran = [x for x in each.values() if np.isfinite(x).any()]
    shared = np.isfinite(ran).all(axis=0) if ran else np.zeros(0, bool)
    found = []
    for name, values in each.items():
        own = [x for one in sets for x in one.scores if x.method == name]
        better, count = (int(np.sum(x)) for x in (values < 1, np.isfinite(values)))
        some = sum(bool(x.rms) for x in own)
        seconds = sum(x.seconds for x in own)
        found.append(Total(name, geometric(values), geometric(values[shared]), better, count, some, seconds))
    return found


def set_table(one: SetResult) -> Table:
    """Table of rms and R2 per joint for every method on a set."""
    names = ("method", *one.joints, "relative", "s", "")
    units = "/".join(dict.fromkeys(one.unit))
    least, most = min(one.rows), max(one.rows)
    rows = f"{most}" if least == most else f"{least} to {most}"
    table = frame(f"{one.name}: held-out rms [{units}] and (R2), {rows} rows per joint, {one.cutoff:.3g} Hz", names)
    table.columns[-1].justify, table.columns[-1].no_wrap = "left", False
    for score in one.scores:
        mean = geometric(ratios(one, score))
        cells = [f"{x:.3g} ({y:.3f})" for x, y in zip(score.rms, score.r2, strict=True)] or ["-"] * len(one.joints)
        relative = f"{mean:.3f}" if np.isfinite(mean) else "-"
        table.add_row(score.method, *cells, relative, f"{score.seconds:.1f}", score.note)
    return table


def _all(sets: Sequence[SetResult], name: str) -> np.ndarray:
    values = list[float]()
    for one in sets:
        score = next((x for x in one.scores if x.method == name), Score(name))
        values += ratios(one, score)
    return np.array(values)


def summary(found: Sequence[Total]) -> Table:
    """Table with one line per method."""
    names = ("method", "rms over least squares", "joints of all", "better joints", "joints", "sets", "s")
    table = frame("geometric mean over joints", names)
    for one in found:
        means = (f"{x:.3f}" if np.isfinite(x) else "-" for x in (one.ratio, one.shared))
        table.add_row(one.method, *means, str(one.better), str(one.joints), str(one.sets), f"{one.seconds:.1f}")
    return table


if __name__ == "__main__":
    raise SystemExit(main())
