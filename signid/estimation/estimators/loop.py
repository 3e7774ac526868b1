"""Closed loop of a recording: its controller, and estimators along the motion of its simulation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...deadline import time_is_up
from ...errors import OptionError
from ...model import Model, fitted_model, stated_parameters
from ...recording.sampling import samples
from ...regression.bandwidth import Decimator
from ...regression.motion import Motion, base_rows, build_motion, margin
from ...regression.projection import SINGULAR_VALUE_TOLERANCE, least_squares
from ...regression.session import BAND_SAMPLES, Options, Part, Session
from ...simulation.plant import simulate, track
from ...simulation.plant.control import LOOP_BANDWIDTH, Plan, sampled
from ...types import Array, Estimate, Frozen, Samples, Trajectory
from ..feasible import fit_consistent
from ..least_squares import estimate
from . import Estimator, Given, part_of

MIN_CONTROLLER_SHARE = 0.5  # [1] of the torque variance that an estimated controller explains, else a default is used
MIN_LOOP_FREQUENCY, MAX_LOOP_FREQUENCY = 2 * np.pi * 0.5, 2 * np.pi * 30.0  # [rad/s] natural, of a position loop
MIN_DAMPING_RATIO, MAX_DAMPING_RATIO = 0.3, 2.0  # [1] smallest and largest damping ratio of a position loop
MAX_LOOP_STEP = 1e-3  # [s] largest step of the simulation
MAX_LOOP_ROUNDS = 8
CONVERGED_DEVIATIONS = 0.05  # [standard deviations] change at which rounds have converged
CONVERGED_SHARE = 1e-6  # [1] the same as a share of the largest parameter, for recordings without noise


@dataclass(frozen=True, eq=False)
class Controller(Frozen):
    """Controller: torque = feed-forward + stiffness * (desired - q) + damping * (desired speed - v)."""

    stiffness: Array  # (n,) [N.m/rad or N/m]
    damping: Array  # (n,) [N.m.s/rad or N.s/m]
    ahead: tuple[Array, ...]  # per joint (m,) [units of base] coefficients of the columns along the desired motion
    note: str = ""  # sentence on how it was found

    def feed_forward(self, session: Session, desired: Motion) -> Array:
        """Feed-forward torque (N, n) [N.m or N] along a desired motion."""
        columns = base_rows(desired, session.task.laws, session.task.wanted)
        return np.column_stack([x @ share for x, share in zip(columns, self.ahead, strict=True)])


def stretches(session: Session) -> Iterator[Samples]:
    """Stretches of the training recordings on the uniform grid, without those too short for the filters."""
    least = 2 * margin(session.task.band) + 2 * len(session.task.band.taps)
    for recording, sampling in session.train:
        for span in sampling.spans:
            if (count := sampling.length(span)) > least:
                yield samples(recording, sampling, span, 0, count)


def motion_of(session: Session, q: Array, period: float) -> Motion:
    """Motion at samples q (N, n) [rad or m] of a stretch; for the filters its ends are extended by reflection."""
    band, edge = session.task.band, margin(session.task.band)
    mirrored = np.concatenate([2 * q[:1] - q[edge:0:-1], q, 2 * q[-1:] - q[-2 : -edge - 2 : -1]])
    t = np.asarray((np.arange(len(mirrored)) - edge) * period, dtype=np.float64)
    wide = Samples(t, mirrored, np.zeros_like(mirrored), None, None, None)
    return build_motion(session.robot, wide, band, period, slow=session.task.slow)


def find_controller(
    session: Session, pieces: Sequence[Samples], model: Model, value: Array, gains: tuple[Array, Array] | None = None
) -> Controller:
    """Estimate proportional and derivative gains, and feed-forward coefficients of all regressor columns.

    Each joint's torque is fitted by least squares with position error, speed error and the columns along the desired
    motion, all equally filtered. A default loop, fed forward by the model of parameters value (b,) [units of base],
    is used for joints whose torque is poorly explained or whose gains are implausible. If the controller is known,
    gains are stiffness (n,) [N.m/rad] and damping (n,) [N.m.s/rad].
    """
    piece = max(pieces, key=lambda piece: len(piece.t))
    asked, found = _fit_joints(session, piece, gains)
    if gains is not None:
        return Controller(*gains, tuple(fit.ahead for fit in found), "the gains of the controller are as stated")
    usual = track(model, Trajectory(session.robot.joints, asked.t, asked.q, asked.v, asked.a))
    inertia = usual.stiffness / (2 * np.pi * LOOP_BANDWIDTH) ** 2
    kp, kd = np.array([fit.gains for fit in found]).T
    shares = np.array([fit.share for fit in found])
    good = np.asarray((shares > MIN_CONTROLLER_SHARE) & (kp > inertia * MIN_LOOP_FREQUENCY**2))
    stiffness = np.where(good, np.minimum(kp, inertia * MAX_LOOP_FREQUENCY**2), usual.stiffness)
    critical = 2 * np.sqrt(stiffness * inertia)
    damping = np.where(good, np.clip(kd, MIN_DAMPING_RATIO * critical, MAX_DAMPING_RATIO * critical), usual.damping)
    ahead = (fit.ahead if good[j] else value[session.task.seen(j)] for j, fit in enumerate(found))
    speed = np.sqrt(stiffness / inertia) / (2 * np.pi)
    joints = session.robot.joints
    loops = ", ".join(f"{joint} {hertz:.2g} Hz" for joint, hertz, ok in zip(joints, speed, good, strict=True) if ok)
    other = ", ".join(joint for joint, ok in zip(joints, good, strict=True) if not ok)
    explained = f"{shares[good].min(initial=1):.2%}"
    fitted = f"a PD controller with feed-forward torque explains {explained} of the torque ({loops})"
    default = f"no PD controller explains the torque of {other}: a default one of {LOOP_BANDWIDTH:g} Hz is used"
    note = "; ".join(sentence for sentence, names in ((fitted, loops), (default, other)) if names)
    return Controller(stiffness, damping, tuple(ahead), note)


class _Fit(NamedTuple):
    gains: Array  # (2,) stiffness and damping
    ahead: Array  # (m,) [units of base] feed-forward coefficients
    share: float  # [1] explained share of the torque's variance


def _fit_joints(session: Session, piece: Samples, gains: tuple[Array, Array] | None) -> tuple[Motion, list[_Fit]]:
    """Desired motion of a stretch, and the controller of each joint."""
    t, q, tau, q_des = (x[: BAND_SAMPLES // 4] for x in (piece.t, piece.q, piece.tau, piece.q_des) if x is not None)
    real, asked = (motion_of(session, x, float(t[1] - t[0])) for x in (q, q_des))
    thin = Decimator(session.task.band.taps, session.task.band.factor)
    found = []
    for j, x in enumerate(base_rows(asked, session.task.laws, session.task.wanted)):
        errors = asked.q[:, j] - real.q[:, j], asked.v[:, j] - real.v[:, j]
        known = not np.isnan(tau[:, j]).all()
        rows = thin(np.column_stack([*errors, x, tau[:, j]])) if known else np.zeros((1, x.shape[1] + 3))
        stated = None if gains is None else np.array([gains[0][j], gains[1][j]])
        first = 0 if stated is None else 2
        x, y = rows[:, first:-1], rows[:, -1] - (0 if stated is None else rows[:, :2] @ stated)
        size = np.maximum(np.linalg.norm(x, axis=0), 1e-300)
        solved = least_squares(x / size, y, SINGULAR_VALUE_TOLERANCE) / size
        share = 1 - float(np.var(y - x @ solved)) / max(float(np.var(rows[:, -1])), 1e-300)
        found.append(_Fit(solved[:2] if stated is None else stated, solved[2 - first :], share))
    return asked, found


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
        session, pieces = given.session, _training_pieces(given.session, self.name)
        found, controller = estimate(given.factors, given.base, given.prior, given.whiten), None
        for done in range(MAX_LOOP_ROUNDS):
            fit = fit_consistent(given.base, found, stated_parameters(session.task))
            model = fitted_model(session.task, fit.parameters)
            controller = controller or find_controller(session, pieces, model, fit.base_value, self.gains)
            if given.progress is not None:
                given.progress("simulating the closed loop", done / MAX_LOOP_ROUNDS)
            motions = [_run_loop(session, model, controller, piece) for piece in pieces]
            bare = [piece._replace(q_des=None) for piece in pieces]
            moved = [Samples(**{**piece._asdict(), self.simulated: q}) for piece, q in zip(bare, motions, strict=True)]
            new = self.solve(given, [part_of(session, piece) for piece in moved])
            known = np.isfinite(new.std)
            least = CONVERGED_DEVIATIONS * new.std[known] + CONVERGED_SHARE * np.abs(new.value).max(initial=0.0)
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
            f"the estimator {self.name} did not converge within {MAX_LOOP_ROUNDS} rounds; its intervals are too "
            "narrow, use wls or tls"
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


def _training_pieces(session: Session, name: str) -> list[Samples]:
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


def _run_loop(session: Session, model: Model, controller: Controller, piece: Samples) -> Array:
    """Positions (N, n) [rad or m] of the closed loop along a stretch."""
    assert piece.q_des is not None, "checked before"
    period = float(piece.t[1] - piece.t[0])
    asked, real = (motion_of(session, q, period) for q in (piece.q_des, piece.q))
    path = Trajectory(session.robot.joints, asked.t, asked.q, asked.v, asked.a)
    drive = ControllerDrive(path, controller.feed_forward(session, asked), controller, real.q[0], real.v[0])
    parts = int(np.ceil(period / MAX_LOOP_STEP - 1e-9))
    try:
        moved = simulate(model, drive, len(asked.t) * period, step=period / parts)
    except OptionError as error:
        raise OptionError(
            f"the closed loop cannot be simulated with the estimated controller ({error}); choose wls or tls"
        ) from None
    return moved.true_q[::parts][: len(asked.t)]
