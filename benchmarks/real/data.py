"""Robots, their real recordings, and reduced simulation models."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl

import signid
from signid.model import Model
from signid.types import Recording, Robot

from ..summary import data

ROBOTS = Path(__file__).parents[2] / "robots"
UNLOADED = ("20_02_19_14harm50sec", "20_02_10_30sec_12harm")  # the first from the same day as the loaded one
HELD_OUT = "20_02_12_50sec_12harm"  # unloaded, from another day, held out
LOADED = "20_02_19_14harm50secLoad"
# effects of the Panda, with torque measured on the link side
LINK_SIDE = ("viscous_friction", "coulomb_friction", "torque_offset")


@cache
def ur10e() -> Robot:
    """UR10e with torque constants from the controller's target torques over its target currents."""
    return signid.load_robot(data() / "ur10e_mamedov" / "ur10e.urdf", actuators=ROBOTS / "ur10e" / "actuators.toml")


def ur10e_recording(name: str, group: str = "identification_data") -> Recording:
    """Read a recording of the UR10e."""
    return signid.read_recording(data() / "ur10e_mamedov" / f"{group}__{name}.csv.gz", ur10e())


@cache
def ur10e_model() -> Model:
    """Model of the UR10e identified from two unloaded recordings."""
    return signid.identify(
        ur10e(), [ur10e_recording(name) for name in UNLOADED], held_out=[ur10e_recording(HELD_OUT)]
    ).model


def recording(folder: str, name: str, robot: Robot) -> Recording:
    """Read a recording of another robot."""
    return signid.read_recording(data() / folder / f"{name}.csv.gz", robot)


def without(model: Model, names: Iterable[str]) -> Model:
    """Remove some laws at all joints."""
    removed = set(names)
    return replace(model, laws=tuple(law for law in model.laws if law.effect.name not in removed))


def blocks(source: Recording, robot: Robot, seconds: float, every: int, folder: Path) -> tuple[list[Recording], ...]:
    """Split a recording into blocks of some seconds and hold out every n-th: training and held-out blocks."""
    whole = source.read()
    table = {"t": whole.t}
    for j, joint in enumerate(source.joints):
        table |= {f"q_{joint}": whole.q[:, j], f"tau_{joint}": whole.tau[:, j]}
    frame, edges = pl.DataFrame(table), np.arange(whole.t[0], whole.t[-1] + seconds / 2, seconds)
    apart: tuple[list[Recording], list[Recording]] = [], []
    for k, start in enumerate(edges):
        block = frame.filter((pl.col("t") >= start) & (pl.col("t") < start + seconds))
        path = folder / f"block_{k}.parquet"
        block.write_parquet(path)
        if len(block) > 0.9 * seconds * len(frame) / (whole.t[-1] - whole.t[0]):
            apart[k % every == every - 1].append(signid.read_recording(path, robot))
    return apart


def parameter(model: Model, effect: str, key: str, joints: Sequence[int]) -> float:
    """Sum of a parameter over the laws of an effect at some joints."""
    return sum(
        law.parameters[key] for law in model.laws if law.effect.name == effect and tuple(law.joints) == tuple(joints)
    )
