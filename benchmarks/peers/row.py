"""Results of the three tools on one case."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .ask import Peer
from .faults import Arm, Case, record
from .findings import Result, diagnose
from .job_files import hand_over

Answer = dict[str, Any]

DECLARED = 1.2  # error limit of a joint over its validation error on the healthy robot [1]


@dataclass(frozen=True)
class PeerResult:
    """Result of a peer on one case; without answer if the peer is not installed or not applicable."""

    answer: Answer | None
    new: tuple[str, ...] = ()  # report lines absent for the healthy robot, numbers and names aside
    beyond: tuple[str, ...] = ()  # joints with a validation error above the limit
    ratio: float | None = None  # cost or error over that of the healthy robot [1]
    named: bool = False  # a new line contains a word for the cause


@dataclass(frozen=True)
class Row:
    """Results on one case."""

    case: Case
    signid: Result
    figaroh: PeerResult
    mujoco: PeerResult


def measure(
    arm: Arm, cases: Sequence[Case], peers: tuple[Peer, Peer], durations: tuple[float, float, float], folder: Path
) -> Iterator[Row]:
    """Record each case, run all three tools, and compare the peers' answers with those on the healthy robot.

    Args:
        arm: robot.
        cases: cases, the healthy robot first.
        peers: figaroh and mujoco.sysid.
        durations: durations of the two recordings and of the closed-loop simulation [s].
        folder: folder of the job files, with the description.
    """
    first: tuple[Answer | None, ...] = ()
    for case in cases:
        train, test = (record(arm, case, seed, duration) for seed, duration in enumerate(durations[:2]))
        hand_over(arm, train, test, durations[2], folder)
        answers = tuple(None if case.declared else peer.ask(folder) for peer in peers)
        first = first or answers
        compared = (compare(case, *pair) for pair in zip(answers, first, strict=True))
        yield Row(case, diagnose(case, folder, train, test), *compared)


def compare(case: Case, answer: Answer | None, healthy: Answer | None) -> PeerResult:
    """Compare an answer with that on the healthy robot."""
    if answer is None or healthy is None or "failed" in answer or "failed" in healthy:
        return PeerResult(answer)
    known = {_kind(line) for line in healthy["insights"]}
    new = tuple(line for line in answer["insights"] if _kind(line) not in known)
    limits = {name: DECLARED * x for name, x in healthy.get("joints", {}).items()}
    beyond = tuple(name for name, limit in limits.items() if not answer["joints"][name] <= limit)
    size = "cost" if "cost" in answer else "rmse"
    named = any(word in line.lower() for line in new for word in case.words)
    return PeerResult(answer, new, beyond, answer[size] / healthy[size], named)


def _kind(line: str) -> str:
    """Report line without numbers and listed parameters."""
    return re.sub(r"[-+]?\d[\d.e+-]*", "#", re.sub(r"(Parameter) \S+", r"\1", line).partition(":")[0])
