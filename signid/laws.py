"""Types of laws: coefficients, shapes, the view of a motion, the interface of an effect, and the law."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, ClassVar, Protocol

import numpy as np

from .parameters import Array

Numbers = Mapping[str, float]


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
    positive: bool = True  # whether zero and negative values are impossible

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
    def origin(self) -> float: ...  # [s] time stamp of the start of the recording, if it is far from 0
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


class Effect:
    """Interface of an effect, with its defaults.

    Recorded torque = rigid-body torque + sum over k of columns[k] * coefficient[k].
    """

    name: ClassVar[str] = ""
    equation: ClassVar[str] = ""  # executable text in its parameters, t, q, v, a, load, torque, inertia and `FUNCTIONS`
    source: ClassVar[str] = ""
    typical: ClassVar[str] = ""  # typical magnitudes
    parameters: ClassVar[Mapping[str, Coefficient | Shape]] = {}
    regressors: ClassVar[Mapping[str, Coefficient]] = {}  # coefficient of each column; {}: the linear parameters
    example: ClassVar[Numbers] = {}  # typical values: demonstration, injection, contract test
    headline: ClassVar[str] = ""  # a finding in words, fields: {joint}, {partner}, {KEY}; "": name, joint, main number
    optional: ClassVar[tuple[str, ...]] = ()  # parameters that default to a function of the others
    scope: ClassVar[str] = "joint"
    """joint: one joint, its own row | pair: two joints | link: one joint, all rows | tip: the same, of the last joint
    | robot: all joints | any: all joints together, or one."""
    dissipative: ClassVar[bool] = False  # columns * v, summed over the joints, >= 0
    reverses: ClassVar[bool] = False  # discontinuous at velocity reversals
    twins: ClassVar[tuple[str, ...]] = ()  # similar effects: distinguishable by special motions only, or by none
    contains: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    """Simpler effects contained in this one: factor from their coefficient to each parameter."""
    changes: ClassVar[tuple[str, ...]] = ()  # effects that this one modifies; one of them must be at the joint
    common: ClassVar[float | None] = None  # prior frequency [1]; None: 1 if `signid.effects` lists it, else 0.1
    usual: ClassVar[bool] = False  # present at nearly every joint
    approximate: ClassVar[bool] = False  # never matches a real robot exactly
    memory: ClassVar[bool] = False  # has a state: `begin` and `advance` of `effects.base.TorqueLaw`

    def __repr__(self) -> str:
        return f"<{self.name}>"

    def columns(self, x: View, *args: Any, **shape: Any) -> list[Array]:
        """Arrays (..., m), one per coefficient [torque per unit]; (N, n) for the scopes link and tip.

        `args`: the state (..., m) [1] of an effect with memory; `shape`: its shape parameters.
        """
        raise NotImplementedError

    def possible(self, x: View, *args: Any, **shape: Any) -> bool:
        """Whether the motion can show the effect; columns are computed only then."""
        return True

    def possible_value(self, parameters: Numbers) -> bool:
        """Whether the parameters are physically possible; searches return no others."""
        return True

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        """Candidate shapes for a motion; none if their scale is zero."""
        scale: dict[str | None, Callable[[], float]] = {
            None: lambda: 1.0,
            "speed": lambda: float(np.std(x.v)),
            "travel": lambda: float(np.ptp(x.q)),
            "torque": lambda: float(np.sqrt(np.mean(x.load**2))),
            "duration": lambda: float(np.ptp(x.t)),
        }
        free = {key: p for key, p in self.parameters.items() if isinstance(p, Shape)}
        sizes = [scale[p.of]() for p in free.values()]
        for values in product(*(np.array(p.grid) * size for p, size in zip(free.values(), sizes, strict=True))):
            if all(sizes):
                yield dict(zip(free, map(float, values), strict=True))

    def linear(self) -> dict[str, Coefficient]:
        """Coefficients among the parameters, by key."""
        return {key: p for key, p in self.parameters.items() if isinstance(p, Coefficient)}

    def coefficients(self, parameters: Numbers) -> list[float]:
        """Convert public parameters to linear coefficients; 1 for an effect without parameters."""
        complete = self.filled(parameters)
        return [complete[key] for key in self.linear()] or [1.0]

    def filled(self, parameters: Numbers) -> dict[str, float]:
        """Parameters including the optional ones."""
        return dict(parameters)

    def physical(self, coefficients: Sequence[float], shape: Numbers) -> dict[str, float]:
        """Convert linear coefficients and shape to public parameters."""
        linear = self.linear()
        return {**dict(zip(linear, map(float, coefficients[: len(linear)]), strict=True)), **shape}

    def shape(self, parameters: Numbers) -> dict[str, float]:
        """Shape parameters among the given ones."""
        shaped = [key for key, p in self.parameters.items() if isinstance(p, Shape)]
        return {key: parameters[key] for key in shaped if key in parameters}

    def meaning(self, parameters: Numbers) -> str:
        """Interpretation of the parameters for reports; "" if they need none."""
        return ""


@dataclass(frozen=True)
class Law:
    """An effect at its joints with parameters: all of them in a model, the shape only in a hypothesis."""

    effect: Effect
    joints: tuple[int, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
