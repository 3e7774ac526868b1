"""Robots and their real recordings."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import signid
from signid.model import Model
from signid.types import Recording, Robot

from .summary import data

ROBOTS = Path(__file__).parents[1] / "robots"
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
