"""Simulated plant: bodies, laws and drives, and its run over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from ...effects.base import ActuatorLaw, RecordingLaw, Trial, of_kind
from ...effects.drive import DriveLaw
from ...errors import OptionError
from ...model import Model, ModelSource, as_model, torque_model
from ...regression.joint_dynamics import Simulated, numbers_of, rows_of
from ...typed import typed
from ...types import Array, Frozen, Law, Progress, Result
from .control import Drive, Plan, Torques
from .drives import JointDrives, commanded
from .dynamics import DryFriction, Dynamics, build_bodies
from .effect_terms import LAW_STEP, Moment, build_terms, measure_stiffness, total_torque

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

INTEGRATORS = ("semi-implicit", "rk4")
MAX_SUBSTEPS = 200  # [sub-steps of a step]; heuristic: time
REVERSAL_SUBSTEPS = 4  # sub-steps of a Runge-Kutta step in which a joint stops or reverses
MAX_STEPS = 5e6  # [steps] of a simulation; heuristic: memory
MAX_SPEED = 1e4  # [rad/s or m/s] speed from which on a simulation has diverged


class Plant:
    """B copies of a model in motion: q, v and a (B, n) of the motors, link (B, n) positions behind elastic joints.

    A step is semi-implicit (velocity first, stiff laws evaluated at the end of the step), or by the Runge-Kutta method
    of fourth order with constant torque. If dry friction stops a joint, the step is semi-implicit.
    """

    def __init__(
        self, model: Model, step: float, copies: int = 1, integrator: str = "semi-implicit", substeps: int = 0
    ) -> None:
        if integrator not in INTEGRATORS:
            raise OptionError(f"there is no integrator {integrator!r}; choose from {', '.join(INTEGRATORS)}")
        self.bodies, self.step, self.integrator = build_bodies(model), step, integrator
        self.dynamics = Dynamics(self.bodies, copies)
        self.moment = Moment(self.dynamics, copies)
        self.terms = build_terms(model.laws, self.moment)
        self.remembering = [term for term in self.terms if term.memory]
        self.dry = any(term.effect.reverses for term in self.terms)
        self.friction = DryFriction(self.bodies.drive.shape[1])
        stiffness = measure_stiffness(self.moment, self.terms, step, model.robot)
        self.substeps = substeps or stiffness.substeps(step, implicit=integrator == "semi-implicit")
        if not 0 < self.substeps <= MAX_SUBSTEPS:
            raise OptionError(
                f"steps of {step:g} s need {self.substeps} sub-steps, and at most {MAX_SUBSTEPS} are allowed; "
                f"give shorter steps, or use the integrator 'semi-implicit' for stiff laws"
            )
        self.stiff = stiffness.stiff(step / self.substeps)
        count = self.bodies.drive.shape[1]
        self.direct = np.array_equal(self.bodies.motor, np.arange(count))
        self.state = self.speed = self.before = np.zeros((copies, count))
        self.both = np.ones((2, copies, count))  # directions of motion
        self.both[1] = -1

    def start(self, q: Array, v: Array) -> None:
        """Set the state q (B, n) [rad or m], v (B, n) [rad/s or m/s]; elastic joints are in balance with the load."""
        self.state, self.speed = np.zeros((2, *self.moment.inertia.shape))
        self.state[:, self.bodies.motor], self.speed[:, self.bodies.motor] = q, v
        self.before = self.speed
        self.moment.rest()
        self.moment.inertia = self.dynamics.inertia(self.state)
        self.moment.set(0.0, self.step, self.state[None], self.speed[None], np.sign(self.speed)[None])
        for term in self.terms:
            if term.transmission:
                term.deflect(self.state)
            term.begin()

    def advance(self, t: float | Array, torque: Array) -> None:
        """Simulate one step from t () or (B,) [s] with constant motor torque (B, n) [N.m or N]."""
        force, dt = torque, self.step / self.substeps
        if not self.direct:
            force = np.zeros_like(self.state)
            force[:, self.bodies.motor] = torque
        self.before = self.speed
        move = self._runge_kutta if self.integrator == "rk4" else self._semi_implicit
        for k in range(self.substeps):
            move(t + k * dt, dt, force)

    @property
    def q(self) -> Array:  # (B, n) [rad or m]
        return self._joints(self.state)

    @property
    def v(self) -> Array:  # (B, n) [rad/s or m/s]
        return self._joints(self.speed)

    @property
    def a(self) -> Array:  # (B, n) [rad/s2 or m/s2], over the last step
        return self._joints((self.speed - self.before) / self.step)

    @property
    def link(self) -> Array:
        """Positions (B, n) of the links, behind elastic joints [rad or m]."""
        return self._links(self.state)

    @property
    def link_speed(self) -> Array:
        """Speeds (B, n) of the links, behind elastic joints [rad/s or m/s]."""
        return self._links(self.speed)

    def _links(self, signal: Array) -> Array:
        if self.direct:
            return signal
        found = self._joints(signal).copy()
        found[:, self.bodies.soft] += signal[:, self.bodies.flex]
        return found

    def _joints(self, signal: Array) -> Array:
        return signal if self.direct else np.asarray(signal[:, self.bodies.motor])

    def resist(self, t: float | Array, dt: float, q: Array, v: Array, direction: Array) -> Array:
        """Torque (R, B, c) of all laws for R trials [N.m or N] at t () or (B,) [s], before a step of dt [s].

        Trials are q (R, B, c) [rad or m], v (R, B, c) [rad/s or m/s] and direction (R, B, c) [1]; q and v may have one
        row for all of them.
        """
        self.moment.set(t, dt, q, v, direction)
        return total_torque(self.terms, direction.shape)

    def _semi_implicit(self, t: float | Array, dt: float, force: Array) -> None:
        after = self._sliding(t, dt, force)
        if after is None:
            after = self._boxed(t, dt, force)
        self._take(dt, self.state + dt * after, after, after)

    def _take(self, dt: float, q: Array, v: Array, mean: Array) -> None:
        """Set the state after a step; `mean` is the mean velocity in it."""
        self.moment.changed(self.speed, v, dt)
        self.state, self.speed = q, v
        for term in self.remembering:
            term.remember(mean)

    def _sliding(self, t: float | Array, dt: float, force: Array) -> Array | None:
        """Velocity after a step in which all joints slide; None if a joint stands or stops."""
        v, direction = self.speed, np.sign(self.speed)
        if self.dry and not v.all():
            return None
        if self.stiff:
            trials = self._trials(direction)
            total = self.resist(t, dt, *trials)
            here, armature = self._implicit(dt, total[0], total[1:])
        else:
            here, armature = self.resist(t, dt, self.state[None], v[None], direction[None])[0], None
        after: Array = v + dt * self.dynamics.accelerate(self.state, v, force - here, armature)
        if self.dry and (after * v).min() <= 0:
            return None
        return after

    def _boxed(self, t: float | Array, dt: float, force: Array) -> Array:
        """Velocity after a step with friction between its values for backward and forward motion."""
        q, v = self.state, self.speed
        low, high, armature = self._box(t, dt)
        friction = np.where(v > 0, high, low)  # the solver corrects it for a joint at rest
        after: Array = v + dt * self.dynamics.accelerate(q, v, force - friction, armature)
        stops = (high > low) & (after * v <= 0)
        if stops.any():
            rows = slice(None) if len(q) == 1 else np.flatnonzero(stops.any(axis=1))
            mobility = dt * self.dynamics.mobility(q[rows], None if armature is None else armature[rows])
            free = after[rows] + (mobility @ friction[rows, :, None])[..., 0]
            after[rows] = self.friction(free, low[rows], high[rows], mobility)
        return after

    def _box(self, t: float | Array, dt: float) -> tuple[Array, Array, Array | None]:
        """Smallest and largest torque of the laws, and the armature that makes stiff laws implicit, (B, c) each."""
        v = self.speed
        if self.stiff:
            q, speeds, direction = self._trials(np.where(v >= 0, 1.0, -1.0))
            first = [np.concatenate([x[:1], x]) for x in (q, speeds)]
            total = self.resist(t, dt, first[0], first[1], np.concatenate([self.both, direction[1:]]))
        else:
            total = self.resist(t, dt, self.state[None], v[None], self.both)
        high, low = total[0], total[1]
        here = np.where(v >= 0, high, low)
        dry = high >= low
        if not dry.all():  # where friction would drive, its value in this direction is used
            high, low = np.where(dry, high, here), np.where(dry, low, here)
        if not self.stiff:
            return low, high, None
        shifted, armature = self._implicit(dt, here, total[2:])
        return low + (shifted - here), high + (shifted - here), armature

    def _trials(self, direction: Array) -> tuple[Array, Array, Array]:
        """Trials q, v, direction (3, B, c): the state, with a small change of velocity, and of position."""
        q, v = np.empty((2, 3, *self.state.shape))
        q[:], v[:] = self.state, self.speed
        v[1] += LAW_STEP
        q[2] += LAW_STEP
        return q, v, np.repeat(direction[None], 3, axis=0)

    def _implicit(self, dt: float, here: Array, moved: Array) -> tuple[Array, Array]:
        """Torque (B, c) and armature (B, c) of laws that are evaluated at the end of the step."""
        damping, stiffness = np.maximum(0, (moved - here) / LAW_STEP)
        armature = dt * damping
        if not stiffness.any():
            return here, armature
        mobility = np.einsum("bjj->bj", self.dynamics.mobility(self.state))
        # below this excess, explicit steps are stable and conserve energy
        excess = np.maximum(0, stiffness - 1 / (dt**2 * mobility))
        return here + dt * self.speed * excess, armature + dt**2 * excess

    def _runge_kutta(self, t: float | Array, dt: float, force: Array) -> None:
        """Classic Runge-Kutta step; semi-implicit sub-steps for copies in which a joint stops or stands."""
        q, v, *_ = start = self._now()
        slopes, shares = [(v, self._slope(t, 0.0, q, v, force))], (0.5, 0.5, 1.0)
        for share in shares:
            dq, dv = slopes[-1]
            there = v + share * dt * dv
            slopes.append((there, self._slope(t + share * dt, share * dt, q + share * dt * dq, there, force)))
        dq, dv = ((s[0] + 2 * s[1] + 2 * s[2] + s[3]) / 6 for s in zip(*slopes, strict=True))
        after = v + dt * dv
        self.moment.set(t, dt, q[None], v[None], np.sign(v)[None])
        self._take(dt, q + dt * dq, after, dq)
        parted = (after * v).min(axis=1, keepdims=True) <= 0
        if self.dry and parted.any():
            whole = self._now()
            self._put(*start)
            for k in range(REVERSAL_SUBSTEPS):
                self._semi_implicit(t + k * dt / REVERSAL_SUBSTEPS, dt / REVERSAL_SUBSTEPS, force)
            (q, v, a, bent), mixed = self._now(), partial[Array](np.where, parted)
            self._put(mixed(q, whole[0]), mixed(v, whole[1]), mixed(a, whole[2]), [*map(mixed, bent, whole[3])])

    def _now(self) -> tuple[Array, Array, Array, list[Any]]:
        return self.state, self.speed, self.moment.a, [term.z for term in self.remembering]

    def _put(self, q: Array, v: Array, a: Array, memory: list[Any]) -> None:
        self.state, self.speed = q, v
        self.moment.changed(np.zeros_like(a), a, 1.0)
        for term, z in zip(self.remembering, memory, strict=True):
            term.z = z

    def _slope(self, t: float | Array, dt: float, q: Array, v: Array, force: Array) -> Array:
        taken = self.resist(t, dt, q[None], v[None], np.sign(self.speed)[None])[0]
        found = self.dynamics.accelerate(q, v, force - taken).copy()
        self.moment.changed(np.zeros_like(found), found, 1.0)
        return found


@dataclass(frozen=True, eq=False)
class Simulation(Result):
    """Ideal recorded signals of n joints at K instants, and the true motion."""

    joints: tuple[str, ...]
    t: Array  # (K,) [s]
    q: Array  # (K, n) recorded position [rad or m]
    tau: Array  # (K, n) recorded torque [N.m or N]
    desired: Array  # (K, n) desired position [rad or m]
    true_q: Array  # (K, n) of the motors [rad or m]
    true_v: Array  # (K, n) of the motors [rad/s or m/s]
    true_a: Array  # (K, n) of the motors [rad/s2 or m/s2]
    link_q: Array  # (K, n) of the links, behind elastic joints [rad or m]
    applied: Array  # (K, n) torque of the motors [N.m or N]


@typed
def simulate(
    model: ModelSource,
    drive: Drive,
    duration: float,
    *,
    step: float = 1e-3,
    integrator: str = "semi-implicit",
    substeps: int = 0,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate a model with all its laws, moved by a drive; signals are recorded without error at each step.

    >>> motion = signid.excite("3r", kind="random", duration=2.0).trajectory
    >>> signid.simulate("3r", signid.track("3r", motion), 2.0).q.shape
    (2000, 3)

    Recorded torque and acceleration belong to the same instant.

    Args:
        model: rigid bodies and laws of any kind; laws of drives replace gains of a controller at their joint.
        drive: controller, or given torque.
        duration: duration [s].
        step: step of the controller and of the recorded signals [s].
        integrator: `semi-implicit` or `rk4`.
        substeps: sub-steps per step; 0: as many as the stiffest law needs.
        progress: function that is called with the current step and the share of it that is done.

    Raises:
        OptionError: the duration, the step or a law cannot be simulated, or the simulation diverges.
    """
    model = as_model(model, "simulate")
    return simulate_many(
        model, [drive], duration, step=step, integrator=integrator, substeps=substeps, progress=progress
    )[0]


def simulate_many(
    model: Model,
    drives: Sequence[Drive],
    duration: float,
    *,
    step: float = 1e-3,
    integrator: str = "semi-implicit",
    substeps: int = 0,
    progress: Progress | None = None,
) -> list[Simulation]:
    """Simulate copies of a model at the same time, one for each drive; otherwise like `simulate`.

    Raises:
        OptionError: as `simulate`.
    """
    t = instants(duration, step)
    plant = Plant(model, step, len(drives), integrator, substeps)
    joints, reading = range(len(model.robot.joints)), model.of(RecordingLaw)
    acting, laws = model.of(ActuatorLaw), model.of(DriveLaw)
    plans = [drive.plan(t) for drive in drives]
    if laws and any(isinstance(drive, Torques) for drive in drives):
        raise OptionError(f"{laws[0].effect.name} acts on commanded positions; give a motion in place of torques")
    asked = np.stack([plan.desired for plan in plans], 1)
    plans = [commanded(laws, t, plan) for plan in plans] if laws else plans
    torque, desired, speed = (np.stack([getattr(p, key) for p in plans], 1) for key in ("torque", "desired", "speed"))
    stiffness, damping = (np.stack([getattr(p, key) for p in plans]) for key in ("stiffness", "damping"))
    motors = JointDrives(laws, stiffness, damping)
    beyond = [law.joints[0] for law in laws if law.effect.name == "link_encoder" and law.parameters["side"]]
    plant.start(*(np.stack(x) for x in zip(*(drive.start() for drive in drives), strict=True)))
    log = np.empty((7, len(t), len(drives), len(joints)))  # seen, q, v, a, link, command, applied
    for k, now in enumerate(t):
        q, v = plant.q, plant.v
        seen, felt = _encoder_positions(reading, q), v
        if beyond:
            seen, felt = seen.copy(), v.copy()
            seen[:, beyond], felt[:, beyond] = plant.link[:, beyond], plant.link_speed[:, beyond]
        command = torque[k] + stiffness * (desired[k] - seen) + damping * (speed[k] - felt)
        command = motors.torque(command, seen, felt, desired[k], speed[k], torque[k])
        applied = apply_actuators(acting, command)
        log[:3, k], log[4:, k] = (seen, q, v), (plant.link, command, applied)
        plant.advance(float(now), applied)
        log[3, k] = plant.a
        if k % 1000 == 0:
            _check_speed(plant, float(now))
            if progress is not None:
                progress("simulating", k / len(t))
    _check_speed(plant, float(t[-1]))
    late = 0.5 if integrator == "rk4" else (plant.substeps - 1) / (2 * plant.substeps)  # steps
    for row in (3, 5, 6):  # signals that are constant in a step belong to this later instant
        log[row, 1:] += late * (log[row, :-1] - log[row, 1:])
    return [_recorded(model, t, step, log[:, :, b], asked[:, b], reading) for b in range(len(drives))]


def instants(duration: float, step: float) -> Array:
    """Instants (K,) [s] at which steps begin.

    Raises:
        OptionError: there is none, or there are too many.
    """
    if not (np.isfinite(duration) and 0 < step <= duration):
        raise OptionError(f"{duration:g} s in steps of {step:g} s cannot be simulated; give at least one step")
    if duration / step > MAX_STEPS:
        raise OptionError(
            f"the simulation has {duration / step:.3g} steps, more than {MAX_STEPS:.0e}; give a shorter duration or "
            f"longer steps"
        )
    return np.asarray(np.arange(round(duration / step)) * step, dtype=np.float64)


def _encoder_positions(reading: Sequence[Law], q: Array) -> Array:
    """Positions (B, n) that the encoders measure."""
    for law in reading:
        j = list(law.joints)
        q = q.copy()
        q[:, j] = of_kind(law.effect, RecordingLaw).recorded_q(Trial(q[:, j]), **law.parameters)
    return q


def apply_actuators(acting: Sequence[Law], command: Array) -> Array:
    """Torque (..., n) that motors with actuator laws apply [N.m or N] at a command (..., n) [N.m or N]."""
    for law in acting:
        j = list(law.joints)
        command = command.copy()
        x = Trial(torque=command[..., j])
        command[..., j] = of_kind(law.effect, ActuatorLaw).applied_torque(x, **law.parameters)
    return command


def _check_speed(plant: Plant, t: float) -> None:
    if not np.all(np.abs(plant.v) < MAX_SPEED):
        raise OptionError(
            f"the simulation diverged within {t:.3g} s; use shorter steps, lower gains, or torque that fits the robot"
        )


def _recorded(model: Model, t: Array, step: float, log: Array, desired: Array, reading: Sequence[Law]) -> Simulation:
    recorded = log[5].copy()
    for law in reading:
        j = list(law.joints)
        x = Trial(log[0][:, j], log[2][:, j], t=t[:, None], dt=step, torque=recorded[:, j], joints=law.joints)
        recorded[:, j] = of_kind(law.effect, RecordingLaw).recorded_torque(x, **law.parameters)
    return Simulation(model.robot.joints, t, log[0], recorded, desired, log[1], log[2], log[3], log[4], log[6])


@dataclass(frozen=True, eq=False)
class Commands(Frozen):
    """Commanded positions of the drives of a model, each held until the next."""

    t: Array  # (K,) [s]
    desired: Array  # (K, n) [rad or m]
    q: Array  # (n,) initial position [rad or m]
    v: Array  # (n,) initial velocity [rad/s or m/s]

    def start(self) -> tuple[Array, Array]:
        """Initial position and velocity, (n,) each [rad, rad/s]."""
        return self.q, self.v

    def plan(self, t: Array) -> Plan:
        """Commands in force at t (K,) [s], and their speeds from row to row, without gains of a controller."""
        row = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, None)
        rates = np.diff(self.desired, axis=0) / np.diff(self.t)[:, None]
        speed = np.concatenate([np.zeros((1, len(self.q))), rates])[row]
        none = np.zeros_like(speed)
        return Plan(none, self.desired[row], speed, none[0], none[0])


def simulate_batch(
    model: Model,
    t: ArrayLike,
    start: tuple[ArrayLike, ArrayLike],
    torque: ArrayLike | None,
    commands: ArrayLike | None,
    step: float,
) -> Simulated:
    """Simulate motions, as `Model.simulate` documents; start: q and v (..., n) [rad, rad/s].

    Raises:
        OptionError: see there.
    """
    t = numbers_of("simulate", "t", t)
    if t.ndim != 1 or len(t) < 2 or not np.all(np.diff(t) > 0):
        raise OptionError(f"simulate: t has the shape {t.shape}, or does not increase; give instants (K,) in s")
    if torque is not None and commands is not None:
        raise OptionError("simulate: torque and commands both drive the joints; give one of them")
    n = len(model.robot.joints)
    given = np.zeros((len(t), n)) if torque is None else numbers_of("simulate", "torque", torque)
    given = given if commands is None else numbers_of("simulate", "commands", commands)
    if given.shape[-2:] != (len(t), n):
        name = "torque" if commands is None else "commands"
        raise OptionError(f"simulate: {name} has the shape {given.shape}; give (..., {len(t)}, {n}), a row per instant")
    driven = {law.joints[0] for law in model.of(DriveLaw)}
    if commands is not None and (free := [x for j, x in enumerate(model.robot.joints) if j not in driven]):
        raise OptionError(f"simulate: {free[0]} of the model has no position drive; give torque, or identify drives")
    states, own = rows_of(model.robot, "simulate", q=start[0], v=start[1])
    try:
        batch = np.broadcast_shapes(own, given.shape[:-2])
    except ValueError:
        raise OptionError(f"simulate: q has the rows {own}, and the input {given.shape[:-2]}; give the same") from None
    q, v = (np.broadcast_to(x.reshape(*own, n), (*batch, n)).reshape(-1, n) for x in states)
    inputs = np.broadcast_to(given, (*batch, len(t), n)).reshape(-1, len(t), n)
    kind, acting = (Torques, torque_model(model)) if commands is None else (Commands, model)
    drives = [kind(t - t[0], *each) for each in zip(inputs, q, v, strict=True)]
    shape = (*batch, len(t), n)
    if not drives:
        return Simulated(*np.zeros((3, *shape)))
    moved = simulate_many(acting, drives, float(t[-1] - t[0]) + 2 * step, step=step)
    q, v, applied = (np.stack([getattr(x, key) for x in moved]) for key in ("true_q", "true_v", "applied"))
    at = moved[0].t
    found = (CubicHermiteSpline(at, q, v, axis=1), *(make_interp_spline(at, x, k=1, axis=1) for x in (v, applied)))
    return Simulated(*(curve(t - t[0]).reshape(shape) for curve in found))
