"""Recordings of robots in MuJoCo, some with a fault, and what a simulation without the fault is told to lack."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import signid
from benchmarks.hidden.motion import draw
from benchmarks.hidden.robots import ROBOTS, described
from benchmarks.plants.bodies import Drives
from benchmarks.plants.faults import Fault
from benchmarks.plants.mujoco_ import log, simulate
from signid.diagnose import Diagnosis
from signid.effects import EFFECTS
from signid.model import Model, stated_inertials
from signid.robot import load_robot
from signid.types import Law, Recording

MOTIONS, SECONDS, RATE, NOISE = 4, 8.0, 100.0, 0.02
DRIVES = {
    "1r": Drives((0.3,), (0.4,), (0.8,), (0.0,)),
    "3r": Drives((0.03, 0.03, 0.01), (0.05, 0.15, 0.05), (0.05, 0.25, 0.08), (0.0, 0.0, 0.0)),
}
STATED = ("armature", "viscous_friction", "coulomb_friction")
Columns = dict[str, np.ndarray]
Planted = tuple[str, str | None, tuple[tuple[str, float | str], ...]]  # effect, joint, parameters


@cache
def recorded(robot: str, *faults: Planted, seed: int = 0, motions: int = MOTIONS) -> tuple[Columns, ...]:
    """Eight seconds of each motion at 100 Hz, with encoders and noise, by the session's clock."""
    body, out = described(robot), list[Columns]()
    planted = [Fault(effect, joint, dict(parameters)) for effect, joint, parameters in faults]
    rng = np.random.default_rng([7, seed])
    for k in range(motions):
        track = simulate(body, DRIVES[robot], draw(ROBOTS[robot], rng), SECONDS, RATE, planted, k * SECONDS)
        out.append(log(track, int(rng.integers(2**31)), white=NOISE, coloured=0.4 * NOISE))
    return tuple(out)


def fault(effect: str, joint: int | None = None, **parameters: float | str) -> Planted:
    """Of a joint by its number."""
    return effect, None if joint is None else f"joint_{joint}", tuple(parameters.items())


def simulation(robot: str, stated: tuple[str, ...] = STATED) -> Model:
    """What is known of a robot: its bodies, rotors and friction, or some of these."""
    described = load_robot(robot)
    keys = [next(iter(EFFECTS[name].parameters)) for name in stated]
    laws = [
        Law(EFFECTS[name], (j,), {key: float(x)})
        for name, key in zip(stated, keys, strict=True)
        for j, x in enumerate(getattr(DRIVES[robot], name))
    ]
    return Model(described, stated_inertials(described), tuple(laws))


def read(robot: str, made: tuple[Columns, ...], unsigned: bool = False) -> list[Recording]:
    """Recordings in memory."""
    described = load_robot(robot)
    taken = [{key: np.abs(x) if unsigned and key[:3] == "tau" else x for key, x in c.items()} for c in made]
    return [signid.read_recording(columns, described, unsigned=unsigned) for columns in taken]


@cache
def look(robot: str, *faults: Planted, seed: int = 0, stated: tuple[str, ...] = STATED, **options: Any) -> Diagnosis:
    """What the simulation lacks by the recordings of a robot with these faults."""
    return signid.diagnose(simulation(robot, stated), read(robot, recorded(robot, *faults, seed=seed)), **options)


def named(found: Diagnosis) -> list[tuple[str, tuple[int, ...]]]:
    """Effects and joints of its causes."""
    return [(finding.law.effect.name, finding.law.joints) for finding in found.causes]
