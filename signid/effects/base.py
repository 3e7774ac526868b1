"""What an effect is: one physical law, written once, that says where on the way of the torque it acts.

command -> TorqueLaw, BodyLaw (physics) -> record
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import ClassVar

import numpy as np

from ..types import Array, Coefficient, Shape, View

Numbers = Mapping[str, float]


class Effect:
    """Recorded torque = rigid-body torque + sum over k of columns[k] * coefficient[k]."""

    name: ClassVar[str] = ""
    equation: ClassVar[str] = ""  # executable text in the parameter keys and t, q, v, a, load, torque
    source: ClassVar[str] = ""
    parameters: ClassVar[Mapping[str, Coefficient | Shape]] = {}
    example: ClassVar[Numbers] = {}  # a usual value of each: demonstration, injection, contract test
    scope: ClassVar[str] = "joint"  # joint: own row | pair: two rows | link: one joint, all rows | robot: all joints
    dissipative: ClassVar[bool] = False  # columns * v >= 0
    reverses: ClassVar[bool] = False  # jumps where the direction of motion changes
    twins: ClassVar[tuple[str, ...]] = ()  # effects that some motion, or no motion, tells apart

    columns: Callable[..., list[Array]]
    """The law, columns(x: View, **shape): one array (..., m) a coefficient [torque per unit]; scope link: (N, n)."""

    def linear(self) -> dict[str, Coefficient]:
        """The parameters that are coefficients, by key."""
        return {key: p for key, p in self.parameters.items() if isinstance(p, Coefficient)}

    def coefficients(self, parameters: Numbers) -> list[float]:
        """Public parameters to linear coefficients; without any, the law is there (1) or not."""
        return [parameters[key] for key in self.linear()] or [1.0]

    def physical(self, coefficients: Sequence[float], shape: Numbers) -> dict[str, float]:
        """Linear coefficients and shape to public parameters."""
        return {**dict(zip(self.linear(), map(float, coefficients), strict=True)), **shape}

    def shape(self, parameters: Numbers) -> dict[str, float]:
        """The shape among some parameters."""
        shaped = [key for key, p in self.parameters.items() if isinstance(p, Shape)]
        return {key: parameters[key] for key in shaped if key in parameters}

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        """Shape values worth trying on this motion."""
        scale: dict[str | None, Callable[[], float]] = {
            None: lambda: 1.0,
            "speed": lambda: float(np.std(x.v)),
            "travel": lambda: float(np.ptp(x.q)),
            "torque": lambda: float(np.sqrt(np.mean(x.load**2))),
            "duration": lambda: float(np.ptp(x.t)),
        }
        free = {key: p for key, p in self.parameters.items() if isinstance(p, Shape)}
        for values in product(*(np.array(p.grid) * scale[p.of]() for p in free.values())):
            yield dict(zip(free, map(float, values), strict=True))


class TorqueLaw(Effect):
    """A torque on joints. With memory: `begin` and `advance`, and `columns(x, z, **shape)` is given the memory."""

    memory: ClassVar[bool] = False
    advance: Callable[..., Array]
    """advance(z, x, **shape): memory (..., m) after x.dt at velocity x.v, stable for every x.dt."""

    def begin(self, x: View, **shape: float) -> Array:
        """Memory at the first sample, shaped as x.q."""
        return np.zeros_like(x.q)


class BodyLaw(Effect):
    """A change of the rigid bodies. The simulator reshapes its own copy of the pin.Model once."""

    reshape: Callable[..., None]
    """reshape(model, joint, **parameters): change the pin.Model at a velocity index of it."""
