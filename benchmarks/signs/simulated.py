"""Arms in MuJoCo at increasing noise, deliberate failures of the search, and unknown torque constants."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from unittest import mock

import numpy as np
import pinocchio as pin

import signid
from signid.errors import SignidError
from signid.regression.session import Options
from signid.signs.segments import threshold_runs
from signid.types import Robot

from ..plants.bodies import Body, Drives
from ..plants.control import Motion, Track, draw_motion, log
from ..plants.mujoco_ import simulate
from .trial import Array, Puzzle, Row, SegmentScore, Truth, attempt, evaluate, planted

CENTRES: Mapping[str, tuple[float, ...]] = {  # centres of the motions [rad]
    "ur5": (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
    "ur10": (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
    "z1": (0.0, 1.2, -1.2, 0.0, 0.0, 0.0),
    "panda": (0.0, -0.3, 0.0, -1.8, 0.0, 1.8, 0.5),
    "xarm7": (0.0, -0.5, 0.0, 1.0, 0.0, 1.0, 0.0),
}
SEEDS = 3
# durations [s] of training and held-out motion, rate [Hz], bits per turn
DURATION, HELD_OUT, RATE, BITS = 20.0, 8.0, 100.0, 17
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
        self, group: str, noise: float, options: Options | None = None, step: float = 0.0, signed: tuple[int, ...] = ()
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


# torque noise over rms torque [1]; log-std of the inertials' errors in a wrong description [1]
NOISE, WRONG = 0.02, 0.2
RANGE = (0.5, 50.0)  # range of the torque constants [N.m/A]
ANCHOR = 1  # joint with a known constant in the first kind
KINDS = ("joint 2's known", "none known", "none known, URDF off by 20 %")


@dataclass(frozen=True)
class Found:
    """Results of one arm."""

    kind: str
    arm: str
    errors: tuple[float, ...]  # relative errors of the unknown constants [1]; empty after a refusal
    stds: tuple[float, ...]  # relative standard deviations [1]
    judged: tuple[SegmentScore, ...]
    flags: tuple[str, ...]
    seconds: float
    refused: str = ""

    @property
    def right(self) -> int:
        """Number of segments with their true sign."""
        return sum(one.right for one in self.judged)


def found(motion: int = 0, workers: int = 2) -> Iterator[Found]:
    """Yield the results of each kind on each arm."""
    with ProcessPoolExecutor(workers) as pool:
        for some in pool.map(_arm, CENTRES, [motion] * len(CENTRES)):
            yield from some


def _arm(name: str, motion: int) -> list[Found]:
    scene, rng = draw(name, motion), np.random.default_rng([motion, 5])
    n = len(scene.robot.joints)
    constants = np.exp(rng.uniform(*np.log(RANGE), n))
    off = np.exp(WRONG * rng.standard_normal(n))
    anchor = np.arange(n) == ANCHOR
    kinds = zip(KINDS, (anchor, ~anchor & anchor, ~anchor & anchor), (np.ones(n), np.ones(n), off), strict=True)
    return [find(kind, scene, constants, known, factors) for kind, known, factors in kinds]


def find(kind: str, scene: Scene, constants: Array, known: Array, factors: Array) -> Found:
    """Identify the constants of one arm.

    True constants (n,) [N.m/A], mask of known ones (n,), inertials of the description over the true ones (n,) [1].
    """
    stated = np.where(known, constants, np.nan)
    actuators = replace(scene.robot.actuators, torque_constant=stated)
    robot = replace(heavier(scene.robot, factors), actuators=actuators)
    train = signid.read_recording(currents(logged(scene.tracks[0], 10 * scene.seed, NOISE), constants), robot)
    start = time.process_time()
    try:
        signs = signid.identify(robot, [train], method="wls").signs
    except SignidError as error:
        return Found(kind, scene.name, (), (), (), (), time.process_time() - start, str(error))
    seconds = time.process_time() - start
    assert signs is not None, "currents were recorded without signs"
    place = {joint: j for j, joint in enumerate(signs.joints)}
    errors = tuple(abs(gain.value / constants[place[gain.joint]] - 1) for gain in signs.gains)
    stds = tuple(gain.std / gain.value for gain in signs.gains)
    track = scene.tracks[0]
    score = evaluate(signs, [Truth(track.t, track.tau, track.tau)])
    return Found(kind, scene.name, errors, stds, score.judged, signs.flags, seconds)


def currents(columns: dict[str, Array], constants: Array) -> dict[str, Array]:
    """Replace torques by absolute currents, for constants (n,) [N.m/A]."""
    kept = {key: x for key, x in columns.items() if not key.startswith("tau_")}
    return kept | {f"abs_current_{j}": np.abs(columns[f"tau_{j}"]) / k for j, k in enumerate(constants, 1)}


def heavier(robot: Robot, factors: Array) -> Robot:
    """Scale the inertials of each moving link by factors (n,) [1]."""
    model = robot.model.copy()
    for k, factor in enumerate(factors.tolist(), 1):
        model.inertias[k] = pin.Inertia.FromDynamicParameters(factor * model.inertias[k].toDynamicParameters())
    return replace(robot, model=model)


@dataclass(frozen=True)
class Kind:
    """Statistics over all arms of one kind."""

    name: str
    arms: int
    refused: int
    constants: int
    median: float  # of the relative errors [1]
    largest: float  # relative error [1]
    said: float  # median of the relative standard deviations [1]
    inside: int  # errors within two standard deviations
    segments: int
    right: int
    seconds: float  # median
    flagged: int  # arms with a flag


def summarise(done: Sequence[Found]) -> Iterator[Kind]:
    """Yield the statistics of each kind."""
    for name in dict.fromkeys(one.kind for one in done):
        own = [one for one in done if one.kind == name]
        errors, stds = (np.array([x for one in own for x in getattr(one, key)]) for key in ("errors", "stds"))
        yield Kind(
            name=name,
            arms=len(own),
            refused=sum(bool(one.refused) for one in own),
            constants=len(errors),
            median=float(np.median(errors)) if len(errors) else float("nan"),
            largest=float(errors.max(initial=0.0)),
            said=float(np.median(stds)) if len(stds) else float("nan"),
            inside=int(np.sum(errors <= 2 * stds)),
            segments=sum(len(one.judged) for one in own),
            right=sum(one.right for one in own),
            seconds=float(np.median([one.seconds for one in own])),
            flagged=sum(bool(one.flags) for one in own),
        )
