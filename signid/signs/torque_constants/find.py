"""Unsigned currents with unknown torque constants -> the constants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import OptionError, RecordingError, shorten
from ...model import stated_inertials
from ...recording import same_joints, with_signs
from ...regression.factors import Factors
from ...regression.rows import Task
from ...regression.session import Session
from ...types import Array, Frozen, Mask, Progress, Recording, Robot, prismatic_unit
from ..infer import infer
from ..observations import Observed, observe
from ..result import Gain, Signs
from ..samples.rows_of_file import signs_of_rows
from ..thresholds import INERTIAL_ERROR
from .constants import Constants, combine, describe_constants, share_constants

ROUNDS = 5  # most rounds of signs and constants in turn
SETTLED, CALM = 0.01, 0.1  # change of a constant at which rounds end: relative [1], in its standard deviations [1]
LOOSE = 0.3  # relative standard deviation [1] above which a constant counts as unknown
ROUGH = 0.1  # the same, above which a constant is flagged as rough


@dataclass(frozen=True, eq=False)
class TorqueConstants(Frozen):
    """Torque constants that n joints lacked."""

    gains: tuple[Gain, ...]  # of the joints where they were unknown
    value: Array  # (n,) [N.m/A or N/A] where the constant was unknown, else 1
    covariance: Array  # (n, n) [1] of its logarithm, 0 elsewhere
    notes: tuple[str, ...]
    flags: tuple[str, ...]

    def scale(self, recording: Recording) -> Recording:
        """The recording with its currents as torques."""
        return replace(recording, torque_per_unit=recording.torque_per_unit * self.value, scaled=None)

    def describe(self, signs: Signs) -> Signs:
        """The signs found in scaled recordings, with constants, notes and flags."""
        notes, flags = (*self.notes, *signs.notes), (*self.flags, *signs.flags)
        return replace(signs, gains=self.gains, notes=notes, flags=flags)


def find_gains(session: Session, progress: Progress | None = None) -> TorqueConstants | None:
    """The torque constants that recordings lack; None where they lack none.

    Each joint's signs are searched by itself, where its constant does not matter; the signed currents determine the
    constants, by the base parameters that joints share, and with those the signs are searched in all joints together;
    again until nothing changes. Where no joint's constant is known, or where joints share too little, the inertials
    that the description states set the scale. Recordings of which a part is learned from are used, whole.

    Raises:
        OptionError: a constant is not identifiable; the sentence says what to state.
    """
    robot, unknown = session.robot, _unknown(session.recordings)
    if not unknown.any():
        return None
    if progress is not None:
        progress("finding torque constants from", 0.0)
    observed = observe(session.task, session.learned)
    anchors = observed.known & ~unknown
    if not anchors.any() and not stated_inertials(robot).any():
        raise OptionError(
            f"the torque constants of {_names(robot, unknown)} are not known, no torque of another joint is, and the "
            f"description states no inertials to set the scale; {_state(robot, unknown)}, of one at least"
        )
    constants = _settle(session, observed, unknown)
    lost = unknown & ~(constants.std <= LOOSE)
    if lost.any():
        raise OptionError(
            f"the torque constant of {_names(robot, lost)} is not known, and neither parameters shared with other "
            f"joints nor stated inertials determine it to {100 * LOOSE:.0f} %; {_state(robot, lost)}, or leave out the "
            f"column of the current"
        )
    value, std = np.where(unknown, np.exp(constants.log), 1.0), np.where(unknown, constants.std, 0.0)
    covariance = np.where(np.outer(unknown, unknown), constants.covariance, 0.0)
    gains = tuple(
        Gain(robot.joints[j], float(value[j]), float(value[j] * std[j]), _unit(robot, j))
        for j in np.flatnonzero(unknown).tolist()
    )
    notes = tuple(_notes(robot, gains, std[unknown], anchors, constants.described))
    return TorqueConstants(gains, value, covariance, notes, tuple(_flags(robot, std, constants)))


def _unknown(recordings: Sequence[Recording]) -> Mask:
    """(n,) joints whose torque constant is not known, in all recordings alike."""
    joints = same_joints(recordings)
    lacking = np.array([np.zeros(len(joints), bool) if r.scaled is None else ~r.scaled for r in recordings])
    for j in np.flatnonzero(lacking.any(axis=0) & ~lacking.all(axis=0)).tolist():
        one, other = recordings[int(np.argmax(lacking[:, j]))], recordings[int(np.argmin(lacking[:, j]))]
        raise RecordingError(
            f"{one.path or 'one recording'} lacks the torque constant of {joints[j]}, {other.path or 'another'} needs "
            f"none; state torque_constant of it in an actuators file, or use recordings of one kind together"
        )
    return np.asarray(lacking[0])


def _settle(session: Session, observed: Observed, unknown: Mask) -> Constants:
    """Signs and constants in turn."""
    found = Constants(np.zeros(len(unknown)), np.diag(np.where(unknown, np.inf, 0.0)))
    signs = np.zeros_like(observed.torque)
    for _ in range(ROUNDS):
        last, signs = signs, _signs(session.task, observed, found, session.options.seed)
        if np.array_equal(last, signs):
            break
        before, found = found, _constants(session.task, _factors(session, observed, signs), unknown)
        change = np.abs(found.log - before.log)
        if last.any() and np.all(change <= np.maximum(SETTLED, CALM * found.std)):
            break
    else:
        return replace(found, settled=False)
    return found


def _signs(task: Task, observed: Observed, found: Constants, seed: int) -> Array:
    """Signs (N, n) [1]: joints with known constants together, each other joint by itself."""
    known = found.std <= LOOSE
    alone = np.diag(observed.known & ~known)
    signs = np.sign(observed.torque)
    for group in (observed.known & known, *alone[alone.any(axis=1)]):
        if (group & ~observed.signed).any():
            torque = np.where(group, observed.torque * np.exp(found.log), 0.0)
            inferred = infer(task, replace(observed, known=group, torque=torque), seed)
            signs[:, group] = inferred.refined.signs[:, group]
    return signs


def _factors(session: Session, observed: Observed, signs: Array) -> Factors:
    """Factors of the recordings with their signs, in the units recorded."""
    parts = []
    for k, (recording, sampling) in enumerate(session.learned):
        at = observed.part == k
        t, first, own = observed.t[at], np.flatnonzero(observed.first[at]), signs[at].astype(np.int8)
        parts.append((with_signs(recording, signs_of_rows(recording, sampling, t, first, own)), sampling))
    return session.reduce(parts)


def _constants(task: Task, factors: Factors, unknown: Mask) -> Constants:
    """Constants from parameters shared with joints of known constant; from the description where that is too little."""
    recorded = np.array([joint.counts[0] > 0 for joint in factors.joints])
    anchors = recorded & ~unknown
    shared = share_constants(factors, task.base, unknown) if anchors.any() else None
    if shared is not None and np.all(shared.std[unknown] <= LOOSE):
        return shared
    described = describe_constants(task, factors)
    reference = int(np.argmin(np.where(unknown, described.std, np.inf)))
    if shared is not None and not np.isfinite(described.std[reference]):
        return shared
    relative = share_constants(factors, task.base, recorded & (np.arange(len(unknown)) != reference))
    return replace(combine(relative, described, anchors), described=True)


def _state(robot: Robot, joints: Mask) -> str:
    units = sorted({_unit(robot, j) for j in np.flatnonzero(joints).tolist()})
    return f"state torque_constant [{' or '.join(units)} at the joint] in an actuators file"


def _unit(robot: Robot, joint: int) -> str:
    return prismatic_unit("N.m/A") if robot.prismatic[joint] else "N.m/A"


def _names(robot: Robot, joints: Mask) -> str:
    return shorten([robot.joints[j] for j in np.flatnonzero(joints)])


def _notes(robot: Robot, gains: Sequence[Gain], std: Array, anchors: Mask, described: bool) -> Iterator[str]:
    found = [f"{joint} {k:.3g} {unit} (+- {100 * s:.2g} %)" for (joint, k, _, unit), s in zip(gains, std, strict=True)]
    yield f"unknown torque constants were found from the motion: {shorten(found)}"
    if anchors.any():
        yield f"torque constants rest on the torque of {_names(robot, anchors)}, which depends on the same inertials"
    if described:
        more = "also " if anchors.any() else ""
        yield (
            f"torque constants rest {more}on the inertials that the description states, taken to be right to "
            f"{100 * INERTIAL_ERROR:.0f} % a link"
        )
    yield "standard deviations of parameters include the common uncertainty of these torque constants"


def _flags(robot: Robot, std: Array, found: Constants) -> Iterator[str]:
    if not found.settled:
        yield (
            f"signs and torque constants still changed in the last of {ROUNDS} rounds: either may be wrong; state "
            f"torque_constant in an actuators file"
        )
    rough = np.flatnonzero(std > ROUGH)
    if len(rough):
        listed = shorten([f"{robot.joints[j]} ({100 * std[j]:.0f} %)" for j in rough])
        yield (
            f"torque constants are known only roughly, of {listed}: parameters there may be off by as much; "
            f"state torque_constant in an actuators file"
        )
