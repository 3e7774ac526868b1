"""Result of the search for recording faults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..types import Array, Frozen

REFUSE, WARN, NOTE = "refuse", "warn", "note"
UNCERTAIN = "uncertain"  # verdict in files


@dataclass(frozen=True)
class RecordingFault:
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

    @property
    def refusal(self) -> str:
        """Sentence on the first fault that makes later results meaningless; empty without any."""
        return next((f.sentence for f in self.findings if f.severity == REFUSE), "")

    @property
    def flags(self) -> tuple[str, ...]:
        """Sentences on faults, the most severe first."""
        return tuple(f.sentence for severity in (REFUSE, WARN) for f in self.findings if f.severity == severity)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences of findings that are no faults."""
        return tuple(f.sentence for f in self.findings if f.severity == NOTE)

    @property
    def compared(self) -> bool:
        """Whether signed torque was compared with the description; otherwise only samples were examined."""
        return bool(np.isfinite(self.explained).any())
