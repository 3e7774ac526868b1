"""Repeatability of diagnoses between recordings of one robot: same cause, parameters within their intervals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import signid
from signid.diagnose import Diagnosis
from signid.model import Model
from signid.types import Recording

from .data import ROBOTS, recording, ur10e_model, ur10e_recording, without
from .row import attempt, found

UR10E = ("20_01_31_unload", "20_02_12_40sec_12harm", "20_02_12_50sec_12harm", "20_02_19_14harm50secLoad")
WIDE = 2.0  # tolerated deviation from the weighted mean [standard deviations]
WATCHED = {  # effect, joint, parameter
    "load friction of the elbow": ("load_friction", 2, "coefficient"),
    "load friction of the shoulder": ("load_friction", 1, "coefficient"),
}
DRIVE = {
    key.replace("_", " "): ("asymmetric_friction", 0, key)
    for key in ("viscous_positive", "viscous_negative", "coulomb_positive", "coulomb_negative")
}


@dataclass(frozen=True)
class Repeat:
    """Diagnosis of one recording of a robot."""

    robot: str
    concealed: str
    recording: str
    verdict: str
    effect: str  # first cause
    first: str  # first cause with its joints
    probability: float
    watched: dict[str, tuple[float, float] | None]  # value and standard deviation of the compared parameters
    seconds: float


@dataclass(frozen=True)
class Agreement:
    """Agreement of all recordings of one robot."""

    robot: str
    concealed: str
    same_first: bool
    within: dict[str, bool | None]  # None: fewer than two values

    @property
    def holds(self) -> bool:
        """Whether the recordings agree."""
        return self.same_first and all(yes is not False for yes in self.within.values())


def repeats() -> Iterator[list[Repeat]]:
    """Yield the diagnoses of the UR10e (with and without Coulomb friction in the model) and of both EMPS runs."""
    logs = {name: ur10e_recording(name) for name in UR10E}
    healthy = {name: log for name, log in logs.items() if "Load" not in name}
    yield list(_each("UR10e", "nothing; other days", ur10e_model(), healthy))
    yield list(_each("UR10e", "Coulomb friction", without(ur10e_model(), ["coulomb_friction"]), healthy))
    robot = signid.load_robot(ROBOTS / "emps" / "robot.urdf")
    drive = {name: recording("emps_janot", f"emps_{name}", robot) for name in ("train", "pulses")}
    model = signid.identify(robot, [drive["train"]]).model
    yield list(_each("EMPS", "asymmetric friction", model, drive))


def agree(rows: Sequence[Repeat]) -> Agreement:
    """Compare the diagnoses of one robot."""
    within: dict[str, bool | None] = {}
    for key in rows[0].watched:
        values = np.array([row.watched[key] for row in rows if row.watched[key] is not None])
        if len(values) < 2:
            within[key] = None
            continue
        value, std = values.T
        mean = np.average(value, weights=std**-2.0)
        within[key] = bool(np.all(np.abs(value - mean) <= WIDE * std))
    return Agreement(rows[0].robot, rows[0].concealed, len({row.effect for row in rows}) == 1, within)


def _each(robot: str, concealed: str, model: Model, logs: dict[str, Recording]) -> Iterator[Repeat]:
    for name, log in logs.items():
        row, diagnosis = attempt(robot, concealed, lambda log=log: signid.diagnose(model, [log]), lambda _: ())  # type: ignore[misc]
        first = row.findings[0] if row.findings else None
        yield Repeat(
            robot,
            concealed,
            name,
            row.verdict,
            first.effect if first else "nothing",
            first.place if first else "nothing",
            first.probability if first else float("nan"),
            {} if diagnosis is None else _watched(diagnosis, concealed),
            row.seconds,
        )


def _watched(diagnosis: Diagnosis, concealed: str) -> dict[str, tuple[float, float] | None]:
    wanted = dict(WATCHED) if len(diagnosis.robot.joints) > 1 else dict(DRIVE)
    if "Coulomb" in concealed:
        wanted |= {
            f"Coulomb friction of {diagnosis.robot.joints[j]}": ("coulomb_friction", j, "level") for j in range(6)
        }
    out: dict[str, tuple[float, float] | None] = {}
    for text, (effect, joint, key) in wanted.items():
        one = found(diagnosis, effect, joint)
        out[text] = (one[0].law.parameters[key], one[0].std[key]) if one else None
    return out
