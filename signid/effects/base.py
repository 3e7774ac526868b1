"""Interface of the effects (physical laws), by the place where they act on the torque.

command -> ActuatorLaw -> TorqueLaw, BodyLaw, TransmissionLaw (physics) -> RecordingLaw (measurement)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import lru_cache
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..types import Array, Effect as Effect, View

Kind = TypeVar("Kind", bound="Effect")
Numbers = Mapping[str, float]
FUNCTIONS = (  # names of NumPy that an equation may use, beside norm
    "pi abs sign exp log sqrt sin cos tan arctan arctan2 sinh cosh tanh clip where sum array cross minimum maximum "
    "interp"
).split()
INVERSION_ITERATIONS = 12  # fixed-point iterations that invert a recording law


@dataclass(slots=True, eq=False)
class Trial:
    """A View of given values; zero where none is given."""

    q: Any = 0.0  # (..., m) [rad or m]
    v: Any = 0.0  # (..., m) [rad/s or m/s]
    _: KW_ONLY
    a: Any = 0.0  # (..., m) [rad/s2 or m/s2]
    load: Any = 0.0  # (..., m) [N.m or N]
    direction: Any = 0.0  # (..., m) [1]
    inertia: Any = 0.0  # (..., m) [kg.m2 or kg]
    torque: Any = 0.0  # (..., m) [N.m or N]
    recorded: Any = 0.0  # (..., m) [N.m or N]
    t: Any = 0.0  # (..., 1) [s]
    dt: float = 0.0
    origin: float = 0.0  # [s]
    joints: tuple[int, ...] = ()
    whole: Any = None

    def __getitem__(self, i: Any) -> Trial:
        """Index the leading axis of all arrays."""
        values = {name: getattr(self, name) for name in self.__slots__}
        return Trial(**{name: x[i] if getattr(x, "ndim", 0) else x for name, x in values.items()})


class TorqueLaw(Effect):
    """A torque on joints. With `memory`, the law has a state, and `columns(x, z, **shape)` receives it."""

    def begin(self, x: View, *args: Any, **shape: Any) -> Array:
        """State at the first sample, with the shape of x.q."""
        return np.zeros_like(x.q)

    def advance(self, z: Array, x: View, *args: Any, **shape: Any) -> Array:
        """State (..., m) after x.dt at velocity x.v, stable for every x.dt; z: (..., m) state before [1]."""
        raise NotImplementedError


class BodyLaw(Effect):
    """A change of the rigid bodies, applied to a copy of the pin.Model."""

    def reshape(self, model: Any, row: int, body: int, *args: Any, **parameters: Any) -> None:
        """Modify a pin.Model in place, at a velocity index (`row`) and the index of its joint (`body`)."""
        raise NotImplementedError


class TransmissionLaw(Effect):
    """Relative motion of link and motor: x.q is the deflection, link minus motor; the motor position is recorded."""

    scope, approximate = "link", True

    def possible(self, x: View, *args: Any, **shape: Any) -> bool:
        """Whether the inertia is positive along the motion; otherwise the deflection is unbounded."""
        return bool(np.all(x.inertia > 0))

    def hold(self, x: View, *args: Any, **parameters: Any) -> Array:
        """Torque (..., m) [N.m or N] against the deflection x.q and its rate x.v."""
        raise NotImplementedError

    def deflection(self, x: View, *args: Any, **shape: Any) -> list[Array]:
        """Deflections (N, 1) [rad or m] along a motion, one per coefficient.

        By default `hold`, inertia and load are balanced by the implicit midpoint rule, linearised at each sample.
        """
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

    def columns(self, x: View, *args: Any, **shape: Any) -> list[Array]:
        """Change of the torque (N, n) with the motion of the link [N.m or N per unit]."""
        return [x.whole.shift(x.joints[0], z[:, 0]) for z in self.deflection(x, **shape)]


class RecordingLaw(Effect):
    """An error of recorded torque or position. Columns: derivatives with respect to each coefficient."""

    step: ClassVar[float] = 1e-4  # finite-difference step of a coefficient [its unit]

    def possible_value(self, parameters: Numbers) -> bool:
        """Whether no positive coefficient is negative."""
        return all(parameters[key] >= 0 for key, kind in self.linear().items() if kind.positive)

    def recorded_q(self, x: View, *args: Any, **parameters: Any) -> Array:
        """Recorded position (..., m) [rad or m] for the true position x.q; by default the same."""
        return x.q

    def recorded_torque(self, x: View, *args: Any, **parameters: Any) -> Array:
        """Recorded torque (..., m) [N.m or N] for the true torque x.torque; by default the same."""
        return x.torque

    def acted_q(self, x: View, *args: Any, **parameters: Any) -> Array:
        """True position (..., m) [rad or m] for the recorded position x.q; by default a fixed-point iteration."""
        found = x.q
        for _ in range(INVERSION_ITERATIONS):
            found = found + x.q - self.recorded_q(Trial(found, x.v, t=x.t, dt=x.dt, joints=x.joints), **parameters)
        return found

    def acted_torque(self, x: View, *args: Any, **parameters: Any) -> Array:
        """True torque (..., m) [N.m or N] for the recorded torque x.torque; by default a fixed-point iteration.

        Source: van Cittert, Zeitschrift fuer Physik 69, 1931, pages 298-308: few iterations sharpen without noise.
        """
        found = x.torque
        for _ in range(INVERSION_ITERATIONS):
            trial = Trial(x.q, x.v, t=x.t, dt=x.dt, torque=found, joints=x.joints)
            found = found + x.torque - self.recorded_torque(trial, **parameters)
        return found

    def columns(self, x: View, *args: Any, **shape: Any) -> list[Array]:
        """Derivatives (..., m) of the apparent torque at zero, by finite differences [N.m or N per unit]."""
        zero = dict.fromkeys(self.linear(), 0.0)
        trials = [({**zero, key: self.step}, self.step) for key in zero] or [({}, 1.0)]
        return [self.change(x, {**parameters, **shape}) / step for parameters, step in trials]

    def change(self, x: View, parameters: Numbers, exactly: bool = False) -> Array:
        """Change (..., m) [N.m or N] of the torque as inferred from recorded motion and torque."""
        moved = self.recorded_q(x, **parameters) - x.q
        if moved.any():
            return np.asarray(-x.whole.shift(x.joints[0], moved[:, 0], exactly=exactly))
        return self.recorded_torque(x, **parameters) - x.torque


class ActuatorLaw(Effect):
    """A difference between the recorded command and the applied torque."""

    approximate = True

    def applied_torque(self, x: View, *args: Any, **parameters: Any) -> Array:
        """Applied torque (..., m) [N.m or N] for the command x.torque."""
        raise NotImplementedError

    def columns(self, x: View, *args: Any, **shape: Any) -> list[Array]:
        """Difference (..., m) of recorded command and applied torque [N.m or N]."""
        command = Trial(x.q, x.v, t=x.t, dt=x.dt, torque=x.recorded)
        return [x.recorded - self.applied_torque(command, **shape)]


def of_kind(effect: Effect, kind: type[Kind]) -> Kind:
    """The effect of a law as an instance of its kind.

    Raises:
        TypeError: the effect is of another kind.
    """
    if not isinstance(effect, kind):
        raise TypeError(f"effect {effect.name!r} is not a {kind.__name__}")
    return effect


def sine_cosine(effect: Effect, parameters: Numbers) -> list[float]:
    """Convert amplitude * sin(x + phase) to coefficients of sin(x) and cos(x)."""
    amplitude, phase = parameters["amplitude"], parameters["phase"]
    return [amplitude * np.cos(phase), amplitude * np.sin(phase)]


def amplitude_phase(effect: Effect, coefficients: Sequence[float], shape: Numbers) -> dict[str, float]:
    """Convert coefficients of sin(x) and cos(x) to amplitude * sin(x + phase)."""
    sine, cosine = coefficients
    return {"amplitude": float(np.hypot(sine, cosine)), "phase": float(np.arctan2(cosine, sine)), **shape}


@lru_cache(maxsize=16)  # a delay is fitted to the same torque again and again
def akima(t: bytes, values: bytes) -> Any:
    """Interpolator of values (N, k) between times (N,) [s], both given as the bytes of their arrays."""
    from scipy.interpolate import Akima1DInterpolator  # slow import

    at = np.frombuffer(t)
    return Akima1DInterpolator(at, np.frombuffer(values).reshape(len(at), -1))
