"""Match columns to the joints of a robot by their names, and suggest a column map; for review, never applied."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher

import numpy as np

from ..errors import shorten
from ..types import Robot
from .mapping import Heading, split
from .meaning import FROM_BASE, Guess, guess

ALIKE = 0.6  # minimum similarity of two names for a suggestion [1]
INLINE = 110  # maximum length of a map within a message [characters]
OFFER = "; a column map (--columns)"
MEANT = "; did you mean "
TABLE = "[joints]"
NUMBER = re.compile(
    r"(?:joints?|axis|axes|achse|axe|eje|gelenk|motors?|servo|drive|actuator|act|link|dof|id|j|a|m|s)?0*(\d+)"
)


def propose(columns: Sequence[str], robot: Robot) -> tuple[str, ...]:
    """Lines of a column map that may match the columns to the robot; none if all match or no name is similar."""
    known = known_joints(robot)
    guesses = [found for column in columns if (found := guess(column, known)) and not (found.desired or found.bare)]
    unmatched = [one for one in guesses if one.kind != "t" and not (one.plain and one.joint in known)]
    lacking = _without(guesses, "q", robot)
    tokens = list(dict.fromkeys(one.joint for one in unmatched))
    pattern, match = _match(tokens, lacking, robot)
    named = {one.joint for one in unmatched if one.plain}
    lines = []
    if pattern and set(match) <= named:
        lines.append(f"joints = {quoted('*'.join(pattern))}")
    elif match and set(match) <= named:
        lines += [TABLE, *(f"{key_of(joint)} = {quoted(token)}" for token, joint in match.items())]
    else:
        lines += [_line(key, one) for key, one in match_signals(guesses, robot) if one in unmatched]
    if "t" not in columns and (time := next((one for one in guesses if one.kind == "t"), None)):
        lines.insert(0, _line("t", time))
    return tuple(lines)


def suggest(columns: Sequence[str], robot: Robot) -> str:
    """End of a message about columns that do not match; "" without a suggestion."""
    known = known_joints(robot)
    guesses = [found for column in columns if (found := guess(column, known)) and not (found.desired or found.bare)]
    strange = [one for one in guesses if not (one.plain and one.joint in known) and one.kind != "t"]
    if strange and "t" in columns and all(one.joint in known and split(one.column) for one in strange):
        meant = shorten([f"{one.kind}_{one.joint}" for one in strange], 3)
        return (
            f"{MEANT}{meant}? In a column map (--columns): {_line(f'{strange[0].kind}_{strange[0].joint}', strange[0])}"
        )
    lines = list(propose(columns, robot))
    if not lines:
        return ""
    if TABLE in lines:
        at = lines.index(TABLE)
        lines[at:] = [f"joints = {{ {', '.join(lines[at + 1 :])} }}"]
    whole, first = "; ".join(lines), lines[0]
    content = f" with {whole}" if len(whole) <= INLINE else f" that begins {first}" if len(first) <= INLINE else ""
    return f"{OFFER}{content} may fit: signid convert --robot prints it, and writes it with --map map.toml"


def known_joints(robot: Robot) -> frozenset[str]:
    """Names and numbers of the joints of a robot."""
    return frozenset([*robot.joints, *(str(number) for number in robot.numbers)])


def heading_lines(heading: Heading) -> list[str]:
    """Lines of a column map with what a file does not say itself; none if it says all."""
    skip = [f"skip = {heading.skip}"] if heading.skip else []
    return [*skip, *([f"names = [{', '.join(map(quoted, heading.names))}]"] if heading.names else [])]


def match_signals(guesses: Sequence[Guess], robot: Robot) -> Iterator[tuple[str, Guess]]:
    """Signal names, such as q_elbow, and their columns, in the order of the columns; each signal once."""
    known, numbers = known_joints(robot), dict(zip(map(str, robot.numbers), robot.joints, strict=True))
    kinds = dict.fromkeys((one.kind, one.desired) for one in guesses if one.kind != "t")
    joints: dict[tuple[str, bool], dict[str, str]] = {}
    for kind, desired in kinds:
        own = [one for one in guesses if (one.kind, one.desired) == (kind, desired)]
        tokens = list(dict.fromkeys(one.joint for one in own if not (one.plain and one.joint in known)))
        joints[kind, desired] = _match(tokens, _without(own, kind, robot), robot)[1]
    seen = set()
    for one in guesses:
        if one.kind == "t":
            continue
        plain = one.joint if one.joint in robot.joints else numbers.get(one.joint, "")
        joint = plain if one.plain and plain else joints[one.kind, one.desired].get(one.joint)
        key = f"{one.kind}_{joint}", one.desired
        if joint and key not in seen:
            seen.add(key)
            yield key[0], one


def _without(guesses: Sequence[Guess], kind: str, robot: Robot) -> list[str]:
    """Joints without a column that is named like their signal of a kind."""
    have = {one.joint for one in guesses if one.plain and one.kind == kind}
    return [j for j, n in zip(robot.joints, robot.numbers, strict=True) if not {j, str(n)} & have]


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
    """Similarity of the name of a joint in the source to that of a joint of the robot, 0 to 1."""
    own = _own_words(tokens, robot)
    one, other = _plain(own[token]), _plain(joint)
    numbers = [int(found[1]) for name in tokens if (found := NUMBER.fullmatch(_plain(own[name])))]
    mine, digits = NUMBER.fullmatch(one), [[*map(int, re.findall(r"\d+", name))][-1:] for name in robot.joints]
    from_zero = 0 in numbers and [0] not in digits
    if mine and numbers:
        number, at = int(mine[1]) + from_zero, robot.index(joint)
        if digits[at] and len({*map(tuple, digits)}) == len(digits):  # the numbers in the names of the joints
            return 0.9 if digits[at] == [number] else 0.0
        if number == robot.numbers[at]:
            return 0.9
    return max(_alike(one, other), _alike(_plain(token), other)) if not (mine and from_zero) else 0.0


def _alike(one: str, other: str) -> float:
    if one == other:
        return 1.0
    inside = 0.8 if min(len(one), len(other)) > 2 and (one in other or other in one) else 0.0
    return max(inside, SequenceMatcher(None, one, other).ratio())


def _own_words(tokens: Sequence[str], robot: Robot) -> dict[str, str]:
    """Names of joints in the source without the words that all of them, and no joint of the robot, have."""
    words = {token: token.split("_") for token in tokens}
    common = set.intersection(*map(set, words.values())) if len(tokens) > 1 else set()
    common = {word for word in common if not any(word.lower() in joint.lower() for joint in robot.joints)}
    return {token: "_".join(word for word in own if word not in common) or token for token, own in words.items()}


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _line(key: str, one: Guess) -> str:
    column, unit = quoted(one.column), "" if one.unit in FROM_BASE else one.unit
    return f"{key_of(key)} = " + (f"{{ column = {column}, unit = {quoted(unit)} }}" if unit else column)


def key_of(name: str) -> str:
    """TOML key."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quoted(name)


def quoted(text: str) -> str:
    """TOML basic string, which equals a JSON string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
