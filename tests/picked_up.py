"""A UR10 in MuJoCo that picks up a load or changes otherwise, and recordings of a real UR10e one after another."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.arms import ARMS, load
from benchmarks.plants.bodies import Body
from benchmarks.plants.mujoco_ import draw_motion
from benchmarks.watch.plant import Alteration, Push, record
from signid.types import Robot

ARM = ARMS[2]  # UR10
SCALE = 2.805  # [kg]
PAUSE = 0.5  # [s] between two recordings
OTHER = "20_02_12_40sec_12harm"  # unloaded, of another day
OTHERS = (  # changes that are no load
    Alteration(15, "coulomb_friction", 1, 10.0),
    Alteration(15, "viscous_friction", 3, 3.0),
    Alteration(15, "torque_gain", 1, 0.1),
    Alteration(15, "torque_offset", 2, 5.0),
    Push(15, 2.0, 3, (20.0, 10.0, 0.0)),
)
Columns = dict[str, NDArray[np.float64]]


@cache
def arm() -> Robot:
    """The arm of the simulated recordings."""
    return load(ARM)


@cache
def recorded(events: tuple[Alteration | Push, ...], seed: int, duration: float = 30.0) -> Columns:
    """Columns of a simulated recording at 1 kHz."""
    body = Body(arm().document, arm().joints)
    return record(body, ARM.drives, draw_motion(ARM.centre, seed), duration, events, seed)


def spliced(folder: Path, *names: str) -> tuple[Columns, list[float]]:
    """Columns of recordings of the UR10e one after another, and the times between them [s]."""
    end, parts, between = 0.0, [], []
    for name in names:
        table = pl.read_csv(folder / f"identification_data__{name}.csv.gz", infer_schema_length=None)
        table = table.with_columns(t=pl.col("t") - table["t"][0] + end)
        parts.append(table)
        between.append(float(table["t"][-1]) + PAUSE / 2)
        end = float(table["t"][-1]) + PAUSE
    whole = pl.concat(parts)
    return {name: whole[name].to_numpy() for name in whole.columns}, between[:-1]
