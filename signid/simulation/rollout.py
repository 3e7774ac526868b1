"""Simulation of a model over short windows of recordings, from measured states under recorded torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..effects.base import ActuatorLaw, BodyLaw, RecordingLaw, TorqueLaw, TransmissionLaw, Trial, of_kind
from ..errors import OptionError, RecordingError
from ..model import Model, ModelSource, as_model, torque_model
from ..recording import Recordings, as_recordings, need_torque, same_joints
from ..recording.sampling import Sampling, samples, survey
from ..recording.sampling.grid import Span
from ..regression.bandwidth import Band, choose_band
from ..regression.motion import Motion, build_motion, margin
from ..regression.session import Part, Session, common_rate, longest_piece
from ..robot import hold, resting
from ..typed import typed
from ..types import Array, Frozen, Indices, Law, Mask, Recording, Result
from .plant.plant import Plant, apply_actuators

WINDOW_COUNT, MAX_ROLLOUT_STEP = 48, 1e-3  # default number of windows, and largest step [s]
MAX_POSITION_ERROR = 1e3  # [rad or m] error from which on a simulation has diverged
MAX_STATE = 1e6  # [rad, m, rad/s or m/s] state from which on a simulation is stopped before it overflows
MEMORY_DURATION, MAX_RECORDING_SHIFT = 1.0, 0.1  # [s] before a window for laws with memory; by recording laws


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
    windows: int = WINDOW_COUNT,
    band: Band | None = None,
    step: float = MAX_ROLLOUT_STEP,
    integrator: str = "semi-implicit",
    beside: Model | None = None,
) -> RollOut:
    """Errors of a model that is simulated over short horizons, from measured states under recorded torque.

    >>> signid.roll_out("3r", "robots/3r/recording.parquet", [0.2]).rms(0.2).shape
    (3,)

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
    if isinstance(recordings, Session):
        each = [recording for recording, _ in recordings.held_out]
    else:
        each = as_recordings(recordings, model.robot, "roll_out")
    need_torque(each)
    _check_windows(each, horizons, windows, step)
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


def _check_windows(recordings: Sequence[Recording], horizons: Sequence[float], windows: int, step: float) -> None:
    if not recordings:
        raise OptionError("no recording was given; give at least one")
    if still := [recording.path or "the recording" for recording in recordings if recording.static]:
        raise RecordingError(
            f"{still[0]} is of postures at rest, which no roll-out simulates; identify and validate take it"
        )
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
    for term in plant.remembering:  # memories of laws along the motion before the windows
        j = list(term.view.joints)
        for v in windows.before.swapaxes(0, 1):
            x = Trial(0.0, v[:, j], dt=windows.period, joints=term.view.joints)
            term.z = of_kind(term.effect, TorqueLaw).advance(term.z, x, **term.shape)
    blind, error = plant.bodies.motor[~windows.measured], np.full_like(windows.q[:, 1:], np.nan)
    diverged = np.zeros((len(windows.t), 1), dtype=bool)
    with np.errstate(all="ignore"):
        for k, torque in enumerate(windows.torque.swapaxes(0, 1), 1):
            plant.advance(windows.t + (k - 1) * windows.step, torque)
            still = (np.abs(plant.state) < MAX_STATE) & (np.abs(plant.speed) < MAX_STATE)
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
    error = np.where(np.abs(error) < MAX_POSITION_ERROR, error, np.inf)
    error[..., ~windows.measured] = np.nan
    return error


def restrict_joints(model: Model, recordings: Sequence[Recording]) -> tuple[Model, tuple[str, ...]]:
    """Hold the joints that recordings lack, as identification does; with notes on the laws that are left out.

    Raises:
        RecordingError: the recordings have a joint that the model lacks or holds.
    """
    joints, robot = same_joints(recordings), model.robot
    beyond = [joint for joint in joints if joint not in robot.joints]
    if beyond:
        raise RecordingError(
            f"the recordings have {', '.join(beyond)}, which the model of {robot.name} lacks or holds; "
            f"give a model of these joints"
        )
    if joints != tuple(joint for joint in robot.joints if joint in joints):
        raise RecordingError(
            f"the recordings have another order of joints than the model of {robot.name}; read them for its robot"
        )
    if joints == robot.joints:
        return model, ()
    moving = hold(robot, resting(robot, but=joints))
    held = [law for law in model.laws if not {robot.joints[j] for j in law.joints} & set(joints)]
    fixed = tuple(law for law in held if isinstance(law.effect, BodyLaw))
    inertials = replace(model, laws=fixed).whole_inertials()
    kept, notes = list[Law](), list[str]()
    for law in (law for law in model.laws if law not in held):
        left = tuple(joints.index(robot.joints[j]) for j in law.joints if robot.joints[j] in joints)
        if law.effect.scope == "pair" and len(left) < 2:
            notes.append(f"{law.effect.name} is left out: one of its joints is held")
        else:
            kept.append(replace(law, joints=left))
    marks = {joint: marks for joint, marks in model.marks.items() if joint in joints}
    return Model(moving, inertials, tuple(kept), marks=marks), tuple(notes)


@dataclass(frozen=True, eq=False)
class Windows(Frozen):
    """W windows of S samples of n joints: true motion and torque according to the model's laws."""

    t: Array  # (W,) start [s]
    period: float  # [s] of the recording
    step: float  # [s] of the simulation
    parts: int  # steps per sample
    q: Array  # (W, S + 1, n) [rad or m]
    v: Array  # (W, S + 1, n) [rad/s or m/s]
    torque: Array  # (W, S * parts, n) mean over each step [N.m or N]
    flex: Array  # (2, W, k) deflection and its rate of each elastic joint at the start [rad or m, rad/s or m/s]
    before: Array  # (W, L, n) velocities up to the start, for laws with memory [rad/s or m/s]
    measured: Mask  # (n,) whether the joint's torque is recorded
    origin: float = 0.0  # [s] time stamp of the start of the recording, if it is far from 0


def cut_windows(
    model: Model,
    part: Part,
    band: Band,
    length: float,
    count: int,
    step: float,
    *,
    beside: Model | None = None,
    held: bool = False,
) -> Windows:
    """Windows of a length [s] with evenly spaced starts over the usable stretches of a recording; they may overlap.

    The model's recording laws are undone, and its laws with memory need the motion before a window. The windows leave
    enough room for the model `beside`, too. The step [s] is the largest one of the simulation. Torque is linear between
    samples, or `held` from each to the next.

    Raises:
        RecordingError: no stretch of the recording is long enough.
    """
    recording, sampling = part
    period = sampling.period
    stride, parts = max(1, int(step / period * (1 + 1e-9))), max(1, int(np.ceil(period / step * (1 - 1e-9))))
    size = stride * max(1, round(length / (stride * period)))
    before, after = _memory_samples(model, period)
    more = _memory_samples(model if beside is None else beside, period)
    edge, after = margin(band), max(after, more[1])
    lead = max(before, after, *more)
    whole = edge + lead + size + after + edge + 1
    places = _window_starts(sampling, whole, count)
    if not places:
        longest = max(sampling.length(span) for span in sampling.spans) * period
        raise RecordingError(
            f"{recording.path or 'the recording'}: windows of {length:g} s need {whole * period:.3g} s without a gap, "
            f"filters included, but the longest stretch lasts {longest:.3g} s; choose shorter horizons"
        )
    motions = [
        _acted_motion(model, build_motion(model.robot, samples(recording, sampling, span, k, k + whole), band, period))
        for span, k in places
    ]
    q, v, torque = (np.stack([getattr(m, key) for m in motions]) for key in ("q", "v", "recorded"))
    states, inside = slice(lead, lead + size + 1, stride), slice(lead, lead + size + 1)
    return Windows(
        t=np.array([m.t[lead] for m in motions]),
        period=period,
        step=period * stride / parts,
        parts=parts,
        q=q[:, states],
        v=v[:, states],
        torque=_mean_torques(torque[:, inside], stride, parts, held),
        flex=np.stack([_deflections(model, m, lead) for m in motions], axis=1),
        before=v[:, lead - before : lead],
        measured=np.array([bool(c) for c in recording.columns["tau"]]),
        origin=sampling.origin,
    )


def _memory_samples(model: Model, period: float) -> tuple[int, int]:
    """Samples that laws with memory need before a window, and samples by which recording laws shift signals."""
    remembers = any(law.effect.memory or isinstance(law.effect, TransmissionLaw) for law in model.laws)
    before = int(np.ceil(MEMORY_DURATION / period)) if remembers else 0
    return before, int(np.ceil(MAX_RECORDING_SHIFT / period)) if model.of(RecordingLaw) else 0


def _window_starts(sampling: Sampling, whole: int, count: int) -> list[tuple[Span, int]]:
    """Spans and their samples at which windows begin, evenly spaced over all possible starts."""
    rooms = [(span, sampling.length(span) - whole + 1) for span in sampling.spans]
    rooms = [(span, room) for span, room in rooms if room > 0]
    ends = np.cumsum([room for _, room in rooms])
    if not rooms:
        return []
    found = np.unique(np.linspace(0, ends[-1] - 1, count).round().astype(int))
    which = np.searchsorted(ends, found, side="right")
    return [(rooms[i][0], int(k - ends[i] + rooms[i][1])) for k, i in zip(found, which, strict=True)]


def _acted_motion(model: Model, motion: Motion) -> Motion:
    """Motion with recording and actuator laws applied; missing torque is the one that the model predicts."""
    motion = model.acted(motion)
    assert motion.recorded is not None, "windows carry torque"
    torque = apply_actuators(model.of(ActuatorLaw), motion.recorded)
    unknown = np.isnan(torque)
    if unknown.any():
        physics = tuple(law for law in model.laws if not isinstance(law.effect, ActuatorLaw | RecordingLaw))
        torque = np.where(unknown, replace(model, laws=physics).inverse(motion), torque)
    return replace(motion, recorded=torque)


def _deflections(model: Model, motion: Motion, k: int) -> Array:
    """Deflections and their rates (2, k) of the elastic joints at sample k."""
    elastic = model.of(TransmissionLaw)
    if not elastic:
        return np.empty((2, 0))
    whole = model.bodies()
    whole.armature = np.zeros(whole.nv)
    acting = replace(motion, robot=replace(model.robot, model=whole))
    out = np.empty((2, len(elastic)))
    for i, law in enumerate(elastic):
        effect, shape = of_kind(law.effect, TransmissionLaw), law.effect.shape(law.parameters)
        parts = effect.deflection(acting.at(law.joints), **shape)
        z = sum((c * d for c, d in zip(effect.coefficients(law.parameters), parts, strict=True)), np.zeros((1, 1)))
        out[:, i] = z[k, 0], (z[k + 1, 0] - z[k - 1, 0]) / (2 * motion.dt)
    return out


def _mean_torques(torque: Array, stride: int, parts: int, held: bool) -> Array:
    """Mean torque of each step, for torque (W, N, n) that is linear between samples, or held from each to the next."""
    if held:
        torque = torque[:, :-1].reshape(len(torque), -1, stride, torque.shape[2]).mean(axis=2)
        return np.asarray(np.repeat(torque, parts, axis=1))
    if stride > 1:
        middle = (torque[:, 1:] + torque[:, :-1]) / 2
        return np.asarray(middle.reshape(len(torque), -1, stride, torque.shape[2]).mean(axis=2))
    share = (np.arange(parts)[:, None] + 0.5) / parts
    steps = torque[:, :-1, None] * (1 - share) + torque[:, 1:, None] * share
    return np.asarray(steps.reshape(len(torque), -1, torque.shape[2]))
