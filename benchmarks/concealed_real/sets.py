"""Sets of real recordings: one robot each, and three disjoint parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import signid
from signid.types import Recording, Robot

from ..summary import data

ROBOTS = Path(__file__).parents[2] / "robots"


@dataclass(frozen=True)
class Part:
    """A whole recording, or the samples between two times."""

    file: str
    start: float = -np.inf  # [s]
    end: float = np.inf  # [s]


@dataclass(frozen=True)
class RealSet:
    """Files of a robot: A is identified, B is diagnosed, C is held out."""

    name: str
    folder: str
    urdf: str
    a: tuple[Part, ...]
    b: Part
    c: Part
    actuators: Path | None = None
    more: Mapping[str, Part] = field(default_factory=dict)  # parts for physics missing by nature

    def robot(self) -> Robot:
        """Load the robot of the description."""
        path = data() / self.folder / self.urdf
        return signid.load_robot(path, actuators=self.actuators)


def thirds(file: str, edges: Sequence[tuple[float, float]]) -> tuple[tuple[Part, ...], Part, Part]:
    """Split one recording into three time blocks with gaps between them."""
    a, b, c = (Part(file, *edge) for edge in edges)
    return (a,), b, c


def whole(*files: str) -> tuple[tuple[Part, ...], Part, Part]:
    """Whole recordings: all but two for A, one each for B and C."""
    *a, b, c = map(Part, files)
    return tuple(a), b, c


UR10E = "identification_data__20_02_"
LOADED = f"{UR10E}19_14harm50secLoad"
TABLE = (
    RealSet(
        "ur10e",
        "ur10e_mamedov",
        "ur10e.urdf",
        (Part(f"{UR10E}19_14harm50sec"), Part(f"{UR10E}10_30sec_12harm")),
        Part(f"{UR10E}12_40sec_12harm"),
        Part(f"{UR10E}12_50sec_12harm"),
        actuators=ROBOTS / "ur10e" / "actuators.toml",
        more={"loaded": Part(LOADED, end=30.0), "loaded, held out": Part(LOADED, start=30.5)},
    ),
    RealSet(
        *("emps", "emps_janot", "emps.urdf"),
        *((Part("emps_train", end=13.0),), Part("emps_train", start=13.5), Part("emps_pulses")),
    ),
    RealSet("tx40", "staubli_tx40", "tx40.urdf", *thirds("exciting_traj", ((0, 3.6), (3.65, 6.9), (6.95, 9)))),
    RealSet("panda", "panda_gaz2019", "panda.urdf", *thirds("exciting_traj_1", ((0, 10.5), (10.7, 16.2), (16.4, 21)))),
    RealSet("rokae", "rokae_xmate", "xmate3pro.urdf", *thirds("excit_motor", ((0, 10), (10.2, 15.4), (15.6, 20)))),
    RealSet(
        *("rokae_sensor", "rokae_xmate", "xmate3pro.urdf"),
        *thirds("excit_joint_sensor", ((0, 10), (10.2, 15.4), (15.6, 20))),
    ),
    RealSet(  # psm3_one_no_weight has another counterweight
        "psm", "dvrk_wpi", "psm3.urdf", (Part("psm3_one"),), Part("psm3_two", end=14.5), Part("psm3_two", start=15.0)
    ),
    RealSet(  # a second laboratory
        *("psm_radiang", "dvrk_psm_radiang", "psm3.urdf"),
        *whole(*(f"fourier_test{k}" for k in (2, 3, 4, 5))),
    ),
    RealSet("lwr4", "kuka_lwr4_flobaroid", "kuka_lwr4.urdf", *whole(*(f"measurements_{k}" for k in (1, 2, 3)))),
    RealSet(
        *("dfki", "dfki_simple_pendulum", "pendulum.urdf"),
        *whole("ddp", "direct_collocation", "pd__system_identification"),
    ),
)
SETS = {one.name: one for one in TABLE}


def read(one: RealSet, robot: Robot, part: Part) -> Recording:
    """Read a part of a set; currents are converted to torques."""
    whole = signid.read_recording(data() / one.folder / f"{part.file}.csv.gz", robot)
    return rebuilt(robot, columns_of(whole, part.start, part.end))


def columns_of(recording: Recording, start: float = -np.inf, end: float = np.inf) -> dict[str, np.ndarray]:
    """Arrays (N,) and (N, n) of a recording from a start to an end [s], excluded, by signal."""
    found = recording.read()
    inside = (found.t >= start) & (found.t < end)
    named = {key: getattr(found, key) for key in ("q", "tau", "dq", "ddq", "q_des")}
    return {"t": found.t[inside], **{key: x[inside] for key, x in named.items() if x is not None}}


def rebuilt(robot: Robot, columns: Mapping[str, np.ndarray]) -> Recording:
    """Build a recording from arrays: t (N,), q (N, n), tau (N, n) and so on."""
    return signid.read_recording(dict(columns), robot)
