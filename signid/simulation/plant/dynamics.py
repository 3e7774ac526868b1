"""Rigid bodies of the plant: equations of motion, and dry friction that can hold a joint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ...effects.base import TransmissionLaw
from ...errors import OptionError, RobotError
from ...model import Model
from ...robot import configuration, weld
from ...robot.dynamics import joint_of_row, mass_matrices, own_row, point_jacobian
from ...types import Array, Frozen, Indices, Mask, Robot

SOLVER_ITERATIONS, SOLVER_TOLERANCE = 200, 1e-10  # of Pinocchio's solver; the tolerance is absolute
MAX_GUESSES = 12  # guesses of the held joints before Pinocchio's solver is used
THREADS = 1  # threads of abaInParallel; on a loaded machine several threads wait for each other for milliseconds
BOUNDED_MODELS = {"RUBX": pin.JointModelRX, "RUBY": pin.JointModelRY, "RUBZ": pin.JointModelRZ}


class DryFriction:
    """Velocity after a step with friction in a box [low, high] that opposes motion.

    Source: maximum dissipation. One robot is solved by Pinocchio's projected Gauss-Seidel (Carpentier, Le Lidec,
    Montaut, From Compliant to Rigid Contact Simulation, RSS 2024), several by guesses of their held joints.
    """

    def __init__(self, count: int) -> None:
        model, joints = pin.Model(), pin.StdVec_Index()
        for i in range(count):
            joints.append(model.addJoint(i, pin.JointModelRX(), pin.SE3.Identity(), f"{i}"))
        self.constraint = pin.JointFrictionConstraintModel(model, joints)
        self.solver, self.result = pin.PGSConstraintSolver(count), pin.PGSSolverResult()
        self.settings = settings = pin.PGSSolverSettings()  # precise to nearly rounding errors
        settings.max_iterations = SOLVER_ITERATIONS
        settings.absolute_complementarity_tol = settings.absolute_feasibility_tol = SOLVER_TOLERANCE
        settings.relative_complementarity_tol = settings.relative_feasibility_tol = SOLVER_TOLERANCE / 100

    def __call__(self, free: Array, low: Array, high: Array, mobility: Array) -> Array:
        """Velocities (K, c), exactly zero for held joints [rad/s or m/s].

        Without friction they would be free (K, c) [rad/s or m/s]. Friction is from low (K, c) [N.m or N] to
        high (K, c) [N.m or N]; its mobility (K, c, c) [rad/(N.m.s) or m/(N.s)] is the velocity that it adds in a step.
        """
        if len(free) == 1:
            return self._solve(free[0], low[0], high[0], mobility[0])[None]
        velocity, unsettled = _guess(free, low, high, mobility)
        for i in np.flatnonzero(unsettled):
            velocity[i] = self._solve(free[i], low[i], high[i], mobility[i])
        return velocity

    def _solve(self, free: Array, low: Array, high: Array, mobility: Array) -> Array:
        self.constraint.setFrictionLowerLimit(-high)
        self.constraint.setFrictionUpperLimit(-low)
        models, states = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
        models.append(pin.ConstraintModel(self.constraint))
        states.append(pin.ConstraintData(self.constraint.createData()))
        operator = pin.DelassusOperatorDense(mobility)
        self.solver.solve(operator, free, models, states, self.settings, self.result)
        friction = -np.array(self.result.retrieveConstraintImpulses())
        held = (friction > low) & (friction < high)
        return np.where(held, 0.0, free - mobility @ friction)


def _guess(free: Array, low: Array, high: Array, mobility: Array) -> tuple[Array, Mask]:
    """Velocity (K, c), and the rows (K,) whose guess did not converge.

    A joint is held (0), or slides forward (1) or backward (-1). Held joints whose friction leaves the box slide.
    Sliding joints that friction would drive are held.
    """
    dry, unit = high > low, np.eye(free.shape[1])
    way = np.where(dry, 0, 1)
    for _ in range(MAX_GUESSES):
        held = way == 0
        sliding = np.where(way > 0, high, np.where(held, 0.0, low))
        both = held[:, :, None] & held[:, None, :]
        missing = np.where(held, free - np.einsum("kij,kj->ki", mobility, sliding), 0.0)
        friction = sliding + np.linalg.solve(np.where(both, mobility, unit), missing[..., None])[..., 0]
        velocity = np.where(held, 0.0, free - np.einsum("kij,kj->ki", mobility, friction))
        slips = np.where(friction > high, 1, np.where(friction < low, -1, 0))
        better = np.where(held, slips, np.where(dry & (way * velocity < 0), 0, way))
        changed = (better != way).any(axis=1)
        if not changed.any():
            break
        way = better
    return velocity, changed


@dataclass(frozen=True, eq=False)
class PlantBodies(Frozen):
    """Bodies with c coordinates: one per joint, and the deflection of each elastic joint.

    Model position = drive @ coordinates + rest. If the coordinates are those of the model, drive is the identity.
    """

    model: Any  # pin.Model with the rotors' armature
    motor: Indices  # (n,) coordinate of each joint
    soft: Indices  # (k,) elastic joints
    flex: Indices  # (k,) coordinates of their deflections
    drive: Array  # (nv, c) [1]
    rest: Array  # (nv,) [rad or m]
    tip: int  # joint of the model that carries the last link
    centre: Array  # (3,) centre of mass of the last link, in that joint's frame [m]

    @property
    def plain(self) -> bool:
        """Whether the coordinates are those of the model."""
        nv, count = self.drive.shape
        return nv == count and np.array_equal(self.drive, np.eye(nv)) and not self.rest.any()


def build_bodies(model: Model) -> PlantBodies:
    """Bodies of a model with its body laws; each joint with a transmission law is split into motor and link side.

    Raises:
        OptionError: a transmission law cannot act at its joint.
    """
    robot, whole, elastic = model.robot, model.bodies(), model.of(TransmissionLaw)
    soft = [law.joints[0] for law in elastic]
    for law in elastic:
        joint, followers = robot.joints[law.joints[0]], np.flatnonzero(robot.drive[:, law.joints[0]])
        if len(followers) > 1:
            raise OptionError(
                f"{law.effect.name} cannot act at {joint}, since other joints follow it; simulate without that law"
            )
        if not whole.armature[followers[0]] > 0:
            raise OptionError(
                f"{law.effect.name} at {joint} needs the inertia of the motor: add armature@{joint}:inertia=0.1, "
                f"or state it in an actuators file"
            )
    if len(set(soft)) < len(soft):
        raise OptionError("two transmission laws act at one joint; give at most one per joint")
    kept, rows = _without_held(robot, whole)
    parted, motor_rows, flex_rows = _with_flex(kept, [int(np.flatnonzero(robot.drive[rows][:, j])[0]) for j in soft])
    drive = np.zeros((parted.nv, len(robot.joints) + len(soft)))
    drive[motor_rows, : len(robot.joints)] = robot.drive[rows]
    drive[flex_rows, len(robot.joints) + np.arange(len(soft))] = 1
    rest = np.zeros(parted.nv)
    rest[motor_rows] = robot.rest[rows]
    order = np.arange(drive.shape[1])
    if parted.nv == len(order) and np.array_equal(np.sort(drive, axis=None)[-len(order) :], np.ones(len(order))):
        order = drive.argmax(axis=1)  # coordinates in the order of the model's own
    place = np.argsort(order)
    n = len(robot.joints)
    last = own_row(robot, n - 1)
    tip = flex_rows[soft.index(n - 1)] if n - 1 in soft else motor_rows[rows.tolist().index(last)]
    return PlantBodies(
        parted,
        place[:n],
        np.array(soft, dtype=np.intp),
        place[n:],
        drive[:, order],
        rest,
        joint_of_row(parted, tip),
        whole.inertias[joint_of_row(whole, last)].lever,
    )


def _without_held(robot: Robot, model: Any) -> tuple[Any, Indices]:
    """Model without held joints, and the velocity indices of the remaining joints."""
    spans = [(i, j.idx_v, j.nv) for i, j in enumerate(list(model.joints)[1:], 1)]
    held = [i for i, row, nv in spans if not robot.drive[row : row + nv].any()]
    rows = np.array([r for i, row, nv in spans if i not in held for r in range(row, row + nv)], dtype=np.intp)
    armature = model.armature.copy()
    if held:
        model = weld(model, held, configuration(robot, np.zeros(len(robot.joints))))
    model.armature = armature[rows]
    return model, rows


def _with_flex(model: Any, soft: Sequence[int]) -> tuple[Any, list[int], list[int]]:
    """Model with an additional joint behind each of some joints, and the indices of the motor and the flex joints."""
    new, ids = pin.Model(), [0]
    new.gravity = model.gravity
    motor, flex = [0] * model.nv, dict[int, int]()
    for i in range(1, model.njoints):
        joint = _angle_joint(model.joints[i])
        at = new.addJoint(ids[model.parents[i]], joint, model.jointPlacements[i], model.names[i])
        row = model.joints[i].idx_v
        for k in range(model.joints[i].nv):
            motor[row + k] = new.joints[at].idx_v + k
        if row in soft:
            at = new.addJoint(at, joint, pin.SE3.Identity(), model.names[i] + "_flex")
            flex[row] = new.joints[at].idx_v
        new.appendBodyToJoint(at, model.inertias[i], pin.SE3.Identity())
        ids.append(at)
    armature = np.zeros(new.nv)
    armature[motor] = model.armature
    new.armature = armature
    return new, motor, [flex[row] for row in soft]


def _angle_joint(joint: Any) -> Any:
    """The joint with its angle as configuration, if that was cosine and sine."""
    if joint.nq == joint.nv:
        return joint
    name = joint.shortname().removeprefix("JointModel")
    if name in BOUNDED_MODELS:
        return BOUNDED_MODELS[name]()
    return pin.JointModelRevoluteUnaligned(joint.extract().axis)


class Dynamics:
    """Pinocchio's dynamics for B copies of the same bodies in different states; it owns the models' data."""

    def __init__(self, bodies: PlantBodies, copies: int) -> None:
        self.bodies, self.model, self.data = bodies, bodies.model, bodies.model.createData()
        self.armature = bodies.model.armature.copy()
        self.bare = bodies.model.copy()
        self.bare.armature = np.zeros(bodies.model.nv)
        self.bare_data, self.plain = self.bare.createData(), bodies.plain
        self.below = np.tri(bodies.model.nv, k=-1, dtype=bool)  # entries that Pinocchio leaves out
        self.pool = pin.ModelPool(self.model, THREADS) if copies > 1 and self.plain else None

    def accelerate(self, q: Array, v: Array, force: Array, armature: Array | None = None) -> Array:
        """Accelerations (B, c) [rad/s2 or m/s2] by the articulated-body algorithm.

        Given are q (B, c) [rad or m], v (B, c) [rad/s or m/s] and the force (B, c) along the coordinates [N.m or N].
        An armature (B, c) [kg.m2 or kg] is added in this call.
        """
        if not self.plain:
            return self._project(q, v, force, armature)
        model, data = self.model, self.data
        if armature is None:
            if len(q) == 1:
                return np.asarray(pin.aba(model, data, q[0], v[0], force[0]))[None]  # valid until the next call
            return np.reshape(pin.abaInParallel(THREADS, self.pool, q.T, v.T, force.T), q.T.shape).T  # 1-D where c = 1
        out = np.empty_like(v)
        for i, row in enumerate(armature):
            model.armature = self.armature + row
            out[i] = pin.aba(model, data, q[i], v[i], force[i])
        model.armature = self.armature
        return out

    def mobility(self, q: Array, armature: Array | None = None) -> Array:
        """Inverses (B, c, c) of the mass matrix [1/(kg.m2) or 1/kg] at q (B, c) [rad or m].

        An armature (B, c) [kg.m2 or kg] is added in this call.
        """
        if not self.plain:
            return _refuse_singular(np.linalg.inv, self._mass(q, armature))
        model, data, out = self.model, self.data, np.empty((*q.shape, q.shape[1]))
        for i, row in enumerate(q):
            if armature is not None:
                model.armature = self.armature + armature[i]
            out[i] = pin.computeMinverse(model, data, row)
        if armature is not None:
            model.armature = self.armature
        return np.where(self.below, out.transpose(0, 2, 1), out)

    def load(self, q: Array, v: Array, a: Array) -> Array:
        """Torque (B, c) of the bodies without their rotors [N.m or N].

        Given are q (B, c) [rad or m], v (B, c) [rad/s or m/s] and a (B, c) [rad/s2 or m/s2].
        """
        drive, rest = self.bodies.drive, self.bodies.rest
        out = np.empty_like(q)
        for i in range(len(q)):
            state = (q[i], v[i], a[i]) if self.plain else (drive @ q[i] + rest, drive @ v[i], drive @ a[i])
            torque = pin.rnea(self.bare, self.bare_data, *state)
            out[i] = torque if self.plain else drive.T @ torque
        return out

    def inertia(self, q: Array) -> Array:
        """Diagonal (B, c) of the mass matrix without the rotors [kg.m2 or kg] at q (B, c) [rad or m]."""
        rotors = np.einsum("rc,r,rc->c", self.bodies.drive, self.armature, self.bodies.drive)
        return np.asarray(np.einsum("bcc->bc", self._mass(q)) - rotors)

    def jacobian(self, q: Array) -> Array:
        """Jacobian (B, 3, n) of the last link's centre of mass [m/rad or 1] at q (B, c) [rad or m]."""
        drive, rest, last = self.bodies.drive, self.bodies.rest, (self.bodies.tip, self.bodies.centre)
        rows = [point_jacobian(self.model, self.data, drive @ row + rest, *last) @ drive for row in q]
        return np.array(rows)[:, :, self.bodies.motor]

    def _mass(self, q: Array, armature: Array | None = None) -> Array:
        """Mass matrix (B, c, c) over the coordinates [kg.m2 or kg]."""
        drive = self.bodies.drive
        mass = mass_matrices(self.model, self.data, q @ drive.T + self.bodies.rest, drive)
        return mass if armature is None else mass + armature[:, None] * np.eye(len(drive.T))

    def _project(self, q: Array, v: Array, force: Array, armature: Array | None) -> Array:
        """Accelerations from the equations of motion over the coordinates, for coupled joints."""
        drive, model, data = self.bodies.drive, self.model, self.data
        states = zip(q @ drive.T + self.bodies.rest, v @ drive.T, strict=True)
        bias = np.array([pin.nonLinearEffects(model, data, *state).copy() for state in states]).reshape(len(q), -1)
        return _refuse_singular(np.linalg.solve, self._mass(q, armature), (force - bias @ drive)[..., None])[..., 0]


def _refuse_singular(compute: Callable[..., Array], *given: Array) -> Array:
    try:
        return compute(*given)
    except np.linalg.LinAlgError:
        raise RobotError(
            "the mass matrix is singular in some pose: a link has no inertia, or infeasible inertials; give the links "
            "feasible inertials, or the joints an armature"
        ) from None
