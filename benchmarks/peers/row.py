"""One case, and what the three say of it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .ask import Peer
from .faults import Arm, Case, record
from .handed import hand_over
from .said import Said, say

Answer = dict[str, Any]

DECLARED = 1.2  # times the healthy robot's validation error of a joint: a limit that a user may set


@dataclass(frozen=True)
class Heard:
    """What a peer says of one case; nothing where it is not installed or cannot be told."""

    answer: Answer | None
    new: tuple[str, ...] = ()  # lines of its report that the healthy robot has not, but for numbers and names
    beyond: tuple[str, ...] = ()  # joints whose validation error is beyond the limit
    ratio: float | None = None  # of its cost or error over that of the healthy robot
    named: bool = False  # whether a new line has a word for the cause


@dataclass(frozen=True)
class Row:
    """One case."""

    case: Case
    signid: Said
    figaroh: Heard
    mujoco: Heard


def measure(
    arm: Arm, cases: Sequence[Case], peers: tuple[Peer, Peer], durations: tuple[float, float, float], folder: Path
) -> Iterator[Row]:
    """Record each case, hand it to all three, and hold the peers' answers against those on the first, healthy one.

    Args:
        arm: the robot.
        cases: the first is healthy.
        peers: figaroh and mujoco.sysid.
        durations: of the two recordings, and of what is simulated in closed loop [s].
        folder: for what is handed over; the description is there.
    """
    first: tuple[Answer | None, ...] = ()
    for case in cases:
        train, test = (record(arm, case, seed, duration) for seed, duration in enumerate(durations[:2]))
        hand_over(arm, train, test, durations[2], folder)
        answers = tuple(None if case.told else peer.ask(folder) for peer in peers)
        first = first or answers
        heard = (hear(case, *pair) for pair in zip(answers, first, strict=True))
        yield Row(case, say(case, folder, train, test), *heard)


def hear(case: Case, answer: Answer | None, healthy: Answer | None) -> Heard:
    """An answer held against that on the healthy robot."""
    if answer is None or healthy is None or "failed" in answer or "failed" in healthy:
        return Heard(answer)
    known = {_kind(line) for line in healthy["insights"]}
    new = tuple(line for line in answer["insights"] if _kind(line) not in known)
    limits = {name: DECLARED * x for name, x in healthy.get("joints", {}).items()}
    beyond = tuple(name for name, limit in limits.items() if not answer["joints"][name] <= limit)
    size = "cost" if "cost" in answer else "rmse"
    named = any(word in line.lower() for line in new for word in case.words)
    return Heard(answer, new, beyond, answer[size] / healthy[size], named)


def _kind(line: str) -> str:
    """A line without its numbers, and without the parameters that it lists."""
    return re.sub(r"[-+]?\d[\d.e+-]*", "#", re.sub(r"(Parameter) \S+", r"\1", line).partition(":")[0])
