"""Arms of six and seven joints with friction in MuJoCo at increasing noise, and deliberate failures of the search."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from unittest import mock

import numpy as np

import signid
from signid.regression.session import Options
from signid.signs.segments import threshold_runs
from signid.types import Robot

from ..plants.bodies import Body, Drives
from ..plants.control import Motion, Track, draw_motion
from ..plants.mujoco_ import simulate
from ..plants.record import log
from .row import Row
from .trial import Puzzle, attempt, planted
from .truth import Array, Truth

CENTRES: Mapping[str, tuple[float, ...]] = {  # centres of the motions [rad]
    "ur5": (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
    "ur10": (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
    "z1": (0.0, 1.2, -1.2, 0.0, 0.0, 0.0),
    "panda": (0.0, -0.3, 0.0, -1.8, 0.0, 1.8, 0.5),
    "xarm7": (0.0, -0.5, 0.0, 1.0, 0.0, 1.0, 0.0),
}
SEEDS = 3
DURATION, HELD_OUT, RATE, BITS = (
    20.0,
    8.0,
    100.0,
    17,
)  # durations [s] of training and held-out motion, rate [Hz], bits per turn
NOISES = (0.02, 0.05, 0.10, 0.20)  # torque noise over each joint's rms torque [1]
FRICTIONLESS = Options(effects=("torque_offset", "armature"))
COARSE, QUIET = 0.3, 0.02  # quantisation step and noise over each joint's rms torque [1]
SIGNED, MIXED = (0, 1), "joints 1, 2 signed"
LOW = 0.02  # quantile of |torque|, far too low as a threshold [1]
FAILURES = ("2 % threshold", "friction missing", "quantised by 30 %")


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot along a training motion and a held-out motion."""

    name: str
    seed: int
    robot: Robot
    drives: Drives
    tracks: tuple[Track, Track]

    def puzzle(
        self,
        group: str,
        noise: float,
        options: Options | None = None,
        step: float = 0.0,
        signed: tuple[int, ...] = (),
    ) -> Puzzle:
        """Puzzle of both motions as logged.

        Args:
            group: name of the group of rows.
            noise: torque noise over each joint's rms torque.
            options: options of the identification.
            step: quantisation step of torque over its rms value.
            signed: joints with signed torque.
        """
        sources = [logged(track, 10 * self.seed + k, noise, step) for k, track in enumerate(self.tracks)]
        truths = tuple(Truth(track.t, track.tau, track.tau) for track in self.tracks)
        value = planted(self.robot, self.drives)
        case = f"{self.name}, motion {self.seed + 1}"
        options = options or Options()
        pair = ((sources[0],), (sources[1],))
        return Puzzle(group, case, self.robot, *pair, options, value, truths, signed=signed)


def rows(seeds: int = SEEDS, workers: int = 2) -> Iterator[Row]:
    """Yield every robot along the motions at every noise, and the failures."""
    jobs = [(name, seed) for seed in range(seeds) for name in CENTRES]
    with ProcessPoolExecutor(workers) as pool:
        for done in pool.map(_all, *zip(*jobs, strict=True)):
            yield from done


def _all(name: str, seed: int) -> list[Row]:
    scene = draw(name, seed)
    done = [attempt(scene.puzzle(f"{100 * noise:g} % noise", noise)) for noise in NOISES]
    for noise in NOISES[1::2]:
        done.append(attempt(scene.puzzle(f"{100 * noise:g} % noise, {MIXED}", noise, signed=SIGNED)))
    low = partial(threshold_runs, quantile=LOW)
    with mock.patch("signid.signs.infer.threshold_runs", low):
        done.append(attempt(scene.puzzle(FAILURES[0], QUIET)))
    done.append(attempt(scene.puzzle(FAILURES[1], QUIET, FRICTIONLESS)))
    return [*done, attempt(scene.puzzle(FAILURES[2], QUIET, step=COARSE))]


def draw(name: str, seed: int) -> Scene:
    """Draw random drives for a robot and simulate two motions."""
    centre = CENTRES[name]
    robot = signid.load_robot(name, joints=[str(j + 1) for j in range(len(centre))])
    body, motions = Body(robot.document, robot.joints), [draw_motion(centre, 100 * k + seed) for k in (1, 2)]
    drives = draw_drives(body, motions[0], seed)
    train, held_out = (
        simulate(body, drives, motion, duration, RATE)
        for motion, duration in zip(motions, (DURATION, HELD_OUT), strict=True)
    )
    return Scene(name, seed, robot, drives, (train, held_out))


def draw_drives(body: Body, motion: Motion, seed: int) -> Drives:
    """Draw rotors and friction in proportion to the rigid-body torque along a motion."""
    rng = np.random.default_rng(seed)
    track = simulate(body, Drives.none(len(body.joints)), motion, 10.0, RATE)
    torque = np.sqrt(np.mean(track.tau**2, axis=0))
    _, v, a = (np.sqrt(np.mean(x**2, axis=0)) for x in motion.at(track.t))
    return Drives(
        armature=tuple(rng.uniform(0.02, 0.1, len(torque)) * torque / a),
        viscous_friction=tuple(rng.uniform(0.05, 0.2, len(torque)) * torque / v),
        coulomb_friction=tuple(rng.uniform(0.05, 0.2, len(torque)) * torque),
        torque_offset=tuple(rng.normal(0.0, 0.02, len(torque)) * torque),
    )


def logged(track: Track, seed: int, noise: float, step: float = 0.0) -> dict[str, Array]:
    """Columns of a recording; with a step, torque is quantised in steps of its rms value."""
    columns = log(track, seed, BITS, noise)
    for key in columns if step else ():
        if key.startswith("tau_"):
            size = step * np.sqrt(np.mean(columns[key] ** 2))
            columns[key] = np.round(columns[key] / size) * size
    return columns
