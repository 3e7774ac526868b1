"""Simulation of a model over short windows of recordings, from measured states under recorded torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...effects.base import TorqueLaw, of_kind
from ...effects.trial import Trial
from ...errors import OptionError
from ...model import Model, ModelSource, as_model, torque_model
from ...recording import Recordings, as_recordings, need_torque
from ...recording.sampling import survey
from ...regression.bandwidth import Band, choose_band
from ...regression.session import Session, common_rate, longest_piece
from ...typed import typed
from ...types import Array, Indices, Recording, Result, Robot
from ..plant.plant import Plant
from .windows import Windows, cut_windows, restrict_joints

COUNT, STEP = 48, 1e-3  # default number of windows, and largest step [s]
FAR = 1e3  # [rad or m] error from which on a simulation has diverged
BEYOND = 1e6  # [rad, m, rad/s or m/s] state from which on a simulation is stopped before it overflows


@dataclass(frozen=True, eq=False)
class RollOut(Result):
    """W short simulations of n joints and S samples, from measured states under recorded torque.

    `error` is simulated minus measured position. It is NaN for a joint without recorded torque, and infinite if the
    simulation diverged.
    """

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # rad or m, one per joint
    horizons: tuple[float, ...]  # [s]
    t: Array  # (S,) [s] time since the start of a window
    recording: Indices  # (W,) number of the recording of each window
    start: Array  # (W,) [s] start of each window
    error: Array  # (W, S, n) [rad or m]
    step: float  # [s] of the simulation
    notes: tuple[str, ...] = ()

    def end(self, horizon: float) -> Array:
        """Error (W, n) [rad or m] of each window at a horizon [s].

        Raises:
            OptionError: the windows are shorter.
        """
        place = round(horizon / float(self.t[0])) - 1
        if not 0 <= place < len(self.t):
            raise OptionError(f"the horizon is {horizon:g} s; choose one from {self.t[0]:.4g} to {self.t[-1]:.4g} s")
        return np.asarray(self.error[:, place])

    def rms(self, horizon: float) -> Array:
        """Root mean square (n,) [rad or m] over windows of the error at a horizon [s]."""
        return np.asarray(np.sqrt(np.mean(self.end(horizon) ** 2, axis=0)))

    def median(self, horizon: float) -> Array:
        """Median (n,) [rad or m] over windows of the absolute error at a horizon [s], robust against few windows."""
        return np.asarray(np.median(np.abs(self.end(horizon)), axis=0))

    def document(self, before: RollOut, horizon: float | None = None) -> dict[str, Any]:
        """Object for diagnosis.json: errors of the original model and of this one at a horizon [s]; None: the longest.

        Raises:
            OptionError: the roll-outs have different joints or windows.
        """
        if self.joints != before.joints or not np.array_equal(self.start, before.start):
            raise OptionError("the roll-outs have different joints or windows; use the same recordings for both models")
        horizon = max(self.horizons) if horizon is None else horizon
        errors = {"before_rms": before.rms(horizon), "after_rms": self.rms(horizon)}
        numbers = {key: [float(x) if np.isfinite(x) else None for x in rms] for key, rms in errors.items()}
        return {"horizon": horizon, **numbers, "unit": list(self.unit)}


@typed
def roll_out(
    model: ModelSource,
    recordings: Recordings | Session,
    horizons: Sequence[float] = (0.2, 0.5),
    *,
    windows: int = COUNT,
    band: Band | None = None,
    step: float = STEP,
    integrator: str = "semi-implicit",
    beside: Model | None = None,
) -> RollOut:
    """Errors of a model that is simulated over short horizons, from measured states under recorded torque.

    Windows have the length of the longest horizon and evenly spaced starts. Their number in each recording is
    proportional to its length, and all are simulated at once. The model's recording laws are undone, and its actuator
    laws act. A joint without recorded torque follows its measured motion.

    Args:
        model: any model; joints that the recordings lack are held as in identification.
        recordings: one or several recordings of the same joints and rate, or a session, whose held-out part and band
            are used.
        horizons: horizons [s].
        windows: number of windows; they overlap if the recordings are short.
        band: band of the filter on positions; None: chosen from the recordings.
        step: largest step of the simulation [s].
        integrator: `semi-implicit`, with positions centred between velocities, or `rk4`.
        beside: other model of the same joints that is simulated over the same windows.

    Raises:
        OptionError: a horizon, the number of windows or the step is invalid, or a recording's torque has no sign.
        RecordingError: a recording cannot be used, or no stretch of it is long enough.
    """
    model = torque_model(as_model(model, "roll_out"))
    each = _each(recordings, model.robot)
    need_torque(each)
    _check(each, horizons, windows, step)
    model, notes = restrict_joints(model, each)
    if isinstance(recordings, Session):
        parts, band = list(recordings.held_out), band or recordings.task.band
    else:
        parts = [(recording, survey(recording, model.robot)) for recording in each]
    if band is None:
        band = choose_band([longest_piece(part) for part in parts], common_rate(parts, "roll out each by itself"))
    lengths = np.array([sampling.duration for _, sampling in parts])
    counts = np.maximum(1, np.rint(windows * lengths / lengths.sum())).astype(int).tolist()
    cuts = [
        cut_windows(model, part, band, max(horizons), count, step, beside=beside)
        for part, count in zip(parts, counts, strict=True)
    ]
    errors = [simulate_windows(model, cut, integrator) for cut in cuts]
    samples_each = min(error.shape[1] for error in errors)
    robot, first = model.robot, cuts[0]
    return RollOut(
        joints=robot.joints,
        unit=tuple("m" if prismatic else "rad" for prismatic in robot.prismatic),
        horizons=tuple(map(float, horizons)),
        t=np.arange(1, samples_each + 1) * first.step * first.parts,
        recording=np.repeat(np.arange(len(cuts)), [len(cut.t) for cut in cuts]),
        start=np.concatenate([cut.t for cut in cuts]),
        error=np.concatenate([error[:, :samples_each] for error in errors]),
        step=first.step,
        notes=notes,
    )


def _each(given: Recordings | Session, robot: Robot) -> list[Recording]:
    if isinstance(given, Session):
        return [recording for recording, _ in given.held_out]
    return as_recordings(given, robot, "roll_out")


def _check(recordings: Sequence[Recording], horizons: Sequence[float], windows: int, step: float) -> None:
    if not recordings:
        raise OptionError("no recording was given; give at least one")
    if not (len(horizons) and all(np.isfinite(h) and h > 0 for h in horizons)):
        listed = ", ".join(f"{h:g} s" for h in horizons) or "none"
        raise OptionError(f"the horizons are {listed}; give one or more longer than 0 s, such as 0.2 and 0.5")
    if windows < 1 or not step > 0:
        raise OptionError(
            f"there are {windows} windows in steps of {step:g} s; give at least one window and a positive step"
        )
    unsigned = {j for r in recordings for j, s in zip(r.joints, r.signed, strict=True) if not s}
    if unsigned:
        raise OptionError(f"the torque of {', '.join(sorted(unsigned))} has no sign; a roll-out needs signed torque")


def simulate_windows(model: Model, windows: Windows, integrator: str = "semi-implicit") -> Array:
    """Simulated minus measured position (W, S, n) [rad or m] after each sample."""
    plant = Plant(model, windows.step, len(windows.t), integrator)
    plant.moment.origin = windows.origin
    # [s] by which positions are ahead of velocities
    half = 0.0 if integrator == "rk4" else windows.step / plant.substeps / 2
    ahead = windows.q + half * windows.v
    plant.start(ahead[:, 0], windows.v[:, 0])
    plant.speed[:, plant.bodies.flex] = windows.flex[1]
    plant.state[:, plant.bodies.flex] = windows.flex[0] + half * windows.flex[1]
    _remember(plant, windows)
    blind, error = plant.bodies.motor[~windows.measured], np.full_like(windows.q[:, 1:], np.nan)
    diverged = np.zeros((len(windows.t), 1), dtype=bool)
    with np.errstate(all="ignore"):
        for k, torque in enumerate(windows.torque.swapaxes(0, 1), 1):
            plant.advance(windows.t + (k - 1) * windows.step, torque)
            still = (np.abs(plant.state) < BEYOND) & (np.abs(plant.speed) < BEYOND)
            diverged |= ~still.all(axis=1, keepdims=True)
            if diverged.any():
                plant.state, plant.speed = np.where(diverged, 0.0, plant.state), np.where(diverged, 0.0, plant.speed)
            i, rest = divmod(k, windows.parts)
            if rest == 0:
                error[:, i - 1] = np.where(diverged, np.inf, plant.q - half * plant.v - windows.q[:, i])
                # copies, since the arrays that give the step's acceleration stay unchanged
                plant.state, plant.speed = plant.state.copy(), plant.speed.copy()
                plant.state[:, blind] = ahead[:, i, ~windows.measured]
                plant.speed[:, blind] = windows.v[:, i, ~windows.measured]
    error = np.where(np.abs(error) < FAR, error, np.inf)
    error[..., ~windows.measured] = np.nan
    return error


def _remember(plant: Plant, windows: Windows) -> None:
    """Advance the memories of laws along the motion before the windows."""
    for term in plant.remembering:
        j = list(term.view.joints)
        for v in windows.before.swapaxes(0, 1):
            x = Trial(0.0, v[:, j], dt=windows.period, joints=term.view.joints)
            term.z = of_kind(term.effect, TorqueLaw).advance(term.z, x, **term.shape)
