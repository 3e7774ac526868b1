"""Hypotheses of the search: each law of the library at each joint and shape, and unknown dependences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...effects import EFFECTS
from ...effects.base import BodyLaw, RecordingLaw, TorqueLaw, of_kind
from ...effects.law import coefficient_count, hypotheses, law_columns
from ...model import Model
from ...regression.motion import Motion
from ...robot.dynamics import own_body
from ...types import Array, Law
from .estimated_gains import EstimatedGain

GRAVITY_EFFECT = "gravity"  # determined before the search: it is no small correction of the simulation
VARIABLE_NAMES = ("position", "velocity", "acceleration", "torque", "time")
UNKNOWN_KNOTS = 8  # knots of an unknown dependence. Heuristic
MAX_COLUMN_VALUE = 1e60  # [torque per coefficient] larger columns are zeroed: sums of their squares could overflow
Key = tuple[str, tuple[int, ...]]  # effect and joints, shared by all shapes of a hypothesis; see `Hypothesis.nth`


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A law that the simulation may lack, with its shape; without a law, an unknown dependence.

    An unknown dependence is a piecewise linear function of one variable of one joint.
    """

    laws: tuple[Law, ...] = ()
    finite: bool = False  # columns are the change by the stated parameters over their size, not the derivative at zero
    scaled: bool = False  # one unknown factor of all parameters of the law: a link that is heavier as a whole
    joint: int = 0  # joint of an unknown dependence
    variable: str = ""  # variable of an unknown dependence
    knots: tuple[float, ...] = ()  # knots of an unknown dependence [unit of the variable]
    stated: Law | None = None  # the same law in the simulation, if the hypothesis is that its size is wrong
    nth: int = 1  # which law of its effect at its joints, where the simulation states several

    @property
    def unknown(self) -> bool:
        """Whether it is an unknown dependence."""
        return not self.laws

    @cached_property
    def kind(self) -> str:
        """Effect or variable."""
        return self.variable if self.unknown else self.laws[0].effect.name

    @cached_property
    def key(self) -> Key:
        """Effect and joints, for all shapes."""
        if self.unknown:
            return self.kind, (self.joint,)
        return self.kind if self.nth == 1 else f"{self.kind} {self.nth}", self.laws[0].joints

    @property
    def names(self) -> set[Key]:
        """Effect and joints of its law."""
        return {self.key} if self.laws else set()

    @property
    def bodies(self) -> set[int]:
        """Joints that move the links whose bodies it changes."""
        links = [law for law in self.laws if isinstance(law.effect, BodyLaw) and law.effect.scope in ("link", "tip")]
        return {law.joints[0] for law in links}

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.numbers.shape[1] if self.laws else len(self.knots) - 1

    @cached_property
    def numbers(self) -> Array:
        """(d, k) [unit of each parameter, per coefficient] the d linear parameters of its laws per coefficient b."""
        count = sum(coefficient_count(law) for law in self.laws)
        if not self.scaled:
            return np.eye(count)
        return np.array([[x] for law in self.laws for x in law.effect.coefficients(law.parameters)])

    def columns(self, motion: Motion) -> dict[int, Array]:
        """Columns S: for each joint whose torque it changes, (N, k) [torque per coefficient]."""
        if self.unknown:
            return {self.joint: hats(variable(motion, self.joint, self.variable), self.knots)}
        law = self.laws[0]
        if not self.finite:
            rows, columns = law_columns(law, motion)
        else:  # change of torque by a recording law of one number at its full size, over that size
            (key,) = law.effect.linear()
            change = of_kind(law.effect, RecordingLaw).change(motion.at(law.joints), law.parameters, exactly=True)
            wide = change.shape[1] != len(law.joints) or law.effect.scope == "link"
            rows = tuple(range(change.shape[1])) if wide else law.joints
            columns = change[..., None] / law.parameters[key]
        columns = columns @ self.numbers if self.scaled else columns
        return {j: finite(columns[:, k]) for k, j in enumerate(rows)}


def finite(x: Array) -> Array:
    """Set columns x (N, k) [torque per coefficient] with overflow or NaN to zero: such a law explains nothing."""
    largest = max(x.max(initial=0.0), -x.min(initial=0.0))  # NaN if any value is
    return x if largest < MAX_COLUMN_VALUE else np.where(np.abs(x).max(axis=0) < MAX_COLUMN_VALUE, x, 0.0)


def propose(model: Model, motion: Motion, skip: Sequence[str] = ()) -> list[Hypothesis]:
    """List all hypotheses of a search; the grids of shapes are chosen from a motion.

    Where the simulation has a law, the hypothesis is that the law's size is wrong; where it has several of one effect
    at the same joints, each may be wrong.
    """
    known = dict[Key, list[Law]]()  # laws of the simulation that are not zero; of each shape, the first
    for law in (law for law in model.laws if any(law.effect.coefficients(law.parameters))):
        same = known.setdefault((law.effect.name, law.joints), [])
        if _stated(same, law) is None:
            same.append(law)
    shaped = [Law(x.effect, x.joints, shape) for x, *_ in known.values() if (shape := x.effect.shape(x.parameters))]
    n = len(motion.robot.joints)
    found = [
        Hypothesis((law,), stated=_stated(known.get((effect.name, law.joints), ()), law))
        for effect in EFFECTS
        if effect.name not in skip
        for law in [*(x for x in shaped if x.effect is effect), *hypotheses(effect, motion, n)]
        if law.effect.possible(motion.at(law.joints), **law.parameters)
    ]
    found = [x for x in found if x.stated is None or x.stated is known[x.key][0]]  # the others have their own
    more = [
        Hypothesis((Law(law.effect, law.joints, law.effect.shape(law.parameters)),), stated=law, nth=k)
        for effect in EFFECTS
        if effect.name not in skip
        for laws in known.values()
        for k, law in enumerate(laws[1:], 2)
        if law.effect is effect
    ]
    return [*found, *more, *_scaled_links(model, skip), *_unknown(motion)]


def _scaled_links(model: Model, skip: Sequence[str]) -> Iterator[Hypothesis]:
    """Hypotheses that a link has another density; the last link is left out, since a payload explains it."""
    if "link_inertia" in skip:
        return
    effect, bodies = EFFECTS["link_inertia"], model.whole_inertials()
    for joint in range(len(model.robot.joints) - 1):
        own = bodies[own_body(model.robot, joint)]
        if own[0] > 0:
            law = Law(effect, (joint,), dict(zip(effect.parameters, own.tolist(), strict=True)))
            yield Hypothesis((law,), scaled=True)


def _stated(known: Sequence[Law], law: Law) -> Law | None:
    """The first of some laws of one effect and joints that has the same shape, else None."""
    return next((x for x in known if x.effect.shape(x.parameters) == law.effect.shape(law.parameters)), None)


def pooled(motions: Sequence[Motion]) -> Motion:
    """Concatenate the samples of motions; the result has no meaningful derivatives across their borders."""
    names = ("t", "q", "v", "a", "recorded", "predicted")
    joined: dict[str, Any] = {name: np.concatenate([getattr(one, name) for one in motions]) for name in names}
    return replace(motions[0], **joined)


def variable(motion: Motion, joint: int, name: str) -> Array:
    """(N,) signal that an unknown dependence is a function of [its unit]."""
    if name == "time":
        return motion.t
    signal = {"position": motion.q, "velocity": motion.v, "acceleration": motion.a, "torque": motion.predicted}[name]
    assert signal is not None, "a diagnosed motion has predicted torque"
    return np.asarray(signal[:, joint])


def hats(x: Array, knots: Sequence[float]) -> Array:
    """(N, k - 1) [1] hat functions of x (N,) [any unit], without the first: the others and a constant make it."""
    return np.column_stack([np.interp(x, knots, row) for row in np.eye(len(knots))[1:]])


def is_refitted(law: Law) -> bool:
    """Whether the coefficients of a law of the simulation are nuisance parameters.

    True for torque laws, rotor inertias and estimated gains that are not zero; an error of another law's size is a
    hypothesis.
    """
    rotor = law.effect.scope == "joint" and isinstance(law.effect, BodyLaw)
    return any(law.effect.coefficients(law.parameters)) and (isinstance(law.effect, TorqueLaw | EstimatedGain) or rotor)


def is_transient(law: Law) -> bool:
    """Whether a law has a start and an end: a one-off event that other data neither predict nor are predicted by."""
    return {"start", "end"} <= set(law.effect.parameters)


def _unknown(motion: Motion) -> Iterator[Hypothesis]:
    for joint in range(len(motion.robot.joints)):
        for name in VARIABLE_NAMES:
            x = variable(motion, joint, name)
            knots = np.quantile(x, np.linspace(0.002, 0.998, UNKNOWN_KNOTS))
            if name == "velocity":
                knots = np.append(knots, np.std(x) * np.array([-0.2, -0.06, 0, 0.06, 0.2]))
            knots = np.unique(knots)
            if len(knots) > 2:
                yield Hypothesis(joint=joint, variable=name, knots=tuple(knots.tolist()))
