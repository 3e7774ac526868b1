"""Estimators that simulate the closed loop along the recordings: motion without encoder noise."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...deadline import time_is_up
from ...errors import OptionError
from ...model import Model, fitted_model, stated_parameters
from ...regression.session import Options, Part, Session
from ...simulation.plant import simulate
from ...simulation.plant.control import Plan, sampled
from ...types import Array, Estimate, Frozen, Samples, Trajectory
from ..feasible import fit_consistent
from ..least_squares import estimate
from .base import Estimator, Given, part_of
from .controller import Controller, find_controller, motion_of, stretches

STEP = 1e-3  # [s] largest step of the simulation
ROUNDS, SETTLED = 8, 0.05  # largest number of rounds; [standard deviations] change at which they have converged
EXACT = 1e-6  # [1] the same as a share of the largest parameter, for recordings without noise


@dataclass(frozen=True, eq=False)
class LoopEstimator(Frozen, Estimator):
    """Estimator that alternates between simulation of the closed loop and estimation until the estimate converges."""

    gains: tuple[Array, Array] | None = None  # stiffness (n,) [N.m/rad], damping (n,) [N.m.s/rad]; None: estimated
    simulated = "q"  # positions that the simulated ones replace: `q` or `q_des`

    def options(self, options: Options) -> Options:
        """Options for rows from positions alone, since only positions are simulated.

        Raises:
            OptionError: recorded derivatives are requested.
        """
        if options.derivatives == "recorded":
            raise OptionError(
                f"the estimator {self.name} simulates positions and cannot use recorded derivatives; choose computed "
                "ones"
            )
        return replace(options, instruments=False, derivatives="computed")

    @abstractmethod
    def solve(self, given: Given, parts: Sequence[Part]) -> Estimate:
        """Estimate from recordings with simulated positions."""

    def estimate(self, given: Given) -> Estimate:
        """Alternate between simulation with the current parameters and estimation along its motion."""
        session, pieces = given.session, _pieces(given.session, self.name)
        found, controller = estimate(given.factors, given.base, given.prior, given.whiten), None
        for done in range(ROUNDS):
            fit = fit_consistent(given.base, found, stated_parameters(session.task))
            model = fitted_model(session.task, fit.parameters)
            controller = controller or find_controller(session, pieces, model, fit.base_value, self.gains)
            if given.progress is not None:
                given.progress("simulating the closed loop", done / ROUNDS)
            motions = [_run(session, model, controller, piece) for piece in pieces]
            bare = [piece._replace(q_des=None) for piece in pieces]
            moved = [Samples(**{**piece._asdict(), self.simulated: q}) for piece, q in zip(bare, motions, strict=True)]
            new = self.solve(given, [part_of(session, piece) for piece in moved])
            known = np.isfinite(new.std)
            least = SETTLED * new.std[known] + EXACT * np.abs(new.value).max(initial=0.0)
            still, found = bool(np.all(np.abs(new.value - found.value)[known] <= least)), new
            if still or time_is_up(f"the estimator {self.name}"):
                break
        away = np.concatenate([piece.q - q for piece, q in zip(pieces, motions, strict=True)])
        note = (
            f"the closed loop was simulated {done + 1} times; it stays within "
            f"{np.sqrt(np.mean(away**2, axis=0)).max():.2g} rad or m of the recorded positions (rms)"
        )
        assert controller is not None, "there is a round"
        flag = (
            f"the estimator {self.name} did not converge within {ROUNDS} rounds; its intervals are too narrow, use wls "
            "or tls"
        )
        flags = found.flags if still else (*found.flags, flag)
        return replace(found, notes=(*found.notes, controller.note, note), flags=flags)


@dataclass(frozen=True, eq=False)
class ControllerDrive(Frozen):
    """Drive of a simulation: a controller along a desired motion, started at a measured state."""

    path: Trajectory
    torque: Array  # (N, n) [N.m or N] feed-forward
    controller: Controller
    q: Array  # (n,) [rad or m] initial position
    v: Array  # (n,) [rad/s or m/s] initial velocity

    def start(self) -> tuple[Array, Array]:
        """Initial position and velocity, (n,) each [rad, rad/s]."""
        return self.q, self.v

    def plan(self, t: Array) -> Plan:
        """Desired motion and feed-forward torque at t (K,) [s]."""
        q, v, _ = sampled(self.path, t)
        ahead = np.column_stack([np.interp(t, self.path.t, x) for x in self.torque.T])
        return Plan(ahead, q, v, self.controller.stiffness, self.controller.damping)


def _pieces(session: Session, name: str) -> list[Samples]:
    """Training stretches, after a check that all have desired positions."""
    lacking = [
        joint
        for recording, _ in session.train
        for joint, column in zip(recording.joints, recording.columns.get("q_des", ()), strict=False)
        if not column
    ]
    pieces = list(stretches(session))
    if lacking or any(piece.q_des is None or not np.isfinite(piece.q_des).all() for piece in pieces):
        fault = f"{lacking[0]} has none" if lacking else "there are none, or they have gaps"
        raise OptionError(
            f"the estimator {name} simulates the closed loop and needs the desired positions q_des_J of every joint; "
            f"{fault}; record them, or choose wls or tls"
        )
    return pieces


def _run(session: Session, model: Model, controller: Controller, piece: Samples) -> Array:
    """Positions (N, n) [rad or m] of the closed loop along a stretch."""
    assert piece.q_des is not None, "checked before"
    period = float(piece.t[1] - piece.t[0])
    asked, real = (motion_of(session, q, period) for q in (piece.q_des, piece.q))
    path = Trajectory(session.robot.joints, asked.t, asked.q, asked.v, asked.a)
    drive = ControllerDrive(path, controller.feed_forward(session, asked), controller, real.q[0], real.v[0])
    parts = int(np.ceil(period / STEP - 1e-9))
    try:
        moved = simulate(model, drive, len(asked.t) * period, step=period / parts)
    except OptionError as error:
        raise OptionError(
            f"the closed loop cannot be simulated with the estimated controller ({error}); choose wls or tls"
        ) from None
    return moved.true_q[::parts][: len(asked.t)]
