"""Agreement of intervals between recordings of one real robot: `python -m benchmarks.intervals_real [--json FILE]`.

Each recording of a robot in SIGNID_DATA is identified on its own. Two recordings differ in noise, motion, day and
temperature but not in the robot, so 95 % of the parameter differences should lie within 1.96 joint standard deviations.
`noise alone` is the same without discrepancy, delay and friction drift in the covariance.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

import signid
from signid.errors import SignidError
from signid.estimation.least_squares import estimate
from signid.identify import Identification
from signid.types import TWO_SIDED, Array, Robot

from .real.data import ur10e
from .summary import command_line, data, frame, one_thread, write_json

TARGET = 93.0  # lower bound on the share of differences within their intervals [%]
FRICTION = ("viscous_friction", "coulomb_friction")


@dataclass(frozen=True)
class Set:
    """Recordings of one robot."""

    name: str
    folder: str
    robot: Callable[[], Robot]
    recordings: tuple[str, ...]


def _urdf(folder: str, name: str) -> Callable[[], Robot]:
    return lambda: signid.load_robot(data() / folder / name)


_UR = tuple(
    f"identification_data__{name}"
    for name in (
        "20_01_31_unload",
        "20_02_10_30sec_12harm",
        "20_02_12_40sec_12harm",
        "20_02_12_50sec_12harm",
        "20_02_19_14harm50sec",
    )
)
SETS = (
    Set("UR10e", "ur10e_mamedov", ur10e, _UR),
    Set("PSM", "dvrk_wpi", _urdf("dvrk_wpi", "psm3.urdf"), ("psm3_one", "psm3_two", "psm3_one_no_weight")),
    Set("EMPS", "emps_janot", _urdf("emps_janot", "emps.urdf"), ("emps_train", "emps_pulses")),
    Set(
        "LWR4+",
        "kuka_lwr4_flobaroid",
        _urdf("kuka_lwr4_flobaroid", "kuka_lwr4.urdf"),
        ("measurements_1", "measurements_2", "measurements_3"),
    ),
    Set(
        "pendulum",
        "dfki_simple_pendulum",
        _urdf("dfki_simple_pendulum", "pendulum.urdf"),
        ("ddp", "direct_collocation", "pd__system_identification"),
    ),
)


@dataclass(frozen=True)
class Row:
    """Results of one robot; shares of differences within their intervals [%]."""

    robot: str
    recordings: int  # accepted
    refused: int
    pairs: int
    base: float  # least-squares estimate, all base parameters
    friction: float  # least-squares estimate, viscous and Coulomb friction only
    consistent: float  # physically consistent fit, all base parameters
    consistent_friction: float
    noise_base: float  # least-squares estimate, noise alone in the covariance
    noise_friction: float
    wider: float  # median ratio of the standard deviation to that of noise alone [1]
    seconds: float  # processor time per recording

    @property
    def holds(self) -> bool:
        """Whether every share reaches the target; true without a pair of usable recordings."""
        shares = (self.base, self.friction, self.consistent, self.consistent_friction)
        return self.pairs == 0 or min(shares) >= TARGET


def evaluate(group: Set) -> Row:
    """Compute the shares of one robot."""
    start = time.process_time()
    robot, found = group.robot(), list[Identification]()
    for name in group.recordings:
        try:
            recording = signid.read_recording(data() / group.folder / f"{name}.csv.gz", robot)
            found.append(signid.identify(robot, [recording]))
        except SignidError:
            continue
    seconds = (time.process_time() - start) / max(len(found), 1)
    full = [one.estimate.std for one in found]
    noise = [noise_alone(one) for one in found]
    values, consistent = [one.estimate.value for one in found], [one.base_value for one in found]
    pairs = [(i, k) for i, k in itertools.combinations(range(len(found)), 2) if _same(found[i], found[k])]
    friction = _friction(found[0]) if found else np.zeros(0, bool)
    rows = [(values, full), (consistent, full), (values, noise)]
    shares = [share(pairs, value, std, which) for value, std in rows for which in (friction | True, friction)]
    wider = [np.median((a / b)[np.isfinite(a)]) for a, b in zip(full, noise, strict=True)]
    return Row(
        group.name,
        len(found),
        len(group.recordings) - len(found),
        len(pairs),
        *shares,
        float(np.median(wider)) if wider else float("nan"),
        seconds,
    )


def share(pairs: Sequence[tuple[int, int]], values: Sequence[Array], stds: Sequence[Array], which: Array) -> float:
    """Share of differences within 1.96 joint standard deviations [%], without infinite standard deviations.

    Args:
        pairs: indices of the two recordings of each pair.
        values: estimates of each recording (b,) [units of base].
        stds: standard deviations of each recording (b,) [units of base].
        which: mask of parameters (b,).
    """
    z = [np.abs(values[i] - values[k])[which] / np.hypot(stds[i], stds[k])[which] for i, k in pairs]
    known = [np.isfinite(np.hypot(stds[i], stds[k]))[which] for i, k in pairs]
    if not z or not np.any(known):
        return float("nan")
    return float(100 * np.mean(np.concatenate(z)[np.concatenate(known)] <= TWO_SIDED))


def noise_alone(found: Identification) -> Array:
    """Standard deviations (b,) [units of base] due to noise alone."""
    factors = replace(found.session.reduce(found.session.train), sample=None)
    return estimate(factors, found.base).std


def _same(one: Identification, other: Identification) -> bool:
    return one.base.expressions == other.base.expressions


def _friction(found: Identification) -> Array:
    leads = [found.base.labels[int(k)].name for k in found.base.independent]
    return np.array([lead.startswith(FRICTION) for lead in leads])


def show(rows: Sequence[Row]) -> Table:
    """Format the rows as a table."""
    title = f"differences between recordings within 1.96 standard deviations, % (target {TARGET:g})"
    names = ("robot", "recordings", "refused", "base", "friction", "consistent", "friction", "noise alone", "friction")
    table = frame(title, (*names, "wider", "CPU s"))
    for row in rows:
        shares = (row.base, row.friction, row.consistent, row.consistent_friction, row.noise_base, row.noise_friction)
        cells = ["-" if np.isnan(x) else f"{x:.1f}" for x in shares]
        numbers = [f"{row.wider:.2f}", f"{row.seconds:.2f}"]
        counts = [str(row.recordings), str(row.refused)]
        table.add_row(row.robot, *counts, *cells, *numbers, style="" if row.holds else "red")
    return table


def main() -> int:
    """Evaluate every set and print the table; return 1 when a target is missed."""
    one_thread()
    parser = command_line("intervals_real", __doc__)
    options = parser.parse_args()
    data()
    rows = [evaluate(group) for group in SETS]
    Console(width=160).print(show(rows))
    write_json(options.json, rows)
    return 0 if all(row.holds for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
