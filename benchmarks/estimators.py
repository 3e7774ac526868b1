"""Which estimator is biased by noise of the encoders? `python -m benchmarks.estimators [--quick] [--json FILE]`.

Robots are simulated by MuJoCo; their positions are logged with more and more noise, and identified by every estimator.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from signid.errors import SignidError
from signid.identify import Identification, identify
from signid.recording import read_recording
from signid.regression.session import Options
from signid.types import TWO_SIDED, Recording, Robot

from .arms import ARMS, Arm, load, truth
from .plants.mujoco_ import Body, Motion, Track, draw_motion, log, simulate

Array = NDArray[np.float64]

DURATION, TORQUE = 20.0, 0.02  # s, share of rms torque that is white noise
MOTIONS, QUICK = 6, 2  # recordings a row
FIRM, LOOSE = 8.0, 2.0  # Hz, position loops that follow closely and loosely
FINE = 24  # bits a turn of an encoder whose noise is white
WIDE = MappingProxyType({"3r": 8.0, "ur10": 5.0})  # Hz, at which noise that the default cut-off would not let through
# bits a turn, standard deviation of white noise [rad]
NOISES: Mapping[str, tuple[int, float]] = MappingProxyType(
    {
        "17 bits": (17, 0.0),
        "14 bits": (14, 0.0),
        "12 bits": (12, 0.0),
        "1e-4 rad": (FINE, 1e-4),
        "1e-3 rad": (FINE, 1e-3),
    }
)
LOOSELY = ("12 bits", "1e-3 rad")  # under which the loose loop is tried, too
ESTIMATORS: Mapping[str, tuple[str | None, bool]] = MappingProxyType(
    {
        "wls": ("wls", False),
        "wls --robust": ("wls", True),
        "default, q_des": (None, False),
        "iv": ("iv", False),
        "tls": ("tls", False),
        "oe": ("oe", False),
    }
)


@dataclass(frozen=True)
class Row:
    """One estimator under one noise at one cut-off, over the recordings."""

    robot: str
    loop: float  # Hz, of the controller
    noise: str
    cutoff: float  # Hz, median
    chosen: bool  # by signid, not by us
    estimator: str
    recordings: int
    refused: int
    flagged: int
    error: float  # % of torque: rms over motions of what the parameters' error does to torque, over the torque
    bias: float  # % the same of the mean error over the recordings
    coverage: float  # % of 95 % intervals that hold the truth
    wider: float  # median interval over that of wls
    slower: float  # time over that of wls


def columns(track: Track, motion: Motion, seed: int, noise: tuple[int, float]) -> dict[str, Array]:
    """What is logged, with desired positions."""
    bits, size = noise
    made = log(track, seed, bits, TORQUE)
    rng = np.random.default_rng([seed, 2])
    desired = motion.at(track.t)[0]
    for j in range(desired.shape[1]):
        made[f"q_{j + 1}"] = made[f"q_{j + 1}"] + size * rng.standard_normal(len(desired))
        made[f"q_des_{j + 1}"] = desired[:, j]
    return made


def recordings(arm: Arm, robot: Robot, noise: tuple[int, float], count: int, loop: float = FIRM) -> Iterator[Recording]:
    """Motions, each logged once."""
    body = Body(robot.document, robot.joints)
    for k in range(count):
        motion = draw_motion(arm.centre, k)
        track = simulate(body, arm.drives, motion, DURATION, arm.rate, bandwidth=2 * np.pi * loop)
        yield read_recording(columns(track, motion, 100 + k, noise), robot)


def run(
    robot: Robot, recording: Recording, judge: Recording, name: str, cutoff: float | None
) -> tuple[Identification, float]:
    """Identification by one estimator, and its time [s]."""
    estimator, robust = ESTIMATORS[name]
    options = Options(cutoff=cutoff, robust=robust)
    start = time.perf_counter()
    found = identify(robot, [recording], held_out=[judge], method="wls", estimator=estimator, options=options)
    return found, time.perf_counter() - start


def judge(arm: Arm, robot: Robot, noise: str, cutoff: float | None, count: int, loop: float = FIRM) -> Iterator[Row]:
    """All estimators under one noise at one cut-off."""
    logs = list(recordings(arm, robot, NOISES[noise], count, loop))
    token = next(recordings(arm, robot, (FINE, 0.0), 1))
    width, pace = np.zeros(0), np.zeros(0)
    for name in ESTIMATORS:
        done: list[tuple[Identification, float]] = []
        for recording in logs:
            try:
                done.append(run(robot, recording, token, name, cutoff))
            except SignidError as error:
                print(f"{arm.robot} {noise} {name}: {error}")
        if not done:
            continue
        error = np.array([found.estimate.value - truth(arm, found.session) for found, _ in done])
        std = np.array([found.estimate.std for found, _ in done])
        weight, power = _weight(done[0][0])
        seconds = np.array([second for _, second in done])
        if not len(width):
            width, pace = np.median(std, axis=0), seconds
        mean = error.mean(0)
        yield Row(
            robot=arm.robot,
            loop=loop,
            noise=noise,
            cutoff=float(np.median([found.cutoff for found, _ in done])),
            chosen=cutoff is None,
            estimator=name,
            recordings=len(done),
            refused=len(logs) - len(done),
            flagged=sum(bool(found.estimate.flags) for found, _ in done),
            error=100 * float(np.sqrt(np.mean(np.einsum("ri,ij,rj->r", error, weight, error)) / power)),
            bias=100 * float(np.sqrt(mean @ weight @ mean / power)),
            coverage=float(100 * np.mean(np.abs(error) <= TWO_SIDED * std)),
            wider=float(np.median(np.median(std, axis=0) / width)),
            slower=float(seconds.sum() / pace.sum()),
        )


def _weight(found: Identification) -> tuple[Array, float]:
    """Gram matrix (b, b) of the columns along the noise-free held-out motion, each joint's torque to its rms, and n."""
    factors = found.session.reduce(found.session.held_out, lags=0)
    weight, joints = np.zeros((found.base.rank,) * 2), 0
    for joint, seen in zip(factors.joints, factors.columns, strict=True):
        m = len(seen)
        gram = joint.grams[0][-m - 1 :, -m - 1 :]
        weight[np.ix_(seen, seen)] += gram[:-1, :-1] / gram[-1, -1]
        joints += 1
    return weight, float(joints)


def show(rows: list[Row]) -> Table:
    """The rows as a table to read."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in (
        "robot",
        "loop",
        "noise",
        "Hz",
        "estimator",
        "error, %",
        "bias, %",
        "95 %",
        "width",
        "time",
        "flagged",
    ):
        table.add_column(name, justify="left" if name in ("robot", "noise", "estimator") else "right", no_wrap=True)
    for row in rows:
        shares = [f"{row.error:.2f}", f"{row.bias:.2f}", f"{row.coverage:.0f}", f"{row.wider:.1f}", f"{row.slower:.1f}"]
        hertz = f"{row.cutoff:.1f}{'' if row.chosen else ' (set)'}"
        table.add_row(
            row.robot, f"{row.loop:g} Hz", row.noise, hertz, row.estimator, *shares, f"{row.flagged}/{row.recordings}"
        )
    return table


def main() -> None:
    """Run every row asked for, print the table, write the numbers."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.estimators", description=__doc__)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} recordings a row instead of {MOTIONS}")
    parser.add_argument("--robot", choices=list(WIDE), help="one robot alone")
    parser.add_argument("--noise", choices=list(NOISES), help="one noise alone")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    options = parser.parse_args()
    rows: list[Row] = []
    for arm in (arm for arm in ARMS if arm.robot in WIDE and options.robot in (None, arm.robot)):
        robot, count = load(arm), QUICK if options.quick else MOTIONS
        for noise in (noise for noise in NOISES if options.noise in (None, noise)):
            for cutoff in (None, WIDE[arm.robot]):
                rows += judge(arm, robot, noise, cutoff, count)
        for noise in (noise for noise in LOOSELY if options.noise in (None, noise)):
            rows += judge(arm, robot, noise, WIDE[arm.robot], count, LOOSE)
    Console(width=110).print(show(rows))
    if options.json:
        machine = {"python": platform.python_version(), "mujoco": mujoco.__version__, "processor": platform.machine()}
        options.json.write_text(
            json.dumps({"machine": machine, "rows": [asdict(row) for row in rows]}, indent=1), encoding="utf-8"
        )


if __name__ == "__main__":
    main()
