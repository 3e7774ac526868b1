"""Recordings of robots in MuJoCo, some with a fault, and diagnoses of the simulation without the fault."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

import signid
from benchmarks.concealed.scene import ROBOTS, described, draw
from benchmarks.plants.bodies import Drives
from benchmarks.plants.faults import Fault
from benchmarks.plants.mujoco_ import log, simulate
from signid.diagnose import Diagnosis
from signid.diagnose.data.dataset import Dataset, whitened
from signid.diagnose.data.rows import Group
from signid.diagnose.evidence.bayes_factors import Evidence
from signid.diagnose.evidence.selection import Posterior, Selection
from signid.diagnose.run import _no_progress, _posterior, build, prepare_session
from signid.diagnose.search.stepwise import initial_selection
from signid.effects import EFFECTS
from signid.model import Model, stated_inertials
from signid.regression.session import Options, Session, prepare
from signid.robot import load_robot
from signid.signs import recover
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
def recorded(
    robot: str,
    *faults: Planted,
    seed: int = 0,
    motions: int = MOTIONS,
    seconds: float = SECONDS,
    heavier: tuple[tuple[str, float], ...] = (),
) -> tuple[Columns, ...]:
    """Some seconds of each motion, which returns after eight, at 100 Hz with encoders and noise, one after another."""
    body, out = replace(described(robot), heavier=dict(heavier)), list[Columns]()
    planted = [Fault(effect, joint, dict(parameters)) for effect, joint, parameters in faults]
    rng = np.random.default_rng([7, seed])
    for k in range(motions):
        track = simulate(body, DRIVES[robot], draw(ROBOTS[robot], rng), seconds, RATE, planted, k * seconds)
        out.append(log(track, int(rng.integers(2**31)), white=NOISE, coloured=0.4 * NOISE))
    return tuple(out)


def fault(effect: str, joint: int | None = None, **parameters: float | str) -> Planted:
    """Law of a joint given by its number."""
    return effect, None if joint is None else f"joint_{joint}", tuple(parameters.items())


def simulation(robot: str, stated: tuple[str, ...] = STATED, without: tuple[tuple[str, int], ...] = ()) -> Model:
    """Known simulation of a robot: bodies, rotors and friction, without those that are excluded."""
    described = load_robot(robot)
    keys = [next(iter(EFFECTS[name].parameters)) for name in stated]
    laws = [
        Law(EFFECTS[name], (j,), {key: float(x)})
        for name, key in zip(stated, keys, strict=True)
        for j, x in enumerate(getattr(DRIVES[robot], name))
        if (name, j + 1) not in without
    ]
    return Model(described, stated_inertials(described), tuple(laws))


def read(robot: str, made: tuple[Columns, ...], unsigned: bool = False) -> list[Recording]:
    """Recordings in memory."""
    described = load_robot(robot)
    taken = [{key: np.abs(x) if unsigned and key[:3] == "tau" else x for key, x in c.items()} for c in made]
    return [signid.read_recording(columns, described, unsigned=unsigned) for columns in taken]


@cache
def look(
    robot: str,
    *faults: Planted,
    seed: int = 0,
    stated: tuple[str, ...] = STATED,
    without: tuple[tuple[str, int], ...] = (),
    skip: tuple[str, ...] = (),
    **made: Any,
) -> Diagnosis:
    """Diagnosis of the simulation from recordings of a robot with these faults."""
    recordings = read(robot, recorded(robot, *faults, seed=seed, **made))
    return signid.diagnose(simulation(robot, stated, without), recordings, skip=skip)


def named(found: Diagnosis) -> list[tuple[str, tuple[int, ...]]]:
    """Effects and joints of the causes."""
    return [(finding.law.effect.name, finding.law.joints) for finding in found.causes]


class Posed(NamedTuple):
    """Input of the search."""

    session: Session
    dataset: Dataset
    posterior: Posterior

    def group(self, effect: str, *joints: int) -> Group:
        """A hypothesis; the first one of a grid of shapes."""
        return self.posterior.evidence.data.groups[self.posterior.keys[effect, joints][0]]

    def found(self, *selected: Group) -> Selection:
        """Fit with these selected, at the dispersion of the noise."""
        noise = np.full(self.posterior.evidence.data.joints, 1.3)
        return initial_selection(self.posterior, noise, {}).with_selected(selected, dict.fromkeys(selected, 100.0))


@cache
def posed(robot: str, *faults: Planted, heavier: tuple[tuple[str, float], ...] = ()) -> Posed:
    """Evidence and noise that a diagnosis searches."""
    model, recordings = simulation(robot), read(robot, recorded(robot, *faults, heavier=heavier))
    session, _ = prepare_session(model, recover(prepare(model.robot, recordings)), Options(effects=()), _no_progress)
    dataset = build(model, session, (), _no_progress)
    data = whitened(dataset.table, dataset.noise)
    return Posed(session, dataset, _posterior(model, Evidence(data), ()))
