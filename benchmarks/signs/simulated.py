"""Arms of six and seven joints with friction in MuJoCo, at growing noise; and what breaks the search, on purpose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from unittest import mock

import numpy as np

import signid
from signid.regression.session import Options
from signid.signs.rows.segments import threshold_runs
from signid.types import Robot

from ..plants.bodies import Body, Drives
from ..plants.control import Motion, Track, draw_motion
from ..plants.mujoco_ import simulate
from ..plants.record import log
from .row import Row
from .trial import Puzzle, attempt, planted
from .truth import Array, Truth

CENTRES: Mapping[str, tuple[float, ...]] = {  # rad
    "ur5": (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
    "ur10": (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
    "z1": (0.0, 1.2, -1.2, 0.0, 0.0, 0.0),
    "panda": (0.0, -0.3, 0.0, -1.8, 0.0, 1.8, 0.5),
    "xarm7": (0.0, -0.5, 0.0, 1.0, 0.0, 1.0, 0.0),
}
SEEDS = 3
DURATION, UNSEEN, RATE, BITS = 20.0, 8.0, 100.0, 17  # s, s of the motion that judges, Hz, bits a turn
NOISES = (0.02, 0.05, 0.10, 0.20)  # of each joint's rms torque
FRICTIONLESS = Options(effects=("torque_offset", "armature"))
COARSE, QUIET = 0.3, 0.02  # step of quantisation, and noise beside it, as shares of each joint's rms torque
SIGNED, MIXED = (0, 1), "joints 1, 2 signed"
LOW = 0.02  # quantile of |torque| that is far too low a threshold
FAILURES = ("2 % threshold", "friction missing", "quantised by 30 %")


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot along two motions: the first to learn from, the second to judge by."""

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
        """Both motions as logged.

        Args:
            group: what the row is told under.
            noise: of torque, as a share of each joint's rms value.
            options: of the identification.
            step: of quantised torque, the same share.
            signed: joints whose torque keeps its sign.
        """
        sources = [logged(track, 10 * self.seed + k, noise, step) for k, track in enumerate(self.tracks)]
        truths = tuple(Truth(track.t, track.tau, track.tau) for track in self.tracks)
        value = planted(self.robot, self.drives)
        case = f"{self.name}, motion {self.seed + 1}"
        options = options or Options()
        pair = ((sources[0],), (sources[1],))
        return Puzzle(group, case, self.robot, *pair, options, value, truths, signed=signed)


def rows(seeds: int = SEEDS, workers: int = 2) -> Iterator[Row]:
    """Every robot along some motions, at every noise, then the failures."""
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
    """A robot with drives drawn at random, along two motions."""
    centre = CENTRES[name]
    robot = signid.load_robot(name, joints=[str(j + 1) for j in range(len(centre))])
    body, motions = Body(robot.document, robot.joints), [draw_motion(centre, 100 * k + seed) for k in (1, 2)]
    drives = draw_drives(body, motions[0], seed)
    learn, judge = (
        simulate(body, drives, motion, duration, RATE)
        for motion, duration in zip(motions, (DURATION, UNSEEN), strict=True)
    )
    return Scene(name, seed, robot, drives, (learn, judge))


def draw_drives(body: Body, motion: Motion, seed: int) -> Drives:
    """Rotors and friction in proportion to the torque that the bodies take along a motion."""
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
    """A recording's columns; with a step, torque in whole steps of that share of its rms value."""
    columns = log(track, seed, BITS, noise)
    for key in columns if step else ():
        if key.startswith("tau_"):
            size = step * np.sqrt(np.mean(columns[key] ** 2))
            columns[key] = np.round(columns[key] / size) * size
    return columns
