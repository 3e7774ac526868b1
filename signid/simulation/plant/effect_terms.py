"""Laws in a simulation step: states at which they are evaluated, all laws of one effect together, their stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...effects.base import TorqueLaw, TransmissionLaw, Trial, of_kind
from ...errors import OptionError
from ...types import Array, Indices, Law, Robot, View
from .dynamics import Dynamics

MAX_DEFLECTION, DEFLECTION_HALVINGS = 1.0, 50  # [rad or m] largest initial deflection, and bisection steps to find it
NO_JOINTS = np.empty(0, dtype=np.intp)
STIFFNESS_STATES = 60  # random states
LAW_STEP = 1e-6  # [rad, rad/s] step of the numerical derivatives of the laws
STIFFNESS_FACTOR = 4.0  # [1] safety factor: laws may be stiffer than at the random states
MAX_EXPLICIT_LOAD = 0.4  # [1] load of the laws over the inertia, below which steps are explicit
MAX_RINGING, MAX_DECAY = 0.3, 0.5  # [1] largest step times frequency, and times decay rate, of explicit steps


class _UnknownTrial:
    """Quantities of a view that are unknown in a simulation step."""

    @property
    def torque(self) -> Array:
        raise AttributeError("the motor torque is unknown in a simulation step; write the law without it")

    recorded = torque

    def __getitem__(self, i: Any) -> View:
        raise TypeError("a moment is a single sample and cannot be indexed")


class Moment(_UnknownTrial):
    """R trials of B states of c coordinates; costly quantities are computed on first use.

    It also is the view of a law that acts on all coordinates.
    """

    soft, flex, at = NO_JOINTS, NO_JOINTS, ...
    origin = 0.0  # [s] time stamp of the start of the recording, if it is far from 0

    def __init__(self, dynamics: Dynamics, copies: int) -> None:
        count = dynamics.bodies.drive.shape[1]
        self.dynamics, self.dt, self.t = dynamics, 0.0, np.zeros((1, copies, 1))
        self.joints, self.whole = tuple(range(count)), self
        self.q = self.v = self.direction = np.zeros((1, copies, count))  # (R, B, c) [rad], [rad/s], [1]
        self.inertia = np.zeros((copies, count))  # (B, c) [kg.m2]
        self.rest()
        self._load: Array | None = None
        self._jacobian: Array | None = None

    def rest(self) -> None:
        """Set the acceleration to zero."""
        still = np.zeros_like(self.inertia)
        self.changed(still, still, 1.0)

    def changed(self, before: Array, after: Array, dt: float) -> None:
        """Store the velocities before (B, c) [rad/s or m/s] and after (B, c) [rad/s or m/s] the last step of dt [s]."""
        self._step = before, after, dt

    @property
    def a(self) -> Array:
        """Acceleration (B, c) of the last step [rad/s2 or m/s2]."""
        before, after, dt = self._step
        return (after - before) / dt

    def cut(self, signal: Array) -> Array:
        """All coordinates of a signal (..., c) [any unit]."""
        return signal

    def set(self, t: float | Array, dt: float, q: Array, v: Array, direction: Array) -> None:
        """Set the trials at time t () or (B,) [s], of which the first one is the state, before a step of dt [s].

        They are q (R, B, c) [rad or m], v (R, B, c) [rad/s or m/s] and direction (R, B, c) [1].
        """
        self.t[0, :, 0], self.dt, self.q, self.v, self.direction = t, dt, q, v, direction
        self._load = self._jacobian = None

    @property
    def load(self) -> Array:
        """Rigid-body torque (B, c) of the state, at the acceleration of the last step [N.m or N]."""
        if self._load is None:
            self._load = self.dynamics.load(self.q[0], self.v[0], self.a)
        return self._load

    @property
    def jacobian(self) -> Array:
        """Jacobian (B, 3, n) of the last link's centre of mass, one column per joint [m/rad or 1]."""
        if self._jacobian is None:
            self._jacobian = self.dynamics.jacobian(self.q[0])
        return self._jacobian


class MomentView(_UnknownTrial):
    """View of some coordinates of a moment; with `soft`, positions are those of the links behind elastic joints."""

    def __init__(self, whole: Moment, index: Indices, joints: tuple[int, ...], soft: Indices, flex: Indices) -> None:
        self.whole, self.joints = whole, joints
        first, last = int(index[0]), int(index[-1])
        run = np.array_equal(index, np.arange(first, last + 1))
        self.at = (..., slice(first, last + 1) if run else index)
        self.soft, self.flex = soft, flex

    def cut(self, signal: Array) -> Array:
        """Coordinates (..., m) of a signal (..., c) [any unit]."""
        if not len(self.soft):
            return np.asarray(signal[self.at])
        out = signal[self.at].copy()
        out[..., self.soft] += signal[..., self.flex]
        return out

    @property
    def dt(self) -> float:
        return self.whole.dt

    @property
    def t(self) -> Array:  # (1, B, 1) [s]
        return self.whole.t

    @property
    def origin(self) -> float:
        return self.whole.origin

    @property
    def q(self) -> Array:
        return self.cut(self.whole.q)

    @property
    def v(self) -> Array:
        return self.cut(self.whole.v)

    @property
    def a(self) -> Array:
        return self.cut(self.whole.a)

    @property
    def load(self) -> Array:  # the motor of an elastic joint carries the load of its link
        return np.asarray(self.whole.load[self.at])

    @property
    def direction(self) -> Array:
        return np.asarray(self.whole.direction[self.at])

    @property
    def inertia(self) -> Array:
        return np.asarray(self.whole.inertia[self.at])


class Term:
    """Laws of one effect at different joints, with arrays of parameters."""

    def __init__(self, laws: Sequence[Law], moment: Moment) -> None:
        bodies = moment.dynamics.bodies
        effect = self.effect = laws[0].effect
        self.transmission, self.memory = isinstance(effect, TransmissionLaw), effect.memory
        joints = tuple(j for law in laws for j in law.joints)
        soft = NO_JOINTS
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
        """Add the torque of the laws to a total (R, B, c) [N.m or N]."""
        view, torque = self.view, self._torque()
        if view.at is ...:
            total += torque
            return
        total[view.at] += torque
        if len(view.soft):
            total[..., view.flex] += torque[..., view.soft]

    def deflect(self, state: Array) -> None:
        """Set the deflections of elastic joints in a state (B, c) [rad or m] in balance with the load, by bisection."""
        load = self.view.load
        low, high = np.full(load.shape, -MAX_DEFLECTION), np.full(load.shape, MAX_DEFLECTION)
        for _ in range(DEFLECTION_HALVINGS):
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
        """Advance the memory by a step of velocity v (B, c) [rad/s or m/s]."""
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
    """Terms of the torque and transmission laws among some laws; those of one effect at different joints share one."""
    groups: list[list[Law]] = []
    for law in (law for law in laws if isinstance(law.effect, TorqueLaw | TransmissionLaw)):
        alike = law.effect.scope in ("joint", "link")
        mine = [g for g in groups if g[0].effect is law.effect and all(law.joints != other.joints for other in g)]
        if alike and mine:
            mine[0].append(law)
        else:
            groups.append([law])
    return tuple(Term(sorted(group, key=lambda law: law.joints), moment) for group in groups)


def total_torque(terms: Sequence[Term], shape: tuple[int, ...]) -> Array:
    """Torque (R, B, c) of all terms [N.m or N], of that shape."""
    total = np.zeros(shape)
    for term in terms:
        term.add(total)
    return total


class Stiffness(NamedTuple):
    """Largest derivatives of the laws' torque by velocity and position, and smallest inertia, (c,) each."""

    damping: Array  # (c,) [N.m.s/rad]
    spring: Array  # (c,) [N.m/rad]
    inertia: Array  # (c,) [kg.m2]

    def stiff(self, dt: float) -> bool:
        """Whether a step of dt [s] must evaluate the laws at its end."""
        load = STIFFNESS_FACTOR * (dt * self.damping + dt**2 * self.spring)
        return bool((load > MAX_EXPLICIT_LOAD * self.inertia).any())

    def substeps(self, step: float, implicit: bool) -> int:
        """Number of sub-steps of a step [s], for accuracy with oscillating springs, and stability if explicit."""
        rate = MAX_RINGING**-1 * np.sqrt(self.spring / self.inertia)
        if implicit:
            return int(np.clip(np.ceil(step * rate.max()), 1, 10))
        return int(max(1, np.ceil(step * max(rate.max(), (self.damping / self.inertia).max() / MAX_DECAY))))


def measure_stiffness(moment: Moment, terms: Sequence[Term], step: float, robot: Robot) -> Stiffness:
    """Measure the stiffness of a plant's laws, for steps [s], at random states, slow and fast."""
    rng, dynamics, (copies, count) = np.random.default_rng(0), moment.dynamics, moment.inertia.shape
    bodies = dynamics.bodies
    low, high = np.clip((robot.lower, robot.upper), -np.pi, np.pi)
    damping, spring, inertia = np.zeros(count), np.zeros(count), np.full(count, np.inf)
    for k in range(STIFFNESS_STATES):
        q, v = np.zeros((copies, count)), np.zeros((copies, count))
        q[:, bodies.motor] = rng.uniform(low, high)
        v[:] = rng.choice([-1.0, 1.0], count) * 10.0 ** (rng.uniform(-5, 0.5) + rng.uniform(-0.5, 0, count))
        q[:, bodies.flex] = rng.uniform(-0.05, 0.05, len(bodies.flex))
        moment.inertia = np.repeat(dynamics.inertia(q[:1]), copies, axis=0)
        trials, speeds = np.stack([q, q, q + LAW_STEP]), np.stack([v, v + LAW_STEP, v])
        moment.set(float(k), step, trials, speeds, np.sign(speeds))
        for term in terms:
            term.begin()
        here, faster, moved = total_torque(terms, speeds.shape)[:, 0]
        damping, spring = np.maximum(damping, (faster - here) / LAW_STEP), np.maximum(spring, (moved - here) / LAW_STEP)
        inertia = np.minimum(inertia, 1 / _mobility(dynamics, q[:1], robot.name).diagonal())
    return Stiffness(damping, spring, inertia)


def _mobility(dynamics: Dynamics, q: Array, robot: str) -> Array:
    """Inverse (c, c) of the mass matrix at q (1, c), if that is positive definite."""
    try:
        found = dynamics.mobility(q)[0]
        feasible = bool(np.isfinite(found).all()) and np.linalg.eigvalsh(found)[0] > 0
    except np.linalg.LinAlgError:
        feasible = False
    if not feasible:
        raise OptionError(
            f"the bodies of {robot} are infeasible: their mass matrix is not positive definite; give every joint mass "
            "or an armature, and a payload or a correction of a link smaller first moments"
        )
    return np.asarray(found)
