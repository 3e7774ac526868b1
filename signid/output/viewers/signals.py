"""Content of a log: signals of recordings and models over time, and findings."""

from __future__ import annotations

from dataclasses import dataclass

from ...types import Array, Frozen, Robot
from ..replay.marks import Mark

MODELS = ("predicted", "extended")  # signals of the given simulation, and of the extended one
QUANTITIES = ("position", "velocity", "effort")  # of a signal
RESIDUALS = ("residual", "residual_extended")  # measured minus these
ROLLED = ("simulated", "simulated_extended")  # positions of roll-outs


@dataclass(frozen=True, eq=False)
class LoggedSignal(Frozen):
    """One kind of signal of n joints at N instants; None: the signal has no such quantity."""

    name: str
    t: Array  # (N,) [s], as in the recording
    position: Array | None = None  # (N, n) [rad or m]
    velocity: Array | None = None  # (N, n) [rad/s or m/s]
    effort: Array | None = None  # (N, n) [N.m or N]; NaN where torque was not recorded


@dataclass(frozen=True, eq=False)
class LoggedRecording(Frozen):
    """Signals of one recording."""

    name: str  # "" if it is the only one
    joints: tuple[str, ...]
    signals: tuple[LoggedSignal, ...]


@dataclass(frozen=True, eq=False)
class LogContent(Frozen):
    """Signals of recordings, and findings."""

    robot: str
    recordings: tuple[LoggedRecording, ...]
    marks: tuple[Mark, ...]  # findings of the diagnosis
    headline: str  # verdict of the diagnosis; "" without one
    dated: bool  # whether time stamps count from 1970
    notes: tuple[str, ...]
    drawn: Robot | None = None  # over the joints of the only recording

    @property
    def start(self) -> float:
        """First time stamp [s]."""
        return min(float(signal.t[0]) for one in self.recordings for signal in one.signals)

    @property
    def shift(self) -> float:
        """Time stamp [s] that becomes 0 in MCAP, which has no time before 0; 0 if no stamp is negative."""
        return min(self.start, 0.0)
