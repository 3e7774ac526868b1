"""Results: recording faults, and the audit of servo joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..frozen import WithSentences
from ..types import Array, Frozen, Input, Recording

REFUSE, WARN, NOTE = "refuse", "warn", "note"
UNCERTAIN = "uncertain"  # verdict in files


@dataclass(frozen=True)
class RecordingFault(WithSentences):
    """Recording fault, with a sentence on the fault, its evidence and how to correct it."""

    kind: str  # "torque sign"
    joints: tuple[str, ...]  # joints with the fault; empty: the recordings as a whole
    severity: str  # "refuse": later results would be meaningless; "warn"; "note"
    measures: Mapping[str, float]
    sentence: str
    alternatives: tuple[tuple[str, tuple[str, ...]], ...] = ()  # kinds and joints that explain it equally well


@dataclass(frozen=True, eq=False)
class RecordingFaults(Frozen):
    """Findings, and their evidence per joint. Verdicts are `right`, `wrong` or, if uncertain, UNCERTAIN."""

    joints: tuple[str, ...]  # n
    explained: Array  # (n,) [1] share of the torque's variance that model, friction and a rotor explain; NaN: no sign
    factor: Array  # (n,) [1] recorded over predicted torque; NaN if it is not identifiable
    lag: Array  # (n,) [s] by which torque is late; NaN if it is not identifiable
    signs: tuple[str, ...]  # (n,) verdicts on the sign of torque relative to position
    order: tuple[str, ...]  # (n,) verdicts on the joint of a torque column
    findings: tuple[RecordingFault, ...]
    weight: Array  # (n,) [1] share of the description's weight in the torque; NaN if it does not show, or with a fault
    tried: tuple[str, ...] = ()  # kinds of faults of the description that were tried

    @property
    def refusal(self) -> str:
        """Sentence on the first fault that makes later results meaningless; empty without any."""
        return next((f.sentence for f in self.findings if f.severity == REFUSE), "")

    @property
    def severe(self) -> tuple[RecordingFault, ...]:
        """Faults without notes, the most severe first."""
        return tuple(fault for severity in (REFUSE, WARN) for fault in self.findings if fault.severity == severity)

    @property
    def flags(self) -> tuple[str, ...]:
        """Sentences on faults, the most severe first."""
        return tuple(fault.sentence for fault in self.severe)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences of findings that are no faults."""
        return tuple(f.sentence for f in self.findings if f.severity == NOTE)

    @property
    def compared(self) -> bool:
        """Whether signed torque was compared with the description; otherwise only samples were examined."""
        return bool(np.isfinite(self.explained).any())


SCHEMA = "signid.check/1"


@dataclass(frozen=True)
class JointAudit(WithSentences):
    """How one joint follows its commanded position; NaN where the recordings do not show it.

    Lengths are in `unit`, "" where the recording does not state one.
    """

    joint: str
    unit: str
    samples: int  # rows with a command while the drive holds
    range: float  # [unit] of the commanded position
    lag: float  # [s] delay of a slow ramp: `delay` and twice damping ratio over natural frequency
    lag_std: float  # [s] standard deviation; large where the motion does not separate lag from dry friction
    shift: float  # [s] best shift of the command, sign and scale free
    delay: float  # [s] pure delay of the second-order response
    bandwidth: float  # [Hz] at which the second-order response falls to 71 %
    residual: float  # [1] rms that the second-order response leaves, over the rms motion
    scale: float  # [1] motion per command; negative: against it
    width: float  # [unit] half width of the hysteresis in motion: dry friction over stiffness, or a dead band
    zero: float  # [unit] mean of q_des - q
    error: float  # [unit] rms of q_des - q
    speed: float  # [unit/s] rms
    droop: float  # [unit] median of |q_des - q| at rest
    droop_most: float  # [unit] its maximum
    holds: int  # times at rest
    dead_band: float  # [unit] half of what the error at rest differs by direction of approach; dry friction adds to it
    saturated: float  # [1] share of rows at full duty, or at the largest speed while the error changes
    command_period: float  # [s] between changes of the command
    command_noise: float  # [unit] std of white noise of the command
    held: float  # [1] share of moving rows that repeat the position before
    quantum: float  # [unit] smallest step of q
    flags: tuple[str, ...] = ()  # faults
    limits: tuple[str, ...] = ()  # what makes the numbers of the audit inexact

    def numbers(self) -> dict[str, Any]:
        """All numbers by name, for JSON."""
        return {item.name: getattr(self, item.name) for item in fields(self) if item.name not in ("flags", "limits")}


@dataclass(frozen=True, eq=False)
class ServoAudit(Frozen):
    """Audit of the servo joints of recordings."""

    joints: tuple[JointAudit, ...]
    recordings: tuple[Recording, ...]
    rates: tuple[float, ...]  # [Hz] per recording
    durations: tuple[float, ...]  # [s] per recording, with a command
    uneven: tuple[float, ...]  # [1] per recording: share of time steps that differ by half from the median
    content_rates: tuple[float, ...]  # [Hz] per recording, of rows that were neither interpolated nor repeated
    stamps: tuple[str, ...]  # faults of stamps, one sentence each
    notes: tuple[str, ...] = ()
    stretches: tuple[tuple[tuple[float, float], ...], ...] = ()  # [s] per recording: rows with a command, without gaps
    commanded: tuple[int, ...] = ()  # per recording: rows with a command

    @property
    def flags(self) -> tuple[str, ...]:
        """Reasons not to rely on the recordings, one sentence each; empty for healthy ones."""
        columns = [flag for recording in self.recordings for flag in recording.flags]
        return tuple(dict.fromkeys((*columns, *self.faults, *self.limits)))

    @property
    def faults(self) -> tuple[str, ...]:
        """Flags of stamps and of joints, without those of the columns of the recordings."""
        return tuple(dict.fromkeys((*self.stamps, *self._by_sentence("flags"))))

    @property
    def breaks(self) -> tuple[int, ...]:
        """Number of breaks of each recording: gaps, and rows without a command."""
        return tuple(max(0, len(stretches) - 1) for stretches in self.stretches)

    @property
    def limits(self) -> tuple[str, ...]:
        """Reasons why numbers of the audit are inexact, without faults."""
        return tuple(self._by_sentence("limits"))

    def _by_sentence(self, kind: str) -> Iterator[str]:
        joints: dict[str, list[str]] = {}  # joints by what is said of them
        for joint in self.joints:
            for flag in getattr(joint, kind):
                joints.setdefault(flag.removeprefix(joint.joint), []).append(joint.joint)
        return (f"{', '.join(names)}{sentence}" for sentence, names in joints.items())


@dataclass(frozen=True)
class UnusableRecordings:
    """Recordings that can be opened and not be checked."""

    files: tuple[Input, ...]
    rows: tuple[int, ...]  # of each file
    flags: tuple[str, ...]  # reasons, with what to correct
    notes: tuple[str, ...] = ()


def named(joints: Sequence[str]) -> str:
    """Names of joints in a sentence: "a", "joints a and b"."""
    return joints[0] if len(joints) == 1 else f"joints {', '.join(joints[:-1])} and {joints[-1]}"


def percent(share: float) -> str:
    """Share in a sentence: "97 %"."""
    return f"{100 * share:.0f} %"
