"""Bias of estimators under encoder noise: `python -m benchmarks.estimators [--quick] [--json FILE]`.

MuJoCo simulates the robots. Positions are logged at increasing noise levels and identified by every estimator.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import mujoco
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from signid.errors import SignidError
from signid.identify import Identification, identify
from signid.recording import read_recording
from signid.regression.session import Options
from signid.types import TWO_SIDED, Array, Recording, Robot

from .arms import ARMS, Arm, load, truth
from .plants.mujoco_ import Body, Motion, Track, draw_motion, log, simulate
from .summary import command_line, write_json

DURATION, TORQUE = 20.0, 0.02  # duration [s], white torque noise over rms torque [1]
MOTIONS, QUICK = 6, 2  # recordings per row
FIRM, LOOSE = 8.0, 2.0  # bandwidth of a stiff and of a soft position loop [Hz]
FINE = 24  # bits per turn of an encoder with negligible quantisation
WIDE = MappingProxyType({"3r": 8.0, "ur10": 5.0})  # cut-off above the default [Hz], passes more encoder noise
# encoder bits per turn, standard deviation of white position noise [rad]
NOISES: Mapping[str, tuple[int, float]] = MappingProxyType(
    {
        "17 bits": (17, 0.0),
        "14 bits": (14, 0.0),
        "12 bits": (12, 0.0),
        "1e-4 rad": (FINE, 1e-4),
        "1e-3 rad": (FINE, 1e-3),
    }
)
LOOSELY = ("12 bits", "1e-3 rad")  # noises that are also run with the soft loop
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
    """Results of one estimator under one noise at one cut-off, over all recordings."""

    robot: str
    loop: float  # bandwidth of the controller [Hz]
    noise: str
    cutoff: float  # median [Hz]
    chosen: bool  # cut-off chosen by signid, not set
    estimator: str
    recordings: int
    refused: int
    flagged: int
    error: float  # torque error caused by the parameter errors over torque, rms over motions [%]
    bias: float  # the same for the mean parameter error over the recordings [%]
    coverage: float  # 95 % intervals that contain the true value [%]
    wider: float  # median interval width over that of wls [1]
    slower: float  # time over that of wls [1]


def columns(track: Track, motion: Motion, seed: int, noise: tuple[int, float]) -> dict[str, Array]:
    """Logged columns with noise, desired positions included."""
    bits, size = noise
    logged = log(track, seed, bits, TORQUE)
    rng = np.random.default_rng([seed, 2])
    desired = motion.at(track.t)[0]
    for j in range(desired.shape[1]):
        logged[f"q_{j + 1}"] = logged[f"q_{j + 1}"] + size * rng.standard_normal(len(desired))
        logged[f"q_des_{j + 1}"] = desired[:, j]
    return logged


def recordings(arm: Arm, robot: Robot, noise: tuple[int, float], count: int, loop: float = FIRM) -> Iterator[Recording]:
    """Yield one recording per motion."""
    body = Body(robot.document, robot.joints)
    for k in range(count):
        motion = draw_motion(arm.centre, k)
        track = simulate(body, arm.drives, motion, DURATION, arm.rate, bandwidth=2 * np.pi * loop)
        yield read_recording(columns(track, motion, 100 + k, noise), robot)


def run(
    robot: Robot, recording: Recording, held_out: Recording, name: str, cutoff: float | None
) -> tuple[Identification, float]:
    """Identify with one estimator; also return its time [s]."""
    estimator, robust = ESTIMATORS[name]
    options = Options(cutoff=cutoff, robust=robust)
    start = time.perf_counter()
    found = identify(robot, [recording], held_out=[held_out], method="wls", estimator=estimator, options=options)
    return found, time.perf_counter() - start


def evaluate(arm: Arm, robot: Robot, noise: str, cutoff: float | None, count: int, loop: float = FIRM) -> Iterator[Row]:
    """Evaluate all estimators under one noise at one cut-off."""
    logs = list(recordings(arm, robot, NOISES[noise], count, loop))
    noise_free = next(recordings(arm, robot, (FINE, 0.0), 1))
    width, pace = np.zeros(0), np.zeros(0)
    for name in ESTIMATORS:
        done: list[tuple[Identification, float]] = []
        for recording in logs:
            try:
                done.append(run(robot, recording, noise_free, name, cutoff))
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
    """Gram matrix (b, b) of the noise-free held-out columns, joint torques scaled to unit rms; number of joints."""
    factors = found.session.reduce(found.session.held_out, lags=0)
    weight, joints = np.zeros((found.base.rank,) * 2), 0
    for joint, seen in zip(factors.joints, factors.columns, strict=True):
        m = len(seen)
        gram = joint.grams[0][-m - 1 :, -m - 1 :]
        weight[np.ix_(seen, seen)] += gram[:-1, :-1] / gram[-1, -1]
        joints += 1
    return weight, float(joints)


def show(rows: list[Row]) -> Table:
    """Format the rows as a table."""
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
    """Run the selected rows, print the table and write the numbers."""
    parser = command_line("estimators", __doc__)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} recordings per row instead of {MOTIONS}")
    parser.add_argument("--robot", choices=list(WIDE), help="run only this robot")
    parser.add_argument("--noise", choices=list(NOISES), help="run only this noise")
    options = parser.parse_args()
    rows: list[Row] = []
    for arm in (arm for arm in ARMS if arm.robot in WIDE and options.robot in (None, arm.robot)):
        robot, count = load(arm), QUICK if options.quick else MOTIONS
        for noise in (noise for noise in NOISES if options.noise in (None, noise)):
            for cutoff in (None, WIDE[arm.robot]):
                rows += evaluate(arm, robot, noise, cutoff, count)
        for noise in (noise for noise in LOOSELY if options.noise in (None, noise)):
            rows += evaluate(arm, robot, noise, WIDE[arm.robot], count, LOOSE)
    Console(width=110).print(show(rows))
    machine = {"python": platform.python_version(), "mujoco": mujoco.__version__, "processor": platform.machine()}
    write_json(options.json, {"machine": machine, "rows": rows})


if __name__ == "__main__":
    main()
