"""Dry friction: it opposes motion, or holds a joint at rest, exactly."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..types import Array

ITERATIONS, TOLERANCE = 200, 1e-10


class DryFriction:
    """Velocity after a step when friction lies in a box [low, high] and opposes motion: Pinocchio's solver.

    Source: projected Gauss-Seidel on the maximum-dissipation problem; Carpentier, Le Lidec, Montaut, RSS 2024.
    """

    def __init__(self, count: int) -> None:
        model, joints = pin.Model(), pin.StdVec_Index()
        for i in range(count):
            joints.append(model.addJoint(i, pin.JointModelRX(), pin.SE3.Identity(), f"{i}"))
        self.constraint = pin.JointFrictionConstraintModel(model, joints)
        self.solver, self.result, self.settings = pin.PGSConstraintSolver(count), pin.PGSSolverResult(), settings()

    def __call__(self, free: Array, low: Array, high: Array, mobility: Array) -> tuple[Array, Array]:
        """The velocity (c,) [rad/s or m/s], exactly zero where friction holds, and the friction (c,) [N.m or N].

        Args:
            free: (c,) velocity after the step without friction [rad/s or m/s].
            low: (c,) least friction [N.m or N].
            high: (c,) most friction [N.m or N].
            mobility: (c, c) velocity that a torque adds in the step [rad/(N.m.s) or m/(N.s)].
        """
        self.constraint.setFrictionLowerLimit(-high)
        self.constraint.setFrictionUpperLimit(-low)
        models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
        models.append(pin.ConstraintModel(self.constraint))
        datas.append(pin.ConstraintData(self.constraint.createData()))
        operator = pin.DelassusOperatorDense(mobility)
        self.solver.solve(operator, free, models, datas, self.settings, self.result)
        friction = -np.array(self.result.retrieveConstraintImpulses())
        held = (friction > low) & (friction < high)
        return np.where(held, 0.0, free - mobility @ friction), friction


def settings() -> pin.PGSSolverSettings:
    """To rounding errors."""
    chosen = pin.PGSSolverSettings()
    chosen.max_iterations = ITERATIONS
    chosen.absolute_complementarity_tol = chosen.absolute_feasibility_tol = TOLERANCE
    chosen.relative_complementarity_tol = chosen.relative_feasibility_tol = TOLERANCE / 100
    return chosen
