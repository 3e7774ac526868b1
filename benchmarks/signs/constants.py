"""Unknown torque constants from unsigned currents on simulated arms."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

import signid
from signid.errors import SignidError
from signid.types import Robot

from .simulated import CENTRES, Scene, draw, logged
from .truth import Array, SegmentScore, Truth, evaluate

NOISE, WRONG = (
    0.02,
    0.2,
)  # torque noise over rms torque [1]; log-std of the inertials' errors in a wrong description [1]
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
    """Yield the results of each kind on each arm.

    Args:
        motion: index of the motion.
        workers: number of parallel processes.
    """
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

    Args:
        kind: name of the kind.
        scene: arm and motion.
        constants: true constants (n,) [N.m/A].
        known: mask of known constants (n,).
        factors: inertials of the description over the true ones (n,) [1].
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
