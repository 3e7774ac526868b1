"""Laws of one effect at several joints, evaluated together in a simulation step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...effects.base import TorqueLaw, TransmissionLaw, of_kind
from ...effects.trial import Trial
from ...types import Array, Law
from .state import Moment, MomentView

LARGEST, HALVINGS = 1.0, 50  # [rad or m] largest initial deflection, and bisection steps to find it


class Term:
    """Laws of one effect at different joints, with arrays of parameters."""

    def __init__(self, laws: Sequence[Law], moment: Moment) -> None:
        bodies = moment.dynamics.bodies
        effect = self.effect = laws[0].effect
        self.transmission, self.memory = isinstance(effect, TransmissionLaw), effect.memory
        joints = tuple(j for law in laws for j in law.joints)
        soft = np.empty(0, dtype=np.intp)
        if self.transmission:
            index = bodies.flex[[bodies.soft.tolist().index(j) for j in joints]]
        else:
            index = bodies.motor[list(joints)]
            if effect.scope == "robot":  # these act on the links, behind elastic joints
                soft = bodies.soft
        everywhere = not len(soft) and np.array_equal(index, np.arange(len(moment.joints)))
        self.view = moment if everywhere else MomentView(moment, index, joints, soft, bodies.flex)
        self.z: Array = np.empty(0)  # (B, m) state of the laws, set by `begin`
        several = len(laws) > 1
        keys = effect.parameters if self.transmission else effect.shape(laws[0].parameters)
        self.shape = {
            key: np.array([law.parameters[key] for law in laws]) if several else laws[0].parameters[key] for key in keys
        }
        coefficients = np.array([effect.coefficients(law.parameters) for law in laws])
        self.coefficients = list(coefficients.T if several else coefficients[0])

    def add(self, total: Array) -> None:
        """Add the torque of the laws to a total.

        Args:
            total: (R, B, c) [N.m or N], changed.
        """
        view, torque = self.view, self._torque()
        if view.at is ...:
            total += torque
            return
        total[view.at] += torque
        if len(view.soft):
            total[..., view.flex] += torque[..., view.soft]

    def deflect(self, state: Array) -> None:
        """Set the deflections of elastic joints in balance with the load, by bisection.

        Args:
            state: (B, c) positions, changed [rad or m].
        """
        load = self.view.load
        low, high = np.full(load.shape, -LARGEST), np.full(load.shape, LARGEST)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            trial = Trial(middle, np.zeros_like(middle), load=load, inertia=self.view.inertia)
            beyond = of_kind(self.effect, TransmissionLaw).hold(trial, **self.shape) + load > 0
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        state[self.view.at] = (low + high) / 2

    def begin(self) -> None:
        """Initialise the memory from the current state."""
        if self.memory:
            self.z = of_kind(self.effect, TorqueLaw).begin(self._state(self.view.v[0]), **self.shape)

    def remember(self, v: Array) -> None:
        """Advance the memory by a step.

        Args:
            v: (B, c) velocity of the step [rad/s or m/s].
        """
        self.z = of_kind(self.effect, TorqueLaw).advance(self.z, self._state(self.view.cut(v)), **self.shape)

    def _torque(self) -> Any:
        effect, view = self.effect, self.view
        if self.transmission:
            return of_kind(effect, TransmissionLaw).hold(view, **self.shape)
        if self.memory:
            columns = effect.columns(view, of_kind(effect, TorqueLaw).advance(self.z, view, **self.shape), **self.shape)
        else:
            columns = effect.columns(view, **self.shape)
        torque = self.coefficients[0] * columns[0]
        for k in range(1, len(columns)):
            torque = torque + self.coefficients[k] * columns[k]
        return torque

    def _state(self, v: Array) -> Trial:
        return Trial(self.view.q[0], v, t=self.view.t[0], dt=self.view.dt, joints=self.view.joints)


def build_terms(laws: Sequence[Law], moment: Moment) -> tuple[Term, ...]:
    """Terms of torque and transmission laws; laws of one effect at different joints share a term.

    Args:
        laws: laws of any kind; body laws and recording laws have no term.
        moment: states at which the terms are evaluated.
    """
    groups: list[list[Law]] = []
    for law in (law for law in laws if isinstance(law.effect, TorqueLaw | TransmissionLaw)):
        alike = law.effect.scope in ("joint", "link")
        mine = [g for g in groups if g[0].effect is law.effect and all(law.joints != other.joints for other in g)]
        if alike and mine:
            mine[0].append(law)
        else:
            groups.append([law])
    return tuple(Term(sorted(group, key=lambda law: law.joints), moment) for group in groups)
