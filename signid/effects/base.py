"""What an effect is: one physical law, written once, that says where on the way of the torque it acts.

command -> TorqueLaw, BodyLaw (physics) -> record
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any, ClassVar

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

    def columns(self, x: View, **shape: float) -> list[Array]:
        """The law: one array (..., m) per coefficient [torque per unit of it]; scope link: (N, n)."""
        raise NotImplementedError

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
        return {key: parameters[key] for key, p in self.parameters.items() if isinstance(p, Shape) and key in parameters}

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        """Shape values worth trying on this motion."""
        scale = {
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
    """A torque on joints. With memory: `begin` and `advance`, and `columns` is given the memory as well."""

    memory: ClassVar[bool] = False

    def begin(self, x: View, **shape: float) -> Array:
        """Memory at the first sample, shaped as x.q."""
        return np.zeros_like(x.q)

    def advance(self, z: Array, x: View, **shape: float) -> Array:
        """Memory after x.dt at velocity x.v, stable for every x.dt.

        Args:
            z: (..., m) [unit of the law's own state].
            x: the joints at one sample.
            shape: the law's shape.
        """
        raise NotImplementedError


class BodyLaw(Effect):
    """A change of the rigid bodies. The simulator reshapes its own copy of the pin.Model once."""

    def reshape(self, model: Any, joint: int, **parameters: float) -> None:
        """Change the model at a velocity index of it."""
        raise NotImplementedError
