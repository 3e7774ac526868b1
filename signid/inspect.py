"""Structural identifiability of a robot: base parameters and unidentifiable standard parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .effects import EFFECT_NAMES, EFFECTS
from .model import ModelSource
from .regression.base_parameters import build_base
from .robot import Suspect, as_robot, audit
from .typed import typed
from .types import BaseMap, Law, Result, Robot


@dataclass(frozen=True, eq=False)
class Inspection(Result):
    """Base parameters of a robot, from its structure alone, and numbers of its description that are probably wrong."""

    robot: Robot
    base: BaseMap
    suspect: tuple[Suspect, ...] = ()
    flags: tuple[str, ...] = ()  # sentences on the suspects, each once

    @property
    def invisible(self) -> tuple[str, ...]:
        """Standard parameters without influence on the torque of any motion."""
        return tuple(label.name for label in self.base.invisible)

    @property
    def combined(self) -> tuple[str, ...]:
        """Standard parameters that are identifiable only in combination with others."""
        count = (self.base.combination != 0).sum(1)
        alone = {int(k) for k, n in zip(self.base.independent, count, strict=True) if n == 1}
        seen = (self.base.combination != 0).any(0)
        return tuple(label.name for k, label in enumerate(self.base.labels) if seen[k] and k not in alone)


@typed
def inspect(robot: ModelSource, effects: Sequence[str] = EFFECT_NAMES, seed: int = 0) -> Inspection:
    """Determine the base parameters of a robot with the given effects at every joint.

    >>> signid.inspect("3r").base.rank
    25

    Raises:
        OptionError: unknown effect.
    """
    robot = as_robot(robot, "inspect")
    laws = [Law(EFFECTS[name], (j,)) for name in effects for j in range(len(robot.joints))]
    found = audit(robot)
    return Inspection(robot, build_base(robot, laws, seed), found.suspects, (*found.before(), *found.notes))
