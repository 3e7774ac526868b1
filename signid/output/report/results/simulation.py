"""Simulation: JSON document and terminal tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.console import RenderableType

from ....effects.naming import law_place
from ....errors import shorten
from ....model import Model
from ....simulation.plant import Sensors, Simulation
from ....simulation.plant.control import Drive, Tracking
from ....types import Array, Input, Law, Robot
from ..layout import heading, new_table, note_lines, paragraph, plural
from ..numbers import figure
from .documents import Document, description, provenance

FAR = 0.005, 0.05  # rms tracking error from which a joint is noted, prismatic [m] and revolute [rad]


@dataclass(frozen=True)
class SimulationRun:
    """A simulation with its model, drive and recording."""

    model: Model  # including the injected laws
    injected: tuple[Law, ...]
    simulation: Simulation
    columns: Mapping[str, Array]  # (N,) each, as recorded [units of their names]
    sensors: Sensors
    drive: Drive  # drive of the robot
    integrator: str

    @property
    def acting(self) -> list[Law]:
        """Laws with nonzero coefficients."""
        return [law for law in self.model.laws if any(law.effect.coefficients(law.parameters))]

    @property
    def notes(self) -> tuple[str, ...]:
        """Defaults used for missing data of the description, and violated limits."""
        robot, s = self.model.robot, self.simulation
        error = np.zeros(len(robot.joints)) if self.tracking_rms is None else self.tracking_rms
        said: dict[str, Any] = {
            "exceeded its position limits": ((s.true_q < robot.lower) | (s.true_q > robot.upper)).any(axis=0),
            "exceeded its torque limit": (np.abs(s.applied) > robot.effort_limit).any(axis=0),
            "tracked poorly; a larger --bandwidth may help": error > np.where(robot.prismatic, *FAR),
        }
        named = {
            text: [j for j, is_so in zip(robot.joints, which, strict=True) if is_so] for text, which in said.items()
        }
        return (*robot.notes, *(f"{shorten(joints)} {text}" for text, joints in named.items() if joints))

    @property
    def torque_rms(self) -> Array:
        """Rms of the recorded torque, (n,) [N.m or N]."""
        return np.sqrt([np.mean(x**2) for name, x in self.columns.items() if name.startswith(("tau_", "abs_tau_"))])

    @property
    def tracking_rms(self) -> Array | None:
        """Rms of desired - true position, (n,) [rad or m]; None without desired positions."""
        if not any(name.startswith("q_des_") for name in self.columns):
            return None
        return np.asarray(np.sqrt(np.mean((self.simulation.desired - self.simulation.true_q) ** 2, axis=0)))


def simulation_document(run: SimulationRun, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid simulate --json`.

    Args:
        run: simulation.
        inputs: path and sha256 of the files read; default: the robot description.
        seed: seed of the motion and the sensors.
    """
    robot, s = run.model.robot, run.simulation
    return {
        "schema": "signid.simulation/1",
        "robot": robot.name,
        "joints": list(robot.joints),
        "effects": [
            {**law_document(robot, law), "injected": any(law is other for other in run.injected)}
            for law in run.model.laws
        ],
        "drive": _drive(run.drive),
        "step": float(s.t[1] - s.t[0]) if len(s.t) > 1 else None,
        "duration": float(s.t[-1]),
        "integrator": run.integrator,
        "sensors": asdict(run.sensors),
        "rows": len(run.columns["t"]),
        "columns": list(run.columns),
        "torque_rms": run.torque_rms,
        "torque_unit": ["N" if p else "N.m" for p in robot.prismatic],
        "tracking_rms": run.tracking_rms,
        "position_unit": ["m" if p else "rad" for p in robot.prismatic],
        "notes": list(run.notes),
        **provenance((), inputs or [description(robot)], seed),
    }


def simulation_tables(run: SimulationRun) -> list[RenderableType]:
    """Acting laws, and recorded torque and tracking error of each joint."""
    robot, laws = run.model.robot, new_table("law", "joint", "parameter", "value>", "unit", "")
    for law in run.acting:
        entry = law_document(robot, law)
        injected = "injected" if any(law is other for other in run.injected) else ""
        first = (entry["effect"], entry["joint"] or "(robot)")
        for key, p in entry["parameters"].items() or [("", {"value": "", "unit": ""})]:
            laws.add_row(*first, key, _shown(p["value"]), p["unit"], injected)
            first, injected = ("", ""), ""
    joints = new_table("joint", "rms torque>", "unit", "rms tracking error>", "unit")
    errors = [np.nan] * len(robot.joints) if run.tracking_rms is None else run.tracking_rms
    for joint, torque, error, p in zip(robot.joints, run.torque_rms, errors, robot.prismatic, strict=True):
        joints.add_row(joint, figure(float(torque)), "N" if p else "N.m", figure(float(error)), "m" if p else "rad")
    rows = plural(len(run.columns["t"]), "row")
    return [
        heading(f"{robot.name}: {rows}, {figure(float(run.simulation.t[-1]))} s", below=False),
        joints,
        *([heading("Laws"), laws] if run.acting else [paragraph("No law acts in addition to the rigid bodies.")]),
        *note_lines(run.notes),
    ]


def law_document(robot: Robot, law: Law) -> Document:
    """Effect, joint and parameters of a law with their units."""
    joint, values = law_place(law, robot)
    prismatic = bool(len(law.joints) == 1 and robot.prismatic[law.joints[0]])
    units = {key: kind.unit_at(prismatic) for key, kind in law.effect.parameters.items()}
    return {
        "effect": law.effect.name,
        "joint": joint,
        "parameters": {key: {"value": value, "unit": units.get(key, "")} for key, value in values.items()},
    }


def _drive(drive: Drive) -> Document:
    if not isinstance(drive, Tracking):
        return {"kind": "open loop"}
    gains = {"stiffness": drive.stiffness, "damping": drive.damping, "feed_forward": drive.feed_forward}
    return {"kind": "closed loop", **gains}


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
