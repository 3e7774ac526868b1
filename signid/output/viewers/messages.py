"""Messages of a log, which a replay, a diagnosis and a watch send to files of viewers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ...types import Array, Frozen
from ..replay.marks import Mark

QUANTITIES = ("effort", "position", "velocity")  # of a signal


@dataclass(frozen=True, eq=False)
class Signal(Frozen):
    """One kind of signal of n joints at N instants; None: the signal has no such quantity."""

    topic: str
    curves: Mapping[str, tuple[str, ...]]  # place and name of the curves of each quantity in Rerun
    joints: tuple[str, ...]
    t: Array  # (N,) [s], as in the recording
    position: Array | None = None  # (N, n) [rad or m]
    velocity: Array | None = None  # (N, n) [rad/s or m/s]
    effort: Array | None = None  # (N, n) [N.m or N]; NaN where torque was not recorded
    drawn: bool = False  # whether its positions move the links


class Findings(NamedTuple):
    """Verdict and findings of a diagnosis."""

    t: float  # [s]
    verdict: str
    marks: Sequence[Mark]


class Arrow(NamedTuple):
    """Force on a link at a centre of mass, in the world."""

    tip: Array  # (3,) [m]
    way: Array | None  # (3,) from tail to tip [m]; None if the direction is unknown
    radius: float  # [m]
    ended: bool
    removed: bool  # whether no external force explains it


class Remark(NamedTuple):
    """An event of a watch."""

    t: float  # [s]
    sentence: str
    document: str  # JSON
    warning: bool
    arrow: Arrow | None = None


class Head(NamedTuple):
    """Robot, title and notes of a log."""

    robot: str
    title: str
    dated: bool = False  # whether time stamps count from 1970
    notes: Sequence[str] = ()
    identity: str | None = None  # None: any
