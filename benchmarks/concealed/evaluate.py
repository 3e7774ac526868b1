"""Comparison of a diagnosis with the concealed faults."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .names import Truth, contains, is_lead, is_right, is_twin, truths
from .numbers import error

SURE = 0.95  # probability above which a wrong first cause counts as sure [1]


@dataclass(frozen=True)
class Evaluation:
    """Evaluation of one session."""

    suite: str
    robot: str
    joints: int
    effect: str  # all concealed effects
    size: float
    key: str
    name: str  # name of its folder
    outcome: str  # right stated twin lead unknown missed wrong; healthy robots: right alarm; pairs: both one none
    first: str  # the first named cause, "unknown" or "nothing"
    sure: bool  # the first cause is wrong with P > .95
    spurious: int  # number of spurious causes
    names: tuple[tuple[float, bool], ...]  # probability of each cause, and whether it is right
    errors: tuple[tuple[str, float], ...]  # effects and parameter errors of right causes
    after: float  # residual over the noise floor, rms over joints
    cpu: float  # processor time [s]
    hard: bool


def evaluate(answer: Mapping[str, Any], result: Mapping[str, Any]) -> Evaluation:
    """Evaluate a session from its answer and its diagnosis.json."""
    document, hidden = result["document"], truths(answer)
    causes = [x for x in document["findings"] if x["role"] == "cause"] if document["verdict"] == "named" else []
    right = [any(is_right(cause, truth) for truth in hidden) for cause in causes]
    outcome = _outcome(answer, document, causes, hidden)
    sure = bool(causes) and not right[0] and float(causes[0]["probability"]) > SURE
    first = causes[0]["effect"] if causes else "unknown" if document["verdict"] == "unknown" else "nothing"
    return Evaluation(
        suite=answer["suite"],
        robot=answer["robot"],
        joints=len(answer["joints"]),
        effect="+".join(answer["effects"]),
        size=answer["size"],
        key=answer["key"],
        name=answer["name"],
        outcome=outcome,
        first=first,
        sure=sure,
        spurious=max(right.count(False) - (outcome in ("stated", "twin", "wrong")), 0),
        names=tuple((float(c["probability"]), ok) for c, ok in zip(causes, right, strict=True)),
        errors=tuple(_errors(causes, hidden, answer)),
        after=_after(document["fit"]["after"]),
        cpu=float(result["cpu"]),
        hard=bool(answer["hard"]),
    )


def _outcome(
    answer: Mapping[str, Any], document: Mapping[str, Any], causes: Sequence[Mapping[str, Any]], hidden: Sequence[Truth]
) -> str:
    suite, verdict = answer["suite"], document["verdict"]
    if suite == "none":
        return "right" if verdict == "nothing_missing" else "alarm"
    if suite == "pairs":
        wholes = [cause for cause in causes if any(is_right(cause, truth) for truth in hidden)]
        named = sum(
            any(is_right(c, truth) for c in causes) or any(contains(c, truth) for c in wholes) for truth in hidden
        )
        return ("none", "one", "both")[named]
    (truth,) = hidden
    if suite in ("absent", "removed") and verdict == "unknown":
        return "right" if is_lead(document, truth) else "unknown"
    if verdict == "unknown":
        listed = any(is_right(name, truth) for name in _listed(document["findings"]))
        return "lead" if listed or is_lead(document, truth) else "unknown"
    if not causes:
        return "missed"
    if suite == "removed":
        near = is_twin(causes[0], truth, answer["joints"]) or contains(causes[0], truth)
        return "twin" if near else "wrong"
    if is_right(causes[0], truth):
        return "right"
    if any(is_right(name, truth) for name in _listed(causes)):
        return "stated"
    return "twin" if is_twin(causes[0], truth, answer["joints"]) else "wrong"


def _listed(findings: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Findings and their alternatives."""
    for finding in findings:
        yield finding
        yield from finding["alternatives"]


def _errors(
    causes: Sequence[Mapping[str, Any]], hidden: Sequence[Truth], answer: Mapping[str, Any]
) -> Iterator[tuple[str, float]]:
    """Parameter errors of each right cause; none for foreign and absent laws."""
    if answer["suite"] in ("foreign", "absent"):
        return
    for truth in hidden:
        for cause in causes:
            if is_right(cause, truth):
                found = error(truth.effects[0], cause["parameters"], truth.parameters, len(answer["joints"]))
                if math.isfinite(found):
                    yield truth.effects[0], found


def _after(fit: Mapping[str, Any]) -> float:
    """Rms over joints of held-out residual over irreducible residual; NaN where the latter is zero."""
    pairs = zip(fit["held_out_rms"], fit["irreducible_rms"], strict=True)
    ratios = [float(x) / float(floor) for x, floor in pairs if x is not None and floor]
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else math.nan
