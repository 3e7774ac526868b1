"""Recordings -> windows of a roll-out, with the joints that move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...effects.base import ActuatorLaw, BodyLaw, RecordingLaw, TransmissionLaw, of_kind
from ...errors import RecordingError
from ...model import Model
from ...recording import same_joints
from ...recording.sampling import Sampling, samples
from ...recording.sampling.grid import Span
from ...regression.bandwidth import Band
from ...regression.motion import Motion, build_motion, margin
from ...regression.session import Part
from ...robot import hold, resting
from ...types import Array, Frozen, Law, Mask, Recording
from ..plant.plant import apply_actuators

BEFORE, AFTER = 1.0, 0.1  # [s] motion before a window for laws with memory; largest shift of signals by recording laws


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
    before, after = _reach(model, period)
    more = _reach(model if beside is None else beside, period)
    edge, after = margin(band), max(after, more[1])
    lead = max(before, after, *more)
    whole = edge + lead + size + after + edge + 1
    places = _places(sampling, whole, count)
    if not places:
        longest = max(sampling.length(span) for span in sampling.spans) * period
        raise RecordingError(
            f"{recording.path or 'the recording'}: windows of {length:g} s need {whole * period:.3g} s without a gap, "
            f"filters included, but the longest stretch lasts {longest:.3g} s; choose shorter horizons"
        )
    motions = [
        _acted(model, build_motion(model.robot, samples(recording, sampling, span, k, k + whole), band, period))
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
        torque=_means(torque[:, inside], stride, parts, held),
        flex=np.stack([_deflections(model, m, lead) for m in motions], axis=1),
        before=v[:, lead - before : lead],
        measured=np.array([bool(c) for c in recording.columns["tau"]]),
        origin=sampling.origin,
    )


def _reach(model: Model, period: float) -> tuple[int, int]:
    """Samples that laws with memory need before a window, and samples by which recording laws shift signals."""
    remembers = any(law.effect.memory or isinstance(law.effect, TransmissionLaw) for law in model.laws)
    before = int(np.ceil(BEFORE / period)) if remembers else 0
    return before, int(np.ceil(AFTER / period)) if model.of(RecordingLaw) else 0


def _places(sampling: Sampling, whole: int, count: int) -> list[tuple[Span, int]]:
    """Spans and their samples at which windows begin, evenly spaced over all possible starts."""
    rooms = [(span, sampling.length(span) - whole + 1) for span in sampling.spans]
    rooms = [(span, room) for span, room in rooms if room > 0]
    ends = np.cumsum([room for _, room in rooms])
    if not rooms:
        return []
    found = np.unique(np.linspace(0, ends[-1] - 1, count).round().astype(int))
    which = np.searchsorted(ends, found, side="right")
    return [(rooms[i][0], int(k - ends[i] + rooms[i][1])) for k, i in zip(found, which, strict=True)]


def _acted(model: Model, motion: Motion) -> Motion:
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


def _means(torque: Array, stride: int, parts: int, held: bool) -> Array:
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
