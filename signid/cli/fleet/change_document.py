"""Changes and outliers of a fleet, and its causes, for fleet.json and in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...effects import EFFECTS
from ...output.report.results.fleet import change_sentence, outlier_sentence
from ...output.report.results.sentences import Named, Value, subject
from . import changes as stated
from .changes import ParameterChange
from .summary import Cause, Number


def change_document(
    changes: Sequence[ParameterChange], outliers: Sequence[ParameterChange], tested: tuple[int, int]
) -> dict[str, Any]:
    """Changes between sessions, outliers between robots, and the stated priors and spreads of both."""
    return {
        "changes": [one | {"sentence": change_sentence(one)} for one in map(_change, changes)],
        "outliers": [one | {"sentence": outlier_sentence(one)} for one in map(_outlier, outliers)],
        "comparison": {
            "prior": stated.PRIOR,
            "threshold": stated.SURE,
            "change_spread": stated.WIDTH,
            "session_spread": stated.DAYS,
            "robot_spread": stated.ROBOTS,
            "base_spread": stated.RIGID,
            "changes_tested": tested[0],
            "outliers_tested": tested[1],
        },
    }


def cause_named(cause: Cause) -> Named:
    """A cause for its wording."""
    numbers = {number.what.rpartition(": ")[2]: Value(*number[2:4], number.unit) for number in cause.numbers}
    return Named(EFFECTS[cause.effect], cause.joint, cause.partner, numbers)


def number_title(number: Number) -> str:
    """A parameter in words: its law and joints, and the parameter if the law has several."""
    if number.effect not in EFFECTS.names:
        return f"base parameter {number.what}" if not number.effect else number.what
    effect, key = EFFECTS[number.effect], number.what.rpartition(": ")[2]
    words = subject(Named(effect, number.joint, number.partner, {key: Value(*number[2:4], number.unit)}))
    return f"{words} ({key.replace('_', ' ')})" if len(effect.parameters) > 1 else words


def _compared(one: ParameterChange) -> dict[str, Any]:
    number = one.number
    return {
        "name": one.at.robot,
        "kind": one.at.summary.kind,
        "number": number.what,
        "title": number_title(number),
        "effect": number.effect or None,
        **{key: getattr(number, key) for key in ("joint", "partner", "unit")},
        "finding": one.found,
        "probability": one.probability,
        "log_bayes_factor": one.odds,
        "spread": one.spread,
        "change": number.value - one.centre,
    }


def _change(one: ParameterChange) -> dict[str, Any]:
    last = one.others[-1]
    before = {"sessions": [other.session for other in one.others], "time": last.time}
    after = {"session": one.at.session, "time": one.at.time, "value": one.number.value, "std": one.number.std}
    return {**_compared(one), "before": {**before, "value": one.centre, "std": one.centre_std}, "after": after}


def _outlier(one: ParameterChange) -> dict[str, Any]:
    ends = {"least": one.least, "median": one.centre, "most": one.most}
    own = {"session": one.at.session, "value": one.number.value, "std": one.number.std}
    return {**_compared(one), **own, "others": {"robots": [other.robot for other in one.others], **ends}}
