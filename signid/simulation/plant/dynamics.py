"""Forward dynamics of bodies by Pinocchio, for one or several copies of a robot."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from ...errors import RobotError
from ...robot.dynamics import mass_matrices, point_jacobian
from ...types import Array
from .bodies import PlantBodies

THREADS = 1  # threads of abaInParallel; on a loaded machine several threads wait for each other for milliseconds


class Dynamics:
    """Pinocchio's dynamics for B copies of the same bodies in different states; it owns the models' data."""

    def __init__(self, bodies: PlantBodies, copies: int) -> None:
        self.bodies, self.model, self.data = bodies, bodies.model, bodies.model.createData()
        self.armature = bodies.model.armature.copy()
        self.bare = bodies.model.copy()
        self.bare.armature = np.zeros(bodies.model.nv)
        self.bare_data, self.plain = self.bare.createData(), bodies.plain
        self.below = np.tri(
            bodies.model.nv, k=-1, dtype=bool
        )  # entries that Pinocchio leaves out of symmetric matrices
        self.pool = pin.ModelPool(self.model, THREADS) if copies > 1 and self.plain else None

    def accelerate(self, q: Array, v: Array, force: Array, armature: Array | None = None) -> Array:
        """Accelerations (B, c) [rad/s2 or m/s2] by the articulated-body algorithm.

        Args:
            q: (B, c) [rad or m].
            v: (B, c) [rad/s or m/s].
            force: (B, c) force along the coordinates [N.m or N].
            armature: (B, c) armature added in this call [kg.m2 or kg].
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
        """Inverses (B, c, c) of the mass matrix [1/(kg.m2) or 1/kg].

        Args:
            q: (B, c) [rad or m].
            armature: (B, c) armature added in this call [kg.m2 or kg].
        """
        if not self.plain:
            return _regular(np.linalg.inv, self._mass(q, armature))
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

        Args:
            q: (B, c) [rad or m].
            v: (B, c) [rad/s or m/s].
            a: (B, c) [rad/s2 or m/s2].
        """
        drive, rest = self.bodies.drive, self.bodies.rest
        out = np.empty_like(q)
        for i in range(len(q)):
            state = (q[i], v[i], a[i]) if self.plain else (drive @ q[i] + rest, drive @ v[i], drive @ a[i])
            torque = pin.rnea(self.bare, self.bare_data, *state)
            out[i] = torque if self.plain else drive.T @ torque
        return out

    def inertia(self, q: Array) -> Array:
        """Diagonal (B, c) of the mass matrix without the rotors [kg.m2 or kg].

        Args:
            q: (B, c) [rad or m].
        """
        rotors = np.einsum("rc,r,rc->c", self.bodies.drive, self.armature, self.bodies.drive)
        return np.asarray(np.einsum("bcc->bc", self._mass(q)) - rotors)

    def jacobian(self, q: Array) -> Array:
        """Jacobian (B, 3, n) of the last link's centre of mass, one column per joint [m/rad or 1].

        Args:
            q: (B, c) [rad or m].
        """
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
        return _regular(np.linalg.solve, self._mass(q, armature), (force - bias @ drive)[..., None])[..., 0]


def _regular(compute: Callable[..., Array], *given: Array) -> Array:
    try:
        return compute(*given)
    except np.linalg.LinAlgError:
        raise RobotError(
            "the mass matrix is singular in some pose: a link has no inertia, or infeasible inertials; give the links "
            "feasible inertials, or the joints an armature"
        ) from None
