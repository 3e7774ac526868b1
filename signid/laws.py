"""Types of laws: coefficients, shapes, the view of a motion, the interface of an effect, and the law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

from .arrays import Array


def prismatic_unit(unit: str) -> str:
    """Unit at a prismatic joint that corresponds to `unit` at a revolute one."""
    return unit.replace("kg.m2", "kg").replace("N.m", "N").replace("rad", "m")


@dataclass(frozen=True)
class Coefficient:
    """A parameter that enters the torque linearly: a column of the regressor."""

    unit: str
    positive: bool = False
    same: bool = False  # same unit at prismatic joints: an angle, or a body's inertia

    def unit_at(self, prismatic: bool) -> str:
        """Unit at a joint: N for N.m, m for rad, kg for kg.m2 at prismatic joints."""
        return prismatic_unit(self.unit) if prismatic and not self.same else self.unit


@dataclass(frozen=True)
class Shape:
    """A parameter that enters the torque nonlinearly: searched on a grid, then refined.

    `grid` is relative to `of`: the rms `speed`, `travel`, rms `torque` or `duration` of the joint; None: absolute.
    """

    unit: str
    grid: tuple[float, ...]
    of: str | None = None

    def unit_at(self, prismatic: bool) -> str:
        """Unit at a joint, converted as for a coefficient."""
        return prismatic_unit(self.unit) if prismatic else self.unit


class View(Protocol):
    """State of the m joints of a law, at one instant or along a motion: arrays (..., m).

    Leading axes are samples (identification) or trial values (simulation).
    """

    @property
    def joints(self) -> tuple[int, ...]: ...
    @property
    def dt(self) -> float: ...  # [s]
    @property
    def whole(self) -> Any: ...  # the underlying Motion or simulation state: jacobian, regressor
    @property
    def t(self) -> Array: ...  # (..., 1) [s]
    @property
    def q(self) -> Array: ...  # (..., m) [rad or m]
    @property
    def v(self) -> Array: ...  # (..., m) [rad/s or m/s]
    @property
    def a(self) -> Array: ...  # (..., m) [rad/s2 or m/s2]
    @property
    def load(self) -> Array: ...  # (..., m) rigid-body torque [N.m or N]
    @property
    def direction(self) -> Array: ...  # (..., m) of motion, in [-1, 1], between at rest [1]
    @property
    def inertia(self) -> Array: ...  # (..., m) diagonal of the mass matrix [kg.m2 or kg]
    @property
    def torque(self) -> Array: ...  # (..., m) motor torque that the model predicts [N.m or N]
    @property
    def recorded(self) -> Array: ...  # (..., m) motor torque as measured [N.m or N]
    def __getitem__(self, i: Any) -> View: ...  # indexes the leading axis


class EffectProtocol(Protocol):
    """Interface of an effect; `effects.base.Effect` has its defaults."""

    name: ClassVar[str]
    equation: ClassVar[str]  # executable text in the parameter keys and t, q, v, a, load, torque, inertia
    source: ClassVar[str]
    typical: ClassVar[str]  # typical magnitudes
    parameters: ClassVar[Mapping[str, Coefficient | Shape]]
    example: ClassVar[Mapping[str, float]]  # typical values: demonstration, injection, contract test
    optional: ClassVar[tuple[str, ...]]  # parameters that default to a function of the others
    scope: ClassVar[str]
    """joint: one joint, its own row | pair: two joints | link: one joint, all rows | tip: the same, of the last joint
    | robot: all joints | any: all joints together, or one."""
    dissipative: ClassVar[bool]  # columns * v, summed over the joints, >= 0
    reverses: ClassVar[bool]  # discontinuous at velocity reversals
    twins: ClassVar[tuple[str, ...]]  # similar effects: distinguishable by special motions only, or by none
    contains: ClassVar[Mapping[str, Mapping[str, float]]]
    """Simpler effects contained in this one: factor from their coefficient to each parameter."""
    changes: ClassVar[tuple[str, ...]]  # effects that this one modifies; one of them must be at the joint
    common: ClassVar[float]  # relative prior frequency among missing effects [1]
    usual: ClassVar[bool]  # present at nearly every joint
    approximate: ClassVar[bool]  # never matches a real robot exactly
    memory: ClassVar[bool]  # has a state: `begin` and `advance` of `effects.base.TorqueLaw`

    def columns(self, x: View, *args: Any, **shape: Any) -> list[Array]:
        """Arrays (..., m), one per coefficient [torque per unit]; (N, n) for the scopes link and tip.

        Args:
            x: view of the joints.
            args: state (..., m) [1] of an effect with memory.
            shape: shape parameters.
        """

    def possible(self, x: View, *args: Any, **shape: Any) -> bool:
        """Whether the motion can show the effect; columns are computed only then."""

    def possible_value(self, parameters: Mapping[str, float]) -> bool:
        """Whether the parameters are physically possible; searches return no others."""

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        """Candidate shapes for a motion; none if their scale is zero."""

    def linear(self) -> dict[str, Coefficient]:
        """Coefficients among the parameters, by key."""

    def coefficients(self, parameters: Mapping[str, float]) -> list[float]:
        """Convert public parameters to linear coefficients; 1 for an effect without parameters."""

    def filled(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Parameters including the optional ones."""

    def physical(self, coefficients: Sequence[float], shape: Mapping[str, float]) -> dict[str, float]:
        """Convert linear coefficients and shape to public parameters."""

    def shape(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Shape parameters among the given ones."""

    def meaning(self, parameters: Mapping[str, float]) -> str:
        """Interpretation of the parameters for reports; "" if they need none."""


@dataclass(frozen=True)
class Law:
    """An effect at its joints with parameters: all of them in a model, the shape only in a hypothesis."""

    effect: EffectProtocol
    joints: tuple[int, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
