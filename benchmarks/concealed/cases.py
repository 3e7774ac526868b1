"""Cases of all suites: robots with concealed faults and anonymous names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256

import numpy as np

from ..plants.faults import EFFECTS
from .faults import UNSIZED

FAMILIES: Mapping[str, tuple[str, ...]] = {  # foreign laws, and the library's effects that count as right
    "tustin_friction": ("stribeck_friction",),
    "lugre_friction": ("presliding_friction", "stribeck_friction", "coulomb_friction"),
    "double_ripple": ("torque_ripple",),
    "root_friction": ("viscous_friction", "coulomb_friction", "quadratic_friction", "stribeck_friction"),
    "friction_step": ("friction_drift",),
    "triangular_friction": ("position_friction",),
    "soft_stop": ("cable_torque", "spring"),
    "root_load_friction": ("load_friction",),
}
ABSENT: Mapping[str, tuple[str, ...]] = {  # laws missing in the library, and their variables
    "torque_in_time": ("time",),
    "velocity_wave": ("velocity",),
    "skewed_friction": ("velocity", "position"),
    "crossed_torque": ("position",),
    "load_wave": ("torque",),
}
PAIRWISE = ("joint_coupling", "channel_swap", "crossed_torque")  # need two joints
SUITES = ("exact", "hard", "none", "pairs", "foreign", "absent", "removed")
SIZES = (0.02, 0.05, 0.15)  # torque of a fault over the joint's torque, rms [1]
MEDIUM = (0.05, 0.15)  # sizes of foreign and absent laws [1]
PAIR, PAIRS = 0.05, 12  # size of each of two faults [1], pairs per robot and seed
HEALTHY = 6  # healthy sessions per robot and seed, every second one hard
QUICK: Mapping[str, tuple[str, ...]] = {
    "exact": (
        *("viscous_friction", "coulomb_friction", "armature", "torque_offset", "spring", "counterbalance"),
        *("torque_gain", "torque_ripple", "joint_elasticity", "encoder_offset", "time_delay", "payload", "base_tilt"),
        *("joint_coupling", "torque_saturation", "external_contact", "channel_swap"),
    ),
    "hard": ("viscous_friction", "spring", "payload"),
    "foreign": ("soft_stop", "double_ripple"),
    "absent": ("velocity_wave",),
}
REMOVED = tuple(name for name in EFFECTS if name not in UNSIZED)
HARD_ERROR = 0.05  # relative error of masses [1]; inertias twice as much, centres 5 mm


@dataclass(frozen=True)
class Case:
    """One session to record and diagnose."""

    suite: str
    robot: str
    effects: tuple[str, ...]
    size: float
    seed: int
    hard: bool = False
    skip: tuple[str, ...] = ()  # effects removed from the library

    @property
    def key(self) -> str:
        """Readable name."""
        hard = "hard" if self.hard else "exact"
        return "/".join([self.suite, self.robot, "+".join(self.effects), f"{self.size:g}", str(self.seed), hard])

    @property
    def name(self) -> str:
        """Anonymous name of its folder."""
        return sha256(f"{self.key}/mujoco/{self.skip}".encode()).hexdigest()[:12]

    @property
    def number(self) -> int:
        """Seed of the random generator."""
        return int(self.name, 16)

    def document(self) -> dict[str, object]:
        """JSON document."""
        return {**asdict(self), "key": self.key, "name": self.name}


def cases(suites: Sequence[str], robots: Sequence[str], sizes: Sequence[float], seeds: Sequence[int]) -> list[Case]:
    """List all cases of the suites."""
    makers = {"exact": _single, "hard": _single, "none": _healthy, "pairs": _pairs}
    found: list[Case] = []
    for suite in suites:
        for robot in robots:
            for seed in seeds:
                found += makers.get(suite, _others)(suite, robot, sizes, seed)
    return [case for case in found if _possible(case)]


def quick() -> list[Case]:
    """Fixed subset of cases of the three-joint arm at 15 %, and two healthy ones."""
    found = cases(tuple(QUICK), ("3r",), SIZES[-1:], (0,))
    healthy = cases(("none",), ("3r",), SIZES, (0,))[:2]
    return [*(case for case in found if set(case.effects) & set(QUICK[case.suite])), *healthy]


def sample(found: Sequence[Case], number: int, seed: int) -> list[Case]:
    """Random subset of the cases, in their order."""
    chosen = np.random.default_rng(seed).permutation(len(found))[:number]
    return [found[k] for k in sorted(chosen.tolist())]


def _single(suite: str, robot: str, sizes: Sequence[float], seed: int) -> Iterator[Case]:
    for effect in EFFECTS:
        for size in sizes if effect not in UNSIZED else sizes[-1:]:
            yield Case(suite, robot, (effect,), size, seed, suite == "hard")


def _healthy(suite: str, robot: str, sizes: Sequence[float], seed: int) -> Iterator[Case]:
    for k in range(HEALTHY):
        yield Case(suite, robot, (), 0.0, HEALTHY * seed + k, bool(k % 2))


def _pairs(suite: str, robot: str, sizes: Sequence[float], seed: int) -> Iterator[Case]:
    """Random pairs of effects, drawn separately for each robot to cover more pairs."""
    draw = int(sha256(f"{robot}/{seed}".encode()).hexdigest()[:12], 16)
    rng, names = np.random.default_rng(draw), np.array(REMOVED)
    for _ in range(PAIRS):
        one, other = rng.choice(names, 2, replace=False).tolist()
        yield Case(suite, robot, (one, other), PAIR, seed)


def _others(suite: str, robot: str, sizes: Sequence[float], seed: int) -> Iterator[Case]:
    if suite == "removed":
        for effect in REMOVED:
            yield Case(suite, robot, (effect,), PAIR, seed, skip=(effect,))
        return
    for effect in FAMILIES if suite == "foreign" else ABSENT:
        for size in sorted(set(sizes) & set(MEDIUM)):
            yield Case(suite, robot, (effect,), size, seed)


def _possible(case: Case) -> bool:
    """Whether the robot has the joints that the case needs."""
    return not (case.robot == "1r" and set(case.effects) & set(PAIRWISE))
