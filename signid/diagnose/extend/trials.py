"""Selected laws -> the simulations that could be handed out, and what each leaves of the held-out rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ...model import Model
from ...regression.session import Session
from ...types import Frozen, Law, Mask
from ..data.column_groups import Group
from ..data.normal_equations import Fitted
from ..data.whitened_rows import columns_of
from ..evidence.selection import Selection
from .extend import extend, read_laws
from .holdout import Rows, residuals

Unit = tuple[Group, ...]  # stated numbers that are refitted together: all bodies, or the laws of some joints


class Choice(NamedTuple):
    """What an extended simulation has."""

    kept: tuple[Group, ...]  # selected laws, in the order in which the simulation gets them
    refitted: frozenset[Unit] = frozenset()
    beside: bool = False  # whether laws are fitted beside all stated numbers, though these stay

    def without(self, group: Group) -> Choice:
        """The same without a law."""
        return self._replace(kept=tuple(g for g in self.kept if g is not group))


@dataclass(frozen=True, eq=False)
class Trials(Frozen):
    """Simulations that were tried, each made once."""

    session: Session
    model: Model
    found: Selection
    made: dict[Choice, tuple[Model, Rows]] = field(default_factory=dict)

    def fit(self, choice: Choice) -> Fitted:
        """The likeliest numbers of all that a choice has."""
        selected = tuple(group for group in self.found.selected if group in choice.kept)
        fit = self.found.evidence.fit(selected, self.found.dispersion, self.found.prior_scale)
        return fit if choice.beside else fit.restricted(_among(fit, selected) | self.moved(choice, fit))

    def moved(self, choice: Choice, fit: Fitted) -> Mask:
        """(k,) which stated numbers a choice refits."""
        return _among(fit, [group for unit in choice.refitted for group in unit])

    def laws(self, choice: Choice) -> dict[Group, tuple[Law, ...]]:
        """The laws of a choice, with all their numbers."""
        fit = self.fit(choice)
        return {group: read_laws(group, fit.value[fit.place(group)]) for group in choice.kept}

    def model_of(self, choice: Choice) -> Model:
        """The simulation that a choice makes."""
        return self._make(choice)[0]

    def rows(self, choice: Choice) -> Rows:
        """What it leaves of the held-out rows, without their motions."""
        return self._make(choice)[1]

    def units(self) -> list[Unit]:
        """Stated numbers that may be refitted, the laws of each joint by themselves."""
        refitted = self.found.evidence.refitted(self.found.prior_scale)
        joints = dict.fromkeys(g.law.joints for g in refitted if g.law is not None)
        laws = [tuple(g for g in refitted if g.law is not None and g.law.joints == own) for own in joints]
        bodies = tuple(g for g in refitted if g.bodies)
        return [unit for unit in (*laws, bodies) if unit]

    def _make(self, choice: Choice) -> tuple[Model, Rows]:
        if choice not in self.made:
            fit = self.fit(choice)
            steps = fit.with_value(np.where(self.moved(choice, fit), fit.value, 0.0))
            bodies = any(group.bodies for unit in choice.refitted for group in unit)
            refitted = [g for g in self.found.evidence.data.refitted if bodies or not g.bodies]
            laws = [law for own in self.laws(choice).values() for law in own]
            own = extend(self.model, refitted if choice.refitted else (), steps, laws, self.session.task.base)
            rows = residuals(self.session.task, own, self.session.held_out)
            self.made[choice] = own, rows._replace(pieces=())  # motions of many trials would not fit into memory
        return self.made[choice]


def _among(fit: Fitted, groups: Sequence[Group]) -> Mask:
    """(k,) which of all that is fitted are columns of some groups."""
    return np.asarray(np.isin(fit.which, columns_of(groups) if groups else []))
