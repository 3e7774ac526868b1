"""Recovery of torque signs on real robots: `python -m benchmarks.signs [--only real] [--json FILE]`.

The signs of signed recordings are removed and recovered, and compared with the true signs and with identification from
the signed recordings. The true sign of a segment is that of most of its torque's energy. Needs SIGNID_DATA.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.signal import butter, sosfiltfilt

import signid
from signid.identify import Identification
from signid.regression.rows import read_rows
from signid.regression.session import Options, Session, prepare
from signid.signs.result import Signs, Trace
from signid.types import Array, Estimate, Recording, Robot

from .real_data import LINK_SIDE, ROBOTS, ur10e
from .summary import command_line, data, frame, one_thread, origin, print_targets, write_json

ORDER, CORNER, FAST = 4, 8.0, 20.0  # low-pass for the truth of single samples: order, corner, that of fast logs [Hz]
REST, LASTING = 0.02, 0.2  # speed of a joint at rest [rad/s or m/s], averaging time [s]
LONG, TURNS = 0.5, 7  # a timed run is repeated up to this total time [s] and this number of turns
UR10E = ("20_02_12_40sec_12harm", "20_02_12_50sec_12harm", "20_01_31_unload", "20_02_10_30sec_12harm")
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Truth:
    """Signed torque of one recording: N samples of n joints."""

    t: Array  # (N,) [s]
    torque: Array  # (N, n) [N.m or N] the truth of segments
    smooth: Array  # (N, n) [N.m or N] the truth of single samples
    moving: Mask  # (N,) evaluated samples


class Score(NamedTuple):
    """Evaluation of recovered signs."""

    segments: int
    right: int  # segments with the sign of most of their torque's energy
    mixed: int  # segments with both signs
    samples: float  # share of right samples while the robot moves
    small: float  # the same for samples below the threshold; nan without any


def measured(t: Array, q: Array, torque: Array, corner: float = CORNER) -> Truth:
    """Truth of a noisy signed recording; low-passed torque gives the signs of single samples.

    Samples with the whole robot at rest are excluded, because static friction holds any torque.

    Args:
        t: times (N,) [s].
        q: positions (N, n) [rad or m].
        torque: signed torque (N, n) [N.m or N].
        corner: corner of the forward-backward filter [Hz].
    """
    rate = 1 / float(np.median(np.diff(t)))
    smooth = sosfiltfilt(butter(ORDER, corner, fs=rate, output="sos"), torque, axis=0)
    half, at = max(1, round(LASTING / 2 * rate)), np.arange(len(t))
    later, before = np.minimum(at + half, len(t) - 1), np.maximum(at - half, 0)
    speed = np.abs(q[later] - q[before]).max(1) / (t[later] - t[before])
    return Truth(t, torque, np.asarray(smooth), speed > REST)


def evaluate(signs: Signs, truths: Sequence[Truth]) -> Score:
    """Compare the signs of segments and samples with the true ones."""
    small, right = [], []
    for trace, truth in zip(signs.traces, truths, strict=True):
        for joint in signs.hidden:
            moving = np.asarray(truth.moving[np.searchsorted(truth.t, trace.t).clip(0, len(truth.t) - 1)])
            same = _same(trace, truth, joint)[moving]
            right.append(same)
            small.append(same[trace.magnitude[moving, joint] < signs.threshold[joint]])
    below = np.concatenate(small)
    found = [(s.sign, *majority(truths[s.part], s.joint, s.start, s.end)) for s in signs.segments]
    return Score(
        segments=len(found),
        right=sum(sign == true for sign, true, _ in found),
        mixed=sum(mixed for *_, mixed in found),
        samples=float(np.concatenate(right).mean()),
        small=float(below.mean()) if len(below) else float("nan"),
    )


def _same(trace: Trace, truth: Truth, joint: int) -> Mask:
    """Mask of samples with their true sign (N,); zero true torque matches both signs."""
    true = np.interp(trace.t, truth.t, truth.smooth[:, joint])
    return np.asarray(trace.signs[:, joint] * true >= 0)


def majority(truth: Truth, joint: int, start: float, end: float) -> tuple[int, bool]:
    """Sign with most of the torque's energy between two times [s], and whether both signs occur."""
    at = (truth.t >= start) & (truth.t <= end)
    torque, smooth = truth.torque[at, joint], truth.smooth[at, joint]
    sign = 1 if np.sum(torque * np.abs(torque)) >= 0 else -1
    return sign, bool(np.any(smooth * sign < 0))


@dataclass(frozen=True)
class Target:
    """Targets of a row; None: no target."""

    segments: float | None = None  # least share with the true sign
    samples: float | None = None  # least share with the true sign
    off: float | None = None  # at most
    seconds: float | None = None  # at most


@dataclass(frozen=True)
class Row:
    """Signs and parameters recovered from an unsigned recording."""

    robot: str
    case: str
    segments: int
    right: int
    mixed: int
    samples: float  # share of samples with their true sign
    small: float  # the same for samples below the threshold
    parameters: int
    off: float  # torque distance from the signed estimate over that estimate's size [1]
    held_out: tuple[float, ...]  # rms residual on held-out signed torque (n,) [N.m or N]
    held_out_signed: tuple[float, ...]  # the same for the signed estimate (n,) [N.m or N]
    seconds: float  # processor time beyond that of the signed identification
    optimal: bool
    gap: float
    flags: tuple[str, ...]
    target: Target = Target()

    @property
    def worse(self) -> float:
        """Largest ratio over joints of held-out errors without signs to those with signs."""
        pairs = zip(self.held_out, self.held_out_signed, strict=True)
        return max((own / max(signed, 1e-300) for own, signed in pairs), default=float("nan"))

    @property
    def misses(self) -> tuple[str, ...]:
        """Missed parts of the target."""
        want, share = self.target, self.right / max(self.segments, 1)
        least = {"segments": (share, want.segments), "samples": (self.samples, want.samples)}
        most = {"off": (self.off, want.off), "seconds": (self.seconds, want.seconds)}
        below = [f"{k} {x:.5g} < {w:g}" for k, (x, w) in least.items() if w is not None and not x >= w]
        return (*below, *(f"{k} {x:.3g} > {w:g}" for k, (x, w) in most.items() if w is not None and not x <= w))


class Signed(NamedTuple):
    """Identification from the signed recordings."""

    session: Session
    estimate: Estimate
    seconds: float

    def size(self, value: Array) -> float:
        """Torque of parameters (b,) [units of base] along the recordings, in standard deviations of the noise."""
        return float(np.sqrt(max(value @ self.estimate.information @ value, 0.0)))

    def held_out_rms(self, value: Array) -> tuple[float, ...]:
        """Rms residual (n,) [N.m or N] on held-out signed torque for parameters (b,) [units of base]."""
        task, parts = self.session.task, self.session.held_out
        seen = [task.seen(j) for j in range(len(task.robot.joints))]
        rests = [
            rows.torque - np.column_stack([own @ value[k] for own, k in zip(rows.columns, seen, strict=True)])
            for part in parts
            for rows in read_rows(task, *part)
        ]
        return tuple(np.sqrt(np.mean(np.concatenate(rests) ** 2, axis=0)).tolist())


@dataclass(frozen=True)
class Puzzle:
    """A signed recording whose signs are removed, and a held-out one; without it, the end of the first is held out."""

    robot_name: str
    case: str
    robot: Robot
    train: Path
    held_out: tuple[Path, ...] = ()
    options: Options = field(default_factory=Options)
    corner: float = CORNER  # of the low-pass for the truth of single samples [Hz]

    def read(self, unsigned: bool) -> tuple[list[Recording], list[Recording]]:
        """Training and held-out recordings."""
        files = ((self.train,), self.held_out)
        train, held_out = ([signid.read_recording(x, self.robot, unsigned=unsigned) for x in some] for some in files)
        return train, held_out

    def truths(self) -> list[Truth]:
        """Truth of every recording."""
        rows = [recording.read() for some in self.read(unsigned=False) for recording in some]
        return [measured(x.t, x.q, x.tau, self.corner) for x in rows]


def attempt(puzzle: Puzzle, target: Target) -> Row:
    """Recover the signs, and compare with the truth and with the signed identification."""
    train, held_out = puzzle.read(unsigned=False)
    with_signs, seconds = identify(puzzle, train, held_out)
    signed = Signed(prepare(puzzle.robot, train, held_out, puzzle.options), with_signs.estimate, seconds)
    found, seconds = identify(puzzle, *puzzle.read(unsigned=True))
    signs, value = found.signs, found.estimate.value
    assert signs is not None, "torque was read without signs"
    score = evaluate(signs, puzzle.truths())
    return Row(
        puzzle.robot_name,
        puzzle.case,
        *score,
        parameters=found.base.rank,
        off=signed.size(value - signed.estimate.value) / signed.size(signed.estimate.value),
        held_out=signed.held_out_rms(value),
        held_out_signed=signed.held_out_rms(signed.estimate.value),
        seconds=seconds - signed.seconds,
        optimal=signs.proof.optimal,
        gap=signs.proof.gap,
        flags=signs.flags,
        target=target,
    )


def identify(puzzle: Puzzle, train: list[Recording], held_out: list[Recording]) -> tuple[Identification, float]:
    """Identify by least squares; return the time [s], for short runs the shortest of several."""
    times: list[float] = []
    while not times or (sum(times) < LONG and len(times) < TURNS):
        start = time.process_time()
        found = signid.identify(puzzle.robot, train, held_out=held_out, options=puzzle.options, method="wls")
        times.append(time.process_time() - start)
    return found, min(times)


def rows() -> Iterator[Row]:
    """Panda (link-side torque sensors), UR10e (motor currents; another log is held out), TX40 and EMPS (fast logs)."""
    panda, ur = data() / "panda_gaz2019", data() / "ur10e_mamedov"
    options = Options(effects=LINK_SIDE)
    puzzle = Puzzle(
        "Panda", "21 s", signid.load_robot(panda / "panda.urdf"), panda / "exciting_traj_1.csv.gz", (), options
    )
    yield attempt(puzzle, Target(segments=1.0, samples=0.989, off=0.01, seconds=2.0))
    for name in UR10E:
        other = UR10E[1] if name != UR10E[1] else UR10E[0]
        train, held_out = (ur / f"identification_data__{key}.csv.gz" for key in (name, other))
        target = Target() if name == UR10E[-1] else Target(segments=0.985)
        yield attempt(Puzzle("UR10e", name, ur10e(), train, (held_out,)), target)
    tx40, emps = data() / "staubli_tx40", data() / "emps_janot"
    for robot, urdf, file in (
        ("TX40", tx40 / "tx40.urdf", tx40 / "exciting_traj.csv.gz"),
        ("EMPS", ROBOTS / "emps" / "robot.urdf", emps / "emps_train.csv.gz"),
    ):
        case = file.name.partition(".")[0]
        yield attempt(Puzzle(robot, case, signid.load_robot(urdf), file, corner=FAST), Target())


def show(found: Sequence[Row]) -> Table:
    """Table with one line per recording; those that miss their target are red."""
    names = ("segments", "mixed", "samples", "small ones", "b", "off signed", "held out", "s", "proof", "flags")
    table = frame("real robots, signs removed", ("robot", "case", *names), left=2)
    for row in found:
        shares = [f"{100 * x:.2f} %" for x in (row.samples, row.small)]
        numbers = [f"{row.off:.2g}", f"{row.worse:.3f}", f"{row.seconds:.2f}"]
        proof = "optimal" if row.optimal else f"gap {row.gap:.2g}"
        cells = [f"{row.right}/{row.segments}", str(row.mixed), *shares, str(row.parameters), *numbers, proof]
        table.add_row(row.robot, row.case, *cells, str(len(row.flags) or ""), style="red" if row.misses else "")
    return table


def main() -> int:
    """Run, print and write the numbers; return 1 if a target is missed."""
    one_thread()
    parser = command_line("signs", __doc__)
    parser.add_argument("--only", choices=("real",), default="real", help="the cases to run: recordings of real robots")
    options, console = parser.parse_args(), Console(width=160)
    data()
    found = list(rows())
    console.print(show(found))
    write_json(options.json, {"origin": origin("signs", sys.argv[1:]), "rows": found})
    targets = [(f"{row.robot} {row.case}: {', '.join(row.misses) or 'met'}", not row.misses) for row in found]
    return 0 if print_targets(console, targets) else 1


if __name__ == "__main__":
    raise SystemExit(main())
