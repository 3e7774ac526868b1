"""What an effect is: one physical law, written once, that says where on the way of the torque it acts.

command -> ActuatorLaw -> TorqueLaw, BodyLaw, TransmissionLaw (physics) -> RecordingLaw (what is written down)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import ClassVar

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .trial import Trial

Numbers = Mapping[str, float]
TRIALS = 12  # at what was before it was written down


class Effect:
    """Recorded torque = rigid-body torque + sum over k of columns[k] * coefficient[k]."""

    name: ClassVar[str] = ""
    equation: ClassVar[str] = ""  # executable text in the parameter keys and t, q, v, a, load, torque, inertia
    source: ClassVar[str] = ""
    typical: ClassVar[str] = ""  # magnitudes that robots have
    parameters: ClassVar[Mapping[str, Coefficient | Shape]] = {}
    example: ClassVar[Numbers] = {}  # a usual value of each: demonstration, injection, contract test
    optional: ClassVar[tuple[str, ...]] = ()  # parameters that follow from the others where they are left out
    scope: ClassVar[str] = "joint"
    """joint: one joint, its own row | pair: two joints | link: one joint, all rows | tip: the same, of the last joint
    | robot: all joints | any: all joints together, or one."""
    dissipative: ClassVar[bool] = False  # columns * v, summed over the joints, >= 0
    reverses: ClassVar[bool] = False  # jumps where the direction of motion changes
    twins: ClassVar[tuple[str, ...]] = ()  # effects that some motion, or no motion, tells apart
    contains: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    """Plainer effects, and how often theirs is in each number."""
    changes: ClassVar[tuple[str, ...]] = ()  # effects of which one must be at the joint: it is a change of them
    common: ClassVar[float] = 1.0  # how often it is what a simulation lacks, beside the others
    usual: ClassVar[bool] = False  # at every joint of a robot, more or less
    approximate: ClassVar[bool] = False  # its shape is never quite that of the robot's

    columns: Callable[..., list[Array]]
    """The law, columns(x: View, **shape): arrays (..., m), one a coefficient [torque per unit]; link, tip: (N, n)."""

    def linear(self) -> dict[str, Coefficient]:
        """The parameters that are coefficients, by key."""
        return {key: p for key, p in self.parameters.items() if isinstance(p, Coefficient)}

    def coefficients(self, parameters: Numbers) -> list[float]:
        """Public parameters to linear coefficients; without any, the law is there (1) or not."""
        complete = self.filled(parameters)
        return [complete[key] for key in self.linear()] or [1.0]

    def filled(self, parameters: Numbers) -> dict[str, float]:
        """The parameters with those that are optional."""
        return dict(parameters)

    def physical(self, coefficients: Sequence[float], shape: Numbers) -> dict[str, float]:
        """Linear coefficients and shape to public parameters."""
        linear = self.linear()
        return {**dict(zip(linear, map(float, coefficients[: len(linear)]), strict=True)), **shape}

    def shape(self, parameters: Numbers) -> dict[str, float]:
        """The shape among some parameters."""
        shaped = [key for key, p in self.parameters.items() if isinstance(p, Shape)]
        return {key: parameters[key] for key in shaped if key in parameters}

    def meaning(self, parameters: Numbers) -> str:
        """What the numbers say in words; empty where the numbers say it themselves."""
        return ""

    def possible_value(self, parameters: Numbers) -> bool:
        """Whether a real robot could have these numbers: a search finds no others. By default any."""
        return True

    possible: Callable[..., bool]
    """possible(x, **shape): whether the motion allows the law at all, before its columns are tried."""

    def _possible(self, x: View, **shape: float) -> bool:
        return True

    possible = _possible

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        """Shape values worth trying on this motion; none where what they scale with is zero."""
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
    """reshape(model, row, body, **parameters): change a pin.Model at a velocity index and the joint that holds it."""


class TransmissionLaw(Effect):
    """A motor and a link that may part: x.q is the deflection, link minus motor; the motor is what is recorded."""

    scope, approximate = "link", True

    def _possible(self, x: View, **shape: float) -> bool:
        """Whether the link has inertia everywhere; impossible bodies swing without bounds."""
        return bool(np.all(x.inertia > 0))

    possible = _possible

    hold: Callable[..., Array]
    """hold(x, **parameters): torque (..., m) against the deflection x.q and its rate x.v."""

    deflection: Callable[..., list[Array]]
    """deflection(x, **shape): deflections (N, 1) along a motion, one a coefficient; without it from `hold`."""

    def _deflection(self, x: View, **shape: float) -> list[Array]:
        """`hold` balances inertia and load, by the implicit midpoint rule linearised at each sample."""
        load, inertia, dt = x.load[:, 0], x.inertia[:, 0], x.dt
        z, w, step, out, tilt = 0.0, 0.0, 1e-6, np.zeros_like(x.q), np.array([[0.0], [1.0], [0.0]])
        for i in range(len(out) - 1):
            trial = Trial(q=z + step * tilt, v=w + step * tilt[[0, 2, 1]], inertia=inertia[i], load=load[i], dt=dt)
            here, stretched, faster = self.hold(trial, **shape)[:, 0]
            stiffness, damping = (stretched - here) / step, (faster - here) / step
            force = (load[i] + load[i + 1]) / 2 + here + dt / 2 * stiffness * w
            after = w - dt * force / (inertia[i] + dt / 2 * damping + dt**2 / 4 * stiffness)
            z, w = z + dt * (w + after) / 2, after
            out[i + 1] = z
        return [out]

    deflection = _deflection

    def _columns(self, x: View, **shape: float) -> list[Array]:
        return [x.whole.shift(x.joints[0], z[:, 0]) for z in self.deflection(x, **shape)]

    columns = _columns


class RecordingLaw(Effect):
    """What is written down differs from what was. Columns: how the record changes with each coefficient, at zero."""

    step: ClassVar[float] = 1e-4  # of a coefficient, for the derivative

    def possible_value(self, parameters: Numbers) -> bool:
        """Nothing that must be positive is negative."""
        return all(parameters[key] >= 0 for key, kind in self.linear().items() if kind.positive)

    recorded_q: Callable[..., Array]
    """recorded_q(x, **parameters): position (..., m) that is written down; without it x.q."""
    recorded_torque: Callable[..., Array]
    """recorded_torque(x, **parameters): torque (..., m) that is written down; without it x.torque, which acts."""

    def _recorded_q(self, x: View, **parameters: float) -> Array:
        return x.q

    def _recorded_torque(self, x: View, **parameters: float) -> Array:
        return x.torque

    recorded_q, recorded_torque = _recorded_q, _recorded_torque

    acted_q: Callable[..., Array]
    """acted_q(x, **parameters): position (..., m) that was, where x.q is written down; without it by trial."""
    acted_torque: Callable[..., Array]
    """acted_torque(x, **parameters): torque (..., m) that acted, where x.torque is written down; without it by trial.

    Source: van Cittert, Zeitschrift fuer Physik 69, 1931, pages 298-308: few trials sharpen and leave noise alone.
    """

    def _acted_q(self, x: View, **parameters: float) -> Array:
        found = x.q
        for _ in range(TRIALS):
            found = found + x.q - self.recorded_q(Trial(found, x.v, t=x.t, dt=x.dt, joints=x.joints), **parameters)
        return found

    def _acted_torque(self, x: View, **parameters: float) -> Array:
        found = x.torque
        for _ in range(TRIALS):
            trial = Trial(x.q, x.v, t=x.t, dt=x.dt, torque=found, joints=x.joints)
            found = found + x.torque - self.recorded_torque(trial, **parameters)
        return found

    acted_q, acted_torque = _acted_q, _acted_torque

    def _columns(self, x: View, **shape: float) -> list[Array]:
        zero = dict.fromkeys(self.linear(), 0.0)
        trials = [({**zero, key: self.step}, self.step) for key in zero] or [({}, 1.0)]
        return [self.change(x, {**parameters, **shape}) / step for parameters, step in trials]

    columns = _columns

    def change(self, x: View, parameters: Numbers, exactly: bool = False) -> Array:
        """What the law adds to the torque (..., m) [N.m or N] that seems to belong to the motion."""
        moved = self.recorded_q(x, **parameters) - x.q
        if moved.any():
            return np.asarray(-x.whole.shift(x.joints[0], moved[:, 0], exactly=exactly))
        return self.recorded_torque(x, **parameters) - x.torque


class ActuatorLaw(Effect):
    """The command is recorded, another torque acts."""

    approximate = True
    applied_torque: Callable[..., Array]
    """applied_torque(x, **parameters): torque (..., m) that acts where x.torque is the command."""

    def _columns(self, x: View, **shape: float) -> list[Array]:
        command = Trial(x.q, x.v, t=x.t, dt=x.dt, torque=x.recorded)
        return [x.recorded - self.applied_torque(command, **shape)]

    columns = _columns


def sine_cosine(effect: Effect, parameters: Numbers) -> list[float]:
    """Coefficients of sin(x) and cos(x) in amplitude * sin(x + phase)."""
    amplitude, phase = parameters["amplitude"], parameters["phase"]
    return [amplitude * np.cos(phase), amplitude * np.sin(phase)]


def amplitude_phase(effect: Effect, coefficients: Sequence[float], shape: Numbers) -> dict[str, float]:
    """Of sine * sin(x) + cosine * cos(x) = amplitude * sin(x + phase)."""
    sine, cosine = coefficients
    return {"amplitude": float(np.hypot(sine, cosine)), "phase": float(np.arctan2(cosine, sine)), **shape}
