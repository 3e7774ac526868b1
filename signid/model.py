"""A robot with the numbers that make it a simulation: inertials of its bodies and laws at its joints."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from .effects import EFFECT_NAMES, EFFECTS
from .effects.law import law_columns
from .errors import RobotError, SignidError
from .laws import law_at, placed
from .motion import Motion
from .robot import held_positions, load_robot, robot_from_text
from .types import Array, Frozen, Law, Robot

SCHEMA = "signid.model/1"


@dataclass(frozen=True, eq=False)
class Model(Frozen):
    """Rigid bodies and laws: recorded torque = rigid-body torque + the sum of the laws."""

    robot: Robot
    inertials: Array  # (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2]
    laws: tuple[Law, ...] = ()

    def inverse(self, motion: Motion) -> Array:
        """Torque (N, n) [N.m or N] that the motion takes."""
        model = self.robot.model.copy()
        for body, inertial in enumerate(self.inertials):
            model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(inertial)
        torque = Motion(replace(self.robot, model=model), motion.t, motion.q, motion.v, motion.a).load.copy()
        for law in self.laws:
            rows, columns = law_columns(law, motion)
            torque[:, list(rows)] += columns @ np.array(law.effect.coefficients(law.parameters))
        return torque

    def document(self) -> dict[str, Any]:
        """The model as JSON: it carries the robot's description and loads back by itself."""
        robot = self.robot
        return {
            "schema": SCHEMA,
            "robot": {"name": robot.name, "kind": robot.kind, "description": robot.document},
            "joints": list(robot.joints),
            "held": held_positions(robot),
            "standard_parameters": standard_parameters(robot, self.inertials),
            "effects": [
                {"effect": law.effect.name, "joint": joint, "parameters": parameters}
                for law in self.laws
                for joint, parameters in [placed(law, robot)]
            ],
        }


def load_model(source: str | Path, actuators: str | Path | None = None) -> Model:
    """A simulation: a saved model.json, or a robot as its description and its actuators file state it.

    Raises:
        RobotError: when it is neither.
    """
    if str(source).endswith(".json"):
        return _read(Path(source))
    robot = load_robot(str(source), actuators=actuators)
    return Model(robot, stated_inertials(robot), stated_laws(robot))


def stated_inertials(robot: Robot) -> Array:
    """(nb, 10) inertial parameters that the description states [kg, kg.m, kg.m2]."""
    return np.array([body.toDynamicParameters() for body in list(robot.model.inertias)[1:]]).reshape(-1, 10)


def stated_laws(robot: Robot) -> tuple[Law, ...]:
    """The laws that the description and its actuators file state."""
    return tuple(
        Law(EFFECTS[name], (j,), EFFECTS[name].physical([value], {}))
        for name in EFFECT_NAMES  # an actuators file calls what it states by the names of the laws
        for j, value in enumerate(getattr(robot.actuators, name))
        if np.isfinite(value)
    )


def standard_parameters(robot: Robot, inertials: Array) -> dict[str, dict[str, Any]]:
    """Per link: mass, first moment and inertia about the link's joint frame.

    Args:
        robot: gives the links.
        inertials: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
    """
    return {
        link: {"mass": float(x[0]), "first_moment": x[1:4].tolist(), "inertia": x[4:].tolist()}
        for link, x in zip(robot.links, inertials, strict=True)
    }


def _read(path: Path) -> Model:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["schema"] != SCHEMA:
            raise RobotError(f"{path} holds {content['schema']!r}; expected {SCHEMA!r} as `signid identify` writes it")
        described: Mapping[str, str] = content["robot"]
        robot = robot_from_text(described["description"], described["kind"], described["name"], lock=content["held"])
        inertials = [_inertial(content["standard_parameters"][link]) for link in robot.links]
        laws = tuple(
            law_at(EFFECTS[entry["effect"]], robot, entry["joint"], entry["parameters"]) for entry in content["effects"]
        )
    except OSError as error:
        raise RobotError(f"cannot read {path}: {error.strerror}") from None
    except SignidError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise RobotError(f"{path} is no model.json as `signid identify` writes it ({error!r})") from None
    return Model(robot, np.array(inertials), laws)


def _inertial(entry: Mapping[str, Any]) -> Sequence[float]:
    return [entry["mass"], *entry["first_moment"], *entry["inertia"]]
