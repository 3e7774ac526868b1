"""Suggest a column map for columns that do not match a robot; for the user to review, never applied."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher
from typing import NamedTuple

import numpy as np

from ..types import Robot
from .mapping import split

ALIKE = 0.6  # minimum similarity of two names for a suggestion [1]
INLINE = 110  # maximum length of a map within a message [characters]
OFFER = "; a column map (--columns)"
TABLE = "[joints]"
WORDS: Mapping[str, tuple[str, ...]] = {
    "q": ("q", "pos", "position", "positions", "angle", "theta"),
    "dq": ("dq", "qd", "vel", "velocity", "velocities", "speed", "omega"),
    "ddq": ("ddq", "qdd", "acc", "acceleration", "accelerations"),
    "tau": ("tau", "torque", "torques", "trq", "effort", "efforts"),
    "current": ("current", "currents", "cur"),
    "t": ("t", "time", "timestamp", "stamp", "clock"),
}
DESIRED = ("des", "desired", "cmd", "command", "commanded", "target", "ref", "reference", "goal", "setpoint")
UNITS = {"deg": "deg", "ms": "ms", "us": "us", "ns": "ns", "nsec": "ns", "mm": "mm", "rpm": "rpm", "ma": "mA"}
PLAIN = ("rad", "nm", "sec", "secs", "seconds")  # the units of recordings
NUMBER = re.compile(r"(?:joint|axis|motor|link|j|a|m)?0*(\d+)")


class _Guess(NamedTuple):
    """Possible meaning of a column."""

    column: str
    kind: str
    joint: str  # name in the source
    unit: str
    plain: bool  # whether the column is named like a signal: kind, underscore, joint


def propose(columns: Sequence[str], robot: Robot) -> tuple[str, ...]:
    """Lines of a column map that may match the columns to the robot; none if all match or no name is similar."""
    guesses = [guess for column in columns if (guess := _guess(column))]
    known = {*robot.joints, *(str(number) for number in robot.numbers)}
    unmatched = [guess for guess in guesses if guess.kind != "t" and not (guess.plain and guess.joint in known)]
    have = {guess.joint for guess in guesses if guess.plain and guess.kind == "q"}
    lacking = [j for j, n in zip(robot.joints, robot.numbers, strict=True) if not {j, str(n)} & have]
    tokens = list(dict.fromkeys(guess.joint for guess in unmatched))
    pattern, match = _match(tokens, lacking, robot)
    named = {guess.joint for guess in unmatched if guess.plain}
    lines = []
    if pattern and set(match) <= named:
        lines.append(f"joints = {_quoted('*'.join(pattern))}")
    elif match and set(match) <= named:
        lines += [TABLE, *(f"{_key(joint)} = {_quoted(token)}" for token, joint in match.items())]
    else:
        signals: dict[str, _Guess] = {}
        for guess in unmatched:
            if guess.joint in match:
                signals.setdefault(f"{guess.kind}_{match[guess.joint]}", guess)
        lines += [_line(key, guess) for key, guess in signals.items()]
    if "t" not in columns and (time := next((guess for guess in guesses if guess.kind == "t"), None)):
        lines.insert(0, _line("t", time))
    return tuple(lines)


def suggest(columns: Sequence[str], robot: Robot) -> str:
    """End of a message about columns that do not match; "" without a suggestion."""
    lines = list(propose(columns, robot))
    if not lines:
        return ""
    if TABLE in lines:
        at = lines.index(TABLE)
        lines[at:] = [f"joints = {{ {', '.join(lines[at + 1 :])} }}"]
    text = "; ".join(lines)
    content = f" with {text}" if len(text) <= INLINE else f" that begins {text[: INLINE - 4]} ..."
    return f"{OFFER}{content} may fit: signid convert --robot prints it"


def _guess(column: str) -> _Guess | None:
    if column == "t":
        return _Guess(column, "t", "", "", True)
    if pairs := split(column):
        return _Guess(column, *pairs[0], "", True)
    words = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", column)
    lower = [word.lower() for word in words]
    unit = next((UNITS[word] for word in lower if word in UNITS), "")
    rest = [word for word in lower if word not in UNITS and word not in PLAIN and word not in DESIRED]
    kinds = [kind for kind, known in WORDS.items() if any(word in known for word in rest)]
    desired = any(word in DESIRED for word in lower)
    if len(kinds) != 1 or (desired and kinds != ["q"]):
        return None
    token = "_".join(word for word in rest if word not in WORDS[kinds[0]])
    if bool(token) == (kinds == ["t"]):
        return None
    return _Guess(column, "q_des" if desired else kinds[0], token, unit, False)


def _match(tokens: Sequence[str], joints: Sequence[str], robot: Robot) -> tuple[tuple[str, str] | None, dict[str, str]]:
    """Joints by their names in the source, and the common prefix and suffix of these names, if any."""
    around: dict[tuple[str, str], dict[str, str]] = {}
    for token in tokens:
        for joint in joints:
            before, found, behind = token.partition(joint)
            if found and not before[-1:].isalnum() and not behind[:1].isalnum():
                around.setdefault((before, behind), {})[token] = joint
    if around:
        best = max(around, key=lambda each: len(around[each]))
        if len(around[best]) > 1 or len(joints) == 1:
            return (best if any(best) else None), around[best]
    if not tokens or not joints:
        return None, {}
    from scipy.optimize import linear_sum_assignment  # imported here, because it is slow

    alike = np.array([[_likeness(token, joint, robot, tokens) for joint in joints] for token in tokens])
    pairs = zip(*linear_sum_assignment(-alike), strict=True)
    return None, {tokens[i]: joints[j] for i, j in pairs if alike[i, j] >= ALIKE}


def _likeness(token: str, joint: str, robot: Robot, tokens: Sequence[str]) -> float:
    one, other = (re.sub(r"[^a-z0-9]", "", name.lower()) for name in (token, joint))
    if one == other:
        return 1.0
    numbers = [int(found[1]) for name in tokens if (found := NUMBER.fullmatch(name.lower().replace("_", "")))]
    mine = NUMBER.fullmatch(one)
    if mine and int(mine[1]) + (0 in numbers) == robot.numbers[robot.index(joint)]:
        return 0.9
    inside = 0.8 if min(len(one), len(other)) > 2 and (one in other or other in one) else 0.0
    return max(inside, SequenceMatcher(None, one, other).ratio())


def _line(key: str, guess: _Guess) -> str:
    column = _quoted(guess.column)
    return f"{_key(key)} = " + (f"{{ column = {column}, unit = {_quoted(guess.unit)} }}" if guess.unit else column)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _quoted(text: str) -> str:
    """TOML basic string, which equals a JSON string."""
    return json.dumps(text, ensure_ascii=False)
