"""Robots and their real recordings, and simulations of them with something left out."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl

import signid
from signid.model import Model
from signid.types import Recording, Robot

ROBOTS = Path(__file__).parents[2] / "robots"
UNLOADED = ("20_02_19_14harm50sec", "20_02_10_30sec_12harm")  # the first on the same day as the loaded one
JUDGED = "20_02_12_50sec_12harm"  # unloaded, another day, never learned from
LOADED = "20_02_19_14harm50secLoad"
LINK_SIDE = ("viscous_friction", "coulomb_friction", "torque_offset")  # of the Panda, whose torque is measured there


def data() -> Path:
    """The folder of recordings."""
    return Path(os.environ["SIGNID_DATA"])


@cache
def ur10e() -> Robot:
    """With torque constants from the controller's own target torques over its target currents."""
    return signid.load_robot(data() / "ur10e_mamedov" / "ur10e.urdf", actuators=ROBOTS / "ur10e" / "actuators.toml")


def ur10e_recording(name: str, group: str = "identification_data") -> Recording:
    """One of the UR10e's."""
    return signid.read_recording(data() / "ur10e_mamedov" / f"{group}__{name}.csv.gz", ur10e())


@cache
def ur10e_model() -> Model:
    """As two unloaded recordings say."""
    return signid.identify(
        ur10e(), [ur10e_recording(name) for name in UNLOADED], held_out=[ur10e_recording(JUDGED)]
    ).model


def recording(folder: str, name: str, robot: Robot) -> Recording:
    """Any other."""
    return signid.read_recording(data() / folder / f"{name}.csv.gz", robot)


def without(model: Model, names: Iterable[str]) -> Model:
    """A simulation that lacks some laws, everywhere."""
    gone = set(names)
    return replace(model, laws=tuple(law for law in model.laws if law.effect.name not in gone))


def blocks(source: Recording, robot: Robot, seconds: float, every: int, folder: Path) -> tuple[list[Recording], ...]:
    """Blocks of a recording, and every so-manieth apart: to learn from, to judge by.

    Args:
        source: positions and torques.
        robot: whose.
        seconds: length of a block [s].
        every: one of so many is judged by.
        folder: where the blocks' files go.
    """
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
