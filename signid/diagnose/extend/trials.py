"""Candidate extended simulations and their residuals on the held-out rows."""

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
from .holdout import ResidualRows, residual_rows

RefitBlock = tuple[Group, ...]  # stated numbers that are refitted together: all bodies, or the laws of some joints


class Extension(NamedTuple):
    """Additions to the simulation: selected laws and refitted numbers."""

    kept: tuple[Group, ...]  # selected laws, in the order in which the simulation gets them
    refitted: frozenset[RefitBlock] = frozenset()
    joint_fit: bool = False  # whether laws are fitted jointly with all stated numbers, though these keep their values

    def without(self, group: Group) -> Extension:
        """Remove a law."""
        return self._replace(kept=tuple(g for g in self.kept if g is not group))


@dataclass(frozen=True, eq=False)
class Trials(Frozen):
    """Extended simulations, each built once and evaluated on the held-out rows."""

    session: Session
    model: Model
    selection: Selection
    built: dict[Extension, tuple[Model, ResidualRows]] = field(default_factory=dict)

    def fit(self, extension: Extension) -> Fitted:
        """Maximum a posteriori coefficients of all numbers that an extension has."""
        selected = tuple(group for group in self.selection.selected if group in extension.kept)
        fit = self.selection.evidence.fit(selected, self.selection.dispersion, self.selection.prior_scale)
        if extension.joint_fit:
            return fit
        return fit.restricted(_among(fit, selected) | self.refitted_columns(extension, fit))

    def refitted_columns(self, extension: Extension, fit: Fitted) -> Mask:
        """(k,) mask of the stated numbers that an extension refits."""
        return _among(fit, [group for block in extension.refitted for group in block])

    def laws(self, extension: Extension) -> dict[Group, tuple[Law, ...]]:
        """Laws of an extension with all their numbers."""
        fit = self.fit(extension)
        return {group: read_laws(group, fit.value[fit.place(group)]) for group in extension.kept}

    def model_of(self, extension: Extension) -> Model:
        """Extended simulation."""
        return self._build(extension)[0]

    def held_out(self, extension: Extension) -> ResidualRows:
        """Residuals of the extended simulation on the held-out rows, without their motions."""
        return self._build(extension)[1]

    def refit_blocks(self) -> list[RefitBlock]:
        """Stated numbers that may be refitted: the laws of each joint, and all bodies."""
        refitted = self.selection.evidence.refitted(self.selection.prior_scale)
        joints = dict.fromkeys(g.law.joints for g in refitted if g.law is not None)
        laws = [tuple(g for g in refitted if g.law is not None and g.law.joints == own) for own in joints]
        bodies = tuple(g for g in refitted if g.bodies)
        return [block for block in (*laws, bodies) if block]

    def _build(self, extension: Extension) -> tuple[Model, ResidualRows]:
        if extension not in self.built:
            fit = self.fit(extension)
            steps = fit.with_value(np.where(self.refitted_columns(extension, fit), fit.value, 0.0))
            bodies = any(group.bodies for block in extension.refitted for group in block)
            refitted = [g for g in self.selection.evidence.data.refitted if bodies or not g.bodies]
            laws = [law for own in self.laws(extension).values() for law in own]
            own = extend(self.model, refitted if extension.refitted else (), steps, laws, self.session.task.base)
            rows = residual_rows(self.session.task, own, self.session.held_out)
            self.built[extension] = own, rows._replace(pieces=())  # motions of many trials would not fit into memory
        return self.built[extension]


def _among(fit: Fitted, groups: Sequence[Group]) -> Mask:
    """(k,) mask of the fitted columns that belong to some groups."""
    return np.asarray(np.isin(fit.which, columns_of(groups) if groups else []))
