"""The pendulum and the arm of Pennese and Vulcano: recordings, coefficients and published errors.

Robotics II project, Sapienza University of Rome, 2020. The recordings are noise-free torques of a model, stored with
nine digits. The torque of the same motions is also recomputed by MuJoCo in double precision.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

import signid
from signid.regression.session import Options
from signid.types import BaseMap, Robot

from ..plants.bodies import Body, Drives
from ..plants.mujoco_model import build, inverse
from .coefficients import TRUE_1R, TRUE_3R, arm_map, pendulum_map
from .row import Row, Target
from .trial import Puzzle, attempt, planted
from .truth import Array, Truth

OPTIONS = Options(effects=(), derivatives="recorded", cutoff=np.inf)
PENDULUM = {"1dof_experiment_easy1": 1.6e-5, "1dof_experiment_easy2": 4.3e-2, "1dof_experiment1": 2.0e-6}
ARM = {"3dof_experiment123": 5.9e-2, "3dof_experiment456": 3.4e-5}
PAPER = {key.partition("_")[2]: x for key, x in (PENDULUM | ARM).items()}  # errors in their repository
HELD_OUT = "3dof_validation_trajectory"  # files 7, 8, 9: joints 1, 2, 3
EXACT = {"1R": 1e-12, "3R": 1e-10}  # upper bound on the error with recomputed torque
SAME = 1e-6  # upper bound on the distance from the signed estimate with stored torque [1]
SEARCH = 0.1  # upper bound on the search time [s]


def rows(tree: bool) -> Iterator[Row]:
    """Yield all five by the exact search, with stored and recomputed torque; with stored torque also by the tree."""
    for anew in (False, True):
        for one in puzzles(anew):
            most = {"error": EXACT[one.group], "samples": 1.0} if anew else {"off": SAME}
            yield attempt(one, target=Target(segments=1.0, **most, seconds=SEARCH))
            if tree and not anew:
                yield attempt(one, "tree")


def folder() -> Path:
    """Folder of the recordings."""
    return Path(os.environ["SIGNID_DATA"]) / "seed_penne"


def puzzles(anew: bool) -> Iterator[Puzzle]:
    """Yield the five recordings with stored torque or with torque recomputed from the motion."""
    robot = signid.load_robot("1r")
    for name in PENDULUM:
        other = "1dof_experiment1" if name != "1dof_experiment1" else "1dof_experiment_easy2"
        sources = [columns(robot, name, anew), columns(robot, other, True)]
        yield puzzle("1R", name, robot, sources, anew)
    robot = signid.load_robot("3r")
    for name in ARM:
        yield puzzle("3R", name, robot, [columns(robot, name, anew), held_out(robot)], anew)


def puzzle(group: str, name: str, robot: Robot, sources: list[dict[str, Array]], anew: bool) -> Puzzle:
    """Puzzle of one recording; another motion is held out."""
    n, at = len(robot.joints), {"1R": pendulum_map, "3R": arm_map}[group]

    def error(base: BaseMap, value: Array) -> float:
        true = TRUE_1R if group == "1R" else own if anew else TRUE_3R
        return float(np.linalg.norm(at(base) @ value - true))

    base = signid.inspect(robot, effects=()).base
    own = at(base) @ planted(robot)(base, ())
    torques = [np.column_stack([s[f"tau_{j + 1}"] for j in range(n)]) for s in sources]
    truths = tuple(Truth(s["t"], tau, tau) for s, tau in zip(sources, torques, strict=True))
    case = name.partition("_")[2] + (", anew" if anew else "")
    return Puzzle(group, case, robot, (sources[0],), (sources[1],), OPTIONS, None, truths, error)


def columns(robot: Robot, name: str, anew: bool) -> dict[str, Array]:
    """Columns of a recording; a stored sine gives the position, with zero velocity."""
    table = pl.read_csv(folder() / f"{name}.csv.gz")
    found = {key: table[key].to_numpy().astype(float) for key in table.columns}
    if "q_1" not in found:
        found |= {"q_1": np.arcsin(found["sin_q_1"]), "dq_1": np.zeros(len(table))}
    return torqued(robot, found) if anew else {k: x for k, x in found.items() if k != "sin_q_1"}


def held_out(robot: Robot) -> dict[str, Array]:
    """Held-out motion with its torque."""
    found: dict[str, Array] = {}
    for j in range(len(robot.joints)):
        table = pl.read_csv(folder() / f"{HELD_OUT}{j + 7}.csv.gz")
        found |= {"t": table["t"].to_numpy().astype(float)}
        found |= {f"{key}_{j + 1}": table[key].to_numpy().astype(float) for key in ("q", "dq", "ddq")}
    return torqued(robot, found)


def torqued(robot: Robot, motion: dict[str, Array]) -> dict[str, Array]:
    """Add the torque of MuJoCo's inverse dynamics in double precision to a motion."""
    n = len(robot.joints)
    model = build(Body(robot.document, robot.joints), Drives.none(n), frictionless=True)
    states = (np.column_stack([motion[f"{key}_{j + 1}"] for j in range(n)]) for key in ("q", "dq", "ddq"))
    torque = inverse(model, robot.joints, *states)
    kept = {key: x for key, x in motion.items() if key != "sin_q_1"}
    return kept | {f"tau_{j + 1}": torque[:, j] for j in range(n)}
