"""Dry friction that opposes motion, or holds a joint exactly at rest."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...types import Array, Mask

ITERATIONS, TOLERANCE = 200, 1e-10  # largest number of iterations, and absolute tolerance, of Pinocchio's solver
GUESSES = 12  # guesses of the held joints before Pinocchio's solver is used


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
        settings.max_iterations = ITERATIONS
        settings.absolute_complementarity_tol = settings.absolute_feasibility_tol = TOLERANCE
        settings.relative_complementarity_tol = settings.relative_feasibility_tol = TOLERANCE / 100

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
    for _ in range(GUESSES):
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
