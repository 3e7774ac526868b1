"""Motion of a robot, and its regressor: columns of bodies and laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..effects.law import coefficient_count, law_columns
from ..errors import OptionError
from ..robot import configuration, weld
from ..robot.dynamics import (
    Sensitivity,
    body_regressor,
    effective_inertia,
    gravity_torque,
    moved_bodies,
    own_body,
    rigid_torque,
    sensitivity,
    tip_jacobian,
)
from ..types import INERTIAL, INERTIAL_UNITS, Array, Frozen, Indices, Label, Law, Mask, Robot, Samples, View
from .bandwidth import DIFFERENCE_REACH, Band, Decimator, differentiate, smooth

TURN_ANGLES = 2 * np.pi * np.arange(5) / 5  # [rad] angles that determine a trigonometric polynomial of degree 2
CONSTANT_ANGLE_SPREAD = 1e-12  # [rad] spread of an angle that is constant but for rounding
UNFILTERED = Decimator(np.ones(1), 1)


@dataclass(frozen=True, eq=False)
class Motion(Frozen):
    """Motion of n joints at N uniform samples, as laws use it."""

    robot: Robot
    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    a: Array  # (N, n) [rad/s2 or m/s2]
    recorded: Array | None = None  # (N, n) measured torque [N.m or N], NaN where absent
    predicted: Array | None = None  # (N, n) torque [N.m or N] that the model predicts
    slow: Array | None = None  # (n,) [rad/s or m/s] speed below which the direction of motion is uncertain
    origin: float = 0.0  # [s] time stamp of the start of the recording, if it is far from 0

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, which: slice) -> Motion:
        """Motion at a slice of the samples."""
        signals = {key: getattr(self, key) for key in ("t", "q", "v", "a", "recorded", "predicted")}
        return replace(self, **{key: x[which] for key, x in signals.items() if x is not None})

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float(self.t[1] - self.t[0]) if len(self.t) > 1 else 0.0

    @cached_property
    def configuration(self) -> Array:
        """Pinocchio's configurations (N, nq) [rad, m or 1]."""
        return configuration(self.robot, self.q)

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """Pinocchio's velocities and accelerations, (N, nv) each [rad/s, rad/s2]."""
        drive = self.robot.drive.T
        return self.v @ drive, self.a @ drive

    @cached_property
    def direction(self) -> Array:
        """Direction of motion (N, n) [1]: sign of the velocity, proportional to it below `slow`."""
        return np.sign(self.v) if self.slow is None else np.clip(self.v / self.slow, -1, 1)

    @cached_property
    def load(self) -> Array:
        """Rigid-body torque (N, n) of the description's inertials [N.m or N]."""
        return rigid_torque(self.robot, self.configuration, *self.rates)

    @cached_property
    def inertia(self) -> Array:
        """Diagonal (N, n) of the joint-space mass matrix [kg.m2 or kg]."""
        return effective_inertia(self.robot, self.configuration)

    @cached_property
    def jacobian(self) -> Array:
        """Jacobian (N, 3, n) of the last link's centre of mass, in world axes [m/rad or 1]."""
        return tip_jacobian(self.robot, self.configuration)

    @cached_property
    def sensitivity(self) -> Sensitivity:
        """Derivatives of the rigid-body torque with respect to position, velocity and acceleration."""
        return sensitivity(self.robot, self.configuration, *self.rates)

    @cached_property
    def bodies(self) -> Array:
        """Regressor (N, n, nb, 10) of all bodies [N.m or N per kg, kg.m, kg.m2]."""
        return body_regressor(self.robot, self.configuration, *self.rates)

    @cached_property
    def moved(self) -> Mask:
        """Mask (n, nb) of the bodies that each joint moves."""
        return moved_bodies(self.robot)

    def coupled(self, joint: int) -> list[int]:
        """Joints whose torque depends on the motion of a joint: both move a common body."""
        return np.flatnonzero(self.moved[:, self.moved[joint]].any(axis=1)).tolist()

    def body_columns(self, joint: int) -> Array:
        """Regressor (N, n, 10) of the body that a joint moves [N.m or N per kg, kg.m, kg.m2]."""
        return np.asarray(self.bodies[:, :, own_body(self.robot, joint)])

    def gravity_torque(self, gravity: Array) -> Array:
        """Torque (N, n) that holds the robot in a field of gravity (3,) [m/s2], [N.m or N]."""
        return gravity_torque(self.robot, self.configuration, gravity)

    def shift(self, joint: int, change: Array, *, exactly: bool = False) -> Array:
        """Change of torque (N, n) [N.m or N] if the link of a joint moved at q + change (N,) [rad or m] instead of q.

        If `exactly`: `load` minus the load at q - change, instead of the derivative at q.
        """
        if exactly:
            return self.load - self._load_at(joint, change)
        first, second = _derivatives(change, self.dt)
        rows, out = self.coupled(joint), np.zeros_like(self.q)
        along = Sensitivity(*(x[:, rows, joint] for x in self.sensitivity))
        out[:, rows] = (
            along.position * change[:, None] + along.velocity * first[:, None] + along.acceleration * second[:, None]
        )
        return out

    def _load_at(self, joint: int, change: Array) -> Array:
        """`load` (N, n) [N.m or N] with one joint at q - change (N,) [rad or m]."""
        alone = not self.robot.prismatic[joint] and np.count_nonzero(self.robot.drive[:, joint]) == 1
        if alone and np.ptp(change) < CONSTANT_ANGLE_SPREAD:
            angle = change[0] + TURN_ANGLES
            weights = (1 + 2 * np.cos(angle) + 2 * np.cos(2 * angle)) / len(TURN_ANGLES)
            return np.asarray(np.tensordot(weights, self._turned(joint), 1))
        moved = np.outer((change, *_derivatives(change, self.dt)), np.eye(self.q.shape[1])[joint])
        q, v, a = np.array((self.q, self.v, self.a)) - moved.reshape(3, *self.q.shape)
        return replace(self, q=q, v=v, a=a).load

    def _turned(self, joint: int) -> Array:
        """`load` (5, N, n) [N.m or N] with one joint turned by TURN_ANGLES everywhere.

        Inertias are quadratic in the rotation of a joint, and so is the torque, a trigonometric polynomial of degree 2
        of a constant angle: five loads give all others.
        """
        if joint not in self._turned_loads:
            moved = TURN_ANGLES[:, None, None] * np.eye(self.q.shape[1])[joint]
            self._turned_loads[joint] = np.array([replace(self, q=self.q + x).load for x in moved])
        return self._turned_loads[joint]

    @cached_property
    def _turned_loads(self) -> dict[int, Array]:
        return {}

    def at(self, joints: Sequence[int]) -> View:
        """View of some joints, for a law that acts there."""
        return MotionView(self, tuple(joints))


class _Signal:
    """Signal of a motion at the samples and joints of a view."""

    def __set_name__(self, view: type, name: str) -> None:
        self.name = name

    def __get__(self, view: MotionView, _: type) -> Array:
        return view.cut(getattr(view.whole, self.name))


class MotionView:
    """View of some joints of a motion; costly quantities are computed on first use."""

    q, v, a = _Signal(), _Signal(), _Signal()
    direction, load, inertia = _Signal(), _Signal(), _Signal()

    def __init__(self, whole: Motion, joints: tuple[int, ...], samples: Any = slice(None)) -> None:
        self.whole, self.joints, self.samples, self.dt = whole, joints, samples, whole.dt

    def cut(self, signal: Array) -> Array:
        """A signal (N, n) [any unit] at the samples and joints of the view."""
        return np.asarray(signal[self.samples][..., list(self.joints)])

    @property
    def t(self) -> Array:  # (..., 1) [s]
        return np.asarray(self.whole.t[:, None][self.samples])

    @property
    def origin(self) -> float:  # [s]
        return self.whole.origin

    @property
    def torque(self) -> Array:
        return self.load if self.whole.predicted is None else self.cut(self.whole.predicted)

    @property
    def recorded(self) -> Array:
        """Torque as measured, (..., m) [N.m or N].

        Raises:
            OptionError: the motion has no measured torque.
        """
        if self.whole.recorded is None:
            raise OptionError("this law needs the measured torque, and the motion has none; give a recording")
        return self.cut(self.whole.recorded)

    def __getitem__(self, i: Any) -> View:
        return MotionView(self.whole, self.joints, i)


def margin(band: Band, recorded_derivatives: bool = False) -> int:
    """Number of samples that `build_motion` removes at either end."""
    return 0 if recorded_derivatives else len(band.position_taps) // 2 + DIFFERENCE_REACH


def build_motion(
    robot: Robot,
    samples: Samples,
    band: Band,
    period: float,
    recorded_derivatives: bool = False,
    slow: Array | None = None,
) -> Motion:
    """Motion of a stretch of samples, `margin` samples shorter at either end.

    Positions are low-passed by a symmetric FIR filter and differentiated by nine-point differences, or derivatives are
    taken as recorded. Torque stays as recorded: regressor columns and torque pass the same filter later. Below the
    speed slow (n,) [rad/s or m/s] the direction of motion is uncertain.

    Raises:
        OptionError: recorded derivatives are requested, and the recording has none.
    """
    if recorded_derivatives:
        if samples.dq is None or samples.ddq is None:
            raise OptionError(
                "recorded derivatives were requested, and the recording lacks dq_J or ddq_J columns; use computed ones"
            )
        return Motion(
            robot, samples.t, samples.q, samples.dq, samples.ddq, samples.tau, slow=slow, origin=samples.origin
        )
    smoothed = smooth(samples.q, band.position_taps)
    v, a = differentiate(smoothed, period)
    cut = margin(band)
    inner = slice(cut, len(samples.t) - cut)
    q = smoothed[DIFFERENCE_REACH : len(smoothed) - DIFFERENCE_REACH]
    return Motion(robot, samples.t[inner], q, v, a, samples.tau[inner], slow=slow, origin=samples.origin)


def _derivatives(x: Array, dt: float) -> tuple[Array, Array]:
    """First and second derivatives (N,) by central differences; the ends repeat their neighbours."""
    first, second = np.gradient(x, dt), np.zeros_like(x)
    if len(x) > 2:
        second[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) / dt**2
        second[[0, -1]] = second[[1, -2]]
    return first, second


def regressor(motion: Motion, laws: Sequence[Law] = ()) -> Array:
    """Full regressor (N, n, p): ten columns per body, then one per coefficient of the laws.

    Torque = regressor @ standard parameters [N.m or N]. For long motions `base_rows` takes less memory.
    """
    robot = motion.robot
    rigid = motion.bodies.reshape(len(motion), len(robot.joints), 10 * len(robot.links))
    wide = np.zeros((len(motion), len(robot.joints), sum(coefficient_count(law) for law in laws)))
    at = 0
    for law in laws:
        rows, torque = law_columns(law, motion)
        wide[:, list(rows), at : at + torque.shape[2]] = torque
        at += torque.shape[2]
    return np.concatenate([rigid, wide], axis=2)


def labels(robot: Robot, laws: Sequence[Law] = ()) -> tuple[Label, ...]:
    """Label of each standard parameter: bodies by their index in the model (from 1), laws by their joint's number."""
    result = [
        Label(f"{name}_{body + 1}", unit, body=body)
        for body in range(len(robot.links))
        for name, unit in zip(INERTIAL, INERTIAL_UNITS, strict=True)
    ]
    for k, law in enumerate(laws):
        where = "_".join(str(robot.numbers[j]) for j in law.joints)
        coefficients = law.effect.regressors or law.effect.linear()
        for key, coefficient in coefficients.items():
            name = law.effect.name if len(coefficients) == 1 else f"{law.effect.name}.{key}"
            joint = law.joints[0]
            unit = coefficient.unit_at(bool(robot.prismatic[joint]))
            result.append(Label(f"{name}_{where}", unit, law=k, joint=joint, positive=coefficient.positive))
    return tuple(result)


def base_rows(
    motion: Motion,
    laws: Sequence[Law],
    wanted: Sequence[Indices],
    thin: Decimator | None = None,
    sparse: tuple[Motion, Decimator] | None = None,
) -> list[Array]:
    """Columns `wanted[j]` (N, m_j) of the regressor's rows of each joint j: indices of standard parameters, ascending.

    The filter `thin` decimates the columns, which then are (M, m_j). The columns of bodies are computed from `sparse`,
    a decimated motion and its filter for the same rows, if there is one.
    """
    thin, rigid = thin or UNFILTERED, 10 * len(motion.robot.links)
    split = [int(np.searchsorted(columns, rigid)) for columns in wanted]
    inertial = [columns[:k] for columns, k in zip(wanted, split, strict=True)]
    bodies = _rigid_rows(*(sparse or (motion, thin)), inertial)
    further = law_rows(motion, laws, [columns[k:] - rigid for columns, k in zip(wanted, split, strict=True)])
    parts = np.split(thin(np.concatenate(further, axis=1)), _part_ends(further), axis=1)
    return [np.concatenate(pair, axis=1) for pair in zip(bodies, parts, strict=True)]


def law_rows(motion: Motion, laws: Sequence[Law], wanted: Sequence[Indices]) -> list[Array]:
    """Columns (N, m_j) of the laws' coefficients for each joint; coefficients are counted from 0."""
    out = [np.zeros((len(motion), len(columns))) for columns in wanted]
    at, taken = 0, [(j, i) for j, columns in enumerate(wanted) for i in range(len(columns))]
    for law in laws:
        count = coefficient_count(law)
        ours = [(j, i) for j, i in taken if 0 <= wanted[j][i] - at < count]
        if ours:
            rows, torque = law_columns(law, motion)
            for j, i in ours:
                if j in rows:
                    out[j][:, i] = torque[:, rows.index(j), wanted[j][i] - at]
        at += count
    return out


class _Bodies(NamedTuple):
    """Moving bodies, and the places of their rows and columns in the regressor of the whole model."""

    model: Any
    states: tuple[Array, Array, Array]  # (N, nq) [rad, m or 1], (N, nv) [rad/s or m/s], (N, nv) [rad/s2 or m/s2]
    rows: Indices  # (nv,)
    columns: Indices  # (10 nb,)


def _rigid_rows(motion: Motion, thin: Decimator, wanted: Sequence[Indices]) -> list[Array]:
    """Columns (M, m_j) of the bodies' inertial parameters for each joint."""
    part, drive = _wanted_bodies(motion, wanted), motion.robot.drive
    pairs = [(int(row), j) for j in range(len(wanted)) for row in np.flatnonzero(drive[:, j])]
    inside = [np.searchsorted(part.columns, columns) for columns in wanted]
    width, row_of = len(part.columns), {int(row): k for k, row in enumerate(part.rows)}
    places = [row_of[row] * width + inside[j] for row, j in pairs]
    found = thin.gather(_rigid_blocks(part, np.concatenate(places), thin.segment), len(motion), sum(map(len, places)))
    out: list[Array] = [np.zeros(0)] * len(wanted)
    for (row, j), columns in zip(pairs, np.split(found, _part_ends(places), axis=1), strict=True):
        share = columns if drive[row, j] == 1 else columns * drive[row, j]
        out[j] = out[j] + share if out[j].ndim == 2 else share
    return out


def _part_ends(parts: Sequence[Array | Indices]) -> list[int]:
    """Ends of parts that are concatenated along their last axis, without the last end."""
    return [int(end) for end in np.cumsum([part.shape[-1] for part in parts])[:-1]]


def _wanted_bodies(motion: Motion, wanted: Sequence[Indices]) -> _Bodies:
    """Model without its fixed joints, unless a column of a body that one of them carries is wanted."""
    model, q, (v, a) = motion.robot.model, motion.configuration, motion.rates
    spans = [(joint.idx_q, joint.nq, joint.idx_v, joint.nv) for joint in list(model.joints)[1:]]
    moves = np.array([bool(motion.robot.drive[v0 : v0 + nv].any()) for _, _, v0, nv in spans])
    if not len(motion) or not moves[np.concatenate(wanted) // 10].all():
        moves[:] = True
    kept = [span for span, moving in zip(spans, moves, strict=True) if moving]
    slim = model if moves.all() else _welded(motion.robot, tuple((np.flatnonzero(~moves) + 1).tolist()))
    places = np.concatenate([np.arange(q0, q0 + nq) for q0, nq, _, _ in kept])
    rows = np.concatenate([np.arange(v0, v0 + nv) for _, _, v0, nv in kept])
    return _Bodies(slim, (q[:, places], v[:, rows], a[:, rows]), rows, np.flatnonzero(np.repeat(moves, 10)))


@lru_cache(maxsize=4)
def _welded(robot: Robot, held: tuple[int, ...]) -> Any:
    """Model whose joints `held`, counted from 1, are merged with their parents; every window uses it."""
    return weld(robot.model, held, configuration(robot, np.zeros(len(robot.joints))))


def _rigid_blocks(part: _Bodies, places: Indices, size: int) -> Iterator[Array]:
    """Entries `places` (c,) of Pinocchio's flattened regressor, as blocks (k, c) of k = `size` samples.

    All blocks share one buffer.
    """
    model, data, compute = part.model, part.model.createData(), pin.computeJointTorqueRegressor
    buffer = np.empty((min(size, len(part.states[0])), len(places)))
    for start in range(0, len(part.states[0]), size):
        states = [x[start : start + size] for x in part.states]
        rows = buffer[: len(states[0])]
        for row, found in zip(rows, map(compute, repeat(model), repeat(data), *states), strict=True):
            found.take(places, out=row, mode="clip")
        yield rows
