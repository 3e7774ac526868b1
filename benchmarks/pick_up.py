"""A load that is picked up in one recording: `python -m benchmarks.pick_up [--seeds 10]`.

MuJoCo: a UR10 at 1 kHz for 30 s, with a load from a random moment on, or with another change, or with none. UR10e:
recordings of a real robot one after another (needs SIGNID_DATA).
"""

from __future__ import annotations

import argparse
import os
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from signid.payload import Payload, payload
from signid.types import Robot

from .arms import ARMS, load
from .plants.bodies import Body
from .plants.mujoco_ import draw_motion
from .real.data import LOADED, UNLOADED, ur10e
from .watch.plant import Alteration, Push, record

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


def _line(what: str, found: Payload, mass: float, times: list[float]) -> None:
    if not found.found:
        print(f"{what:34} {found.flags[0]}")
        return
    value, std = found.mass
    when = ", ".join(f"{m.t:.3f} ± {1.96 * m.std:.3f} s ({t:.3f})" for m, t in zip(found.moments, times, strict=False))
    print(f"{what:34} {value:.4f} ± {1.96 * std:.4f} kg ({mass:g}); {when}")


def main() -> None:
    """Print each trial, and how many intervals contain the truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    inside = {"mass": 0, "moment": 0}
    seeds = parser.parse_args().seeds
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        mass, when = float(np.round(rng.uniform(0.2, 3.0), 2)), float(np.round(rng.uniform(8.0, 22.0), 2))
        found = payload(arm(), recorded((Alteration(when, "payload", 5, mass),), seed))
        _line(f"load, seed {seed}", found, mass, [when])
        if found.found:
            inside["mass"] += abs(found.mass[0] - mass) < 1.96 * found.mass[1]
            inside["moment"] += abs(found.moments[0].t - when) < 1.96 * found.moments[0].std
    print(f"inside of 95 % intervals, of {seeds}: mass {inside['mass']}, moment {inside['moment']}")
    for k, event in enumerate((None, *OTHERS)):
        events = () if event is None else (event,)
        _line(getattr(event, "effect", "push" if event else "nothing"), payload(arm(), recorded(events, k)), 0.0, [])
    if "SIGNID_DATA" in os.environ:
        folder = Path(os.environ["SIGNID_DATA"]) / "ur10e_mamedov"
        same, other = UNLOADED
        for names in (
            (same, LOADED),
            (OTHER, LOADED),
            (LOADED, other),
            (same, LOADED, OTHER),
            (other, OTHER),
            (LOADED,),
        ):
            columns, times = spliced(folder, *names)
            label = "UR10e: " + ", ".join("loaded" if name == LOADED else "unloaded" for name in names)
            _line(label, payload(ur10e(), columns), SCALE, times)


if __name__ == "__main__":
    main()
