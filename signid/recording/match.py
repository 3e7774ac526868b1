"""Match columns to kinds of signals and to the joints of a robot by their names; guesses for the user to check."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..types import Robot
from .mapping import DRIVE, split
from .vocabulary import CLOCKS, OF, SPELLINGS, UNITS, VOCABULARY, Word, bracketed, without_unit, words_of

SO_ARM = "shoulderpan rotation;shoulderlift pitch;elbowflex elbow;wristflex wristpitch;wristroll;gripper jaw"
SO_JOINTS = {name: place for place, names in enumerate(SO_ARM.split(";")) for name in names.split()}
MIN_ARM_JOINTS = 5  # joints of an SO arm, without its gripper
MAX_TOKEN_LENGTH = 200  # characters of a name that has a meaning
MIN_TOKEN_SIMILARITY = 0.6  # minimum similarity of two names [1]
JOINT_WORDS = "|".join(word for word, meaning in VOCABULARY.items() if meaning.side == "joint")
NUMBER = re.compile(rf"(?:{JOINT_WORDS}|act|link|id|j|a|m|s)?0*(\d+)")
OF_RATE = {("dq", "deg"): "deg/s", ("dq", "rad"): "rad/s", ("ddq", "deg"): "deg/s2", ("ddq", "rad"): "rad/s2"}
RATES: Mapping[tuple[str, str], str] = {("q", "rate"): "dq", ("dq", "rate"): "ddq", ("q", "second rate"): "ddq"}


class Guess(NamedTuple):
    """Possible meaning of a column."""

    column: str
    kind: str  # q, dq, ddq, tau, current, abs_tau, abs_current, q_des, dq_des, tau_ff, on, pwm, volt, temp, t
    joint: str  # name in the source, "" for t or where the name has none
    unit: str  # "" if the name has none
    plain: bool  # whether the column is named like a signal: kind, underscore, joint
    desired: bool = False  # a commanded acceleration, torque, current or duty, which no recording uses
    counts: bool = False  # whether the name says that these are counts of an encoder
    load: bool = False  # a load, whose unit differs between makers
    bare: bool = False  # a position by words such as cmd and actual alone, by its unit, or by the name of a joint alone


def guess_columns(columns: Sequence[str], robot: Robot) -> list[Guess]:
    """Meanings of the columns that have one, in their order.

    If the robot has one joint, it is that of columns that name none. Positions that are not named so are left out where
    others of their kind are.
    """
    known = known_joints(robot)
    guesses = [one for column in columns if (one := guess(column, known))]
    if not any(one.kind == "t" for one in guesses):
        ticks = {one.column for one in guesses if one.counts and not one.joint and "tick" in one.column.lower()}
        guesses = [one._replace(kind="t", counts=False) if one.column in ticks else one for one in guesses]
    if len(robot.joints) == 1:
        guesses = [one if one.kind == "t" or one.joint else one._replace(joint=robot.joints[0]) for one in guesses]
    guesses = [one for one in guesses if one.joint or one.kind == "t"]
    named = {one.kind for one in guesses if not one.bare}
    guesses = [one for one in guesses if not (one.bare and one.kind in named)]
    if any(one.kind == "q" for one in guesses):
        return guesses
    used = {one.column for one in guesses}
    joints = {_plain(joint) for joint in robot.joints} | {_plain(one.joint) for one in guesses if one.kind == "q_des"}
    alone = []  # columns that name a joint and nothing else
    for column in columns:
        name = _plain(column)
        if column not in used and (name in joints or (NUMBER.fullmatch(name) and not name.isdigit())):
            alone.append(Guess(column, "q", column, "", False, bare=True))
    return [*guesses, *alone] if len(alone) > 1 else guesses


def guess(column: str, known: Collection[str] = ()) -> Guess | None:
    """Guess the meaning of a column by the words of its name; None without a kind of signal.

    `known` are names and numbers of joints: a column such as q_elbow is then one of the joint elbow. Names of more than
    200 characters have no meaning.
    """
    if len(column) > MAX_TOKEN_LENGTH:
        return None
    if column == "t":
        return Guess(column, "t", "", "", True)
    name, unit = bracketed(column)
    if unit and split(name) and (plain := guess(name, known)) and plain.plain:
        return plain._replace(column=column, unit=unit)
    meant = _by_words(column, known)
    if pairs := split(column):
        for kind, token in pairs:
            if token in known:
                return Guess(column, kind, token, "", True)
        pairs = [pair for pair in pairs if pair[0] not in DRIVE]
    if pairs:
        sides = {VOCABULARY.get(word, Word()).side for word in words_of(pairs[0][1])}
        other = meant is None or meant.desired or meant.kind != pairs[0][0]
        stated = sides & {"commanded", "absolute", "none", "rate"} or "current" in column.lower()
        if not (other and (stated or "d" in words_of(pairs[0][1]))):
            return Guess(column, *pairs[0], "", True)
    last = column.rpartition(".")[2]
    if last != column and (meant is None or meant.kind == "t"):
        halved = last.lower() in UNITS  # stamp.secs, beside stamp.nsecs
        stamp = None if halved else guess(last)  # header.stamp
        return stamp._replace(column=column, plain=False) if stamp and stamp.kind == "t" else None if halved else meant
    return meant


def known_joints(robot: Robot) -> frozenset[str]:
    """Names and numbers of the joints of a robot."""
    return frozenset([*robot.joints, *(str(number) for number in robot.numbers)])


def match_signals(guesses: Sequence[Guess], robot: Robot) -> Iterator[tuple[str, Guess]]:
    """Signal names, such as q_elbow, and their columns, in the order of the columns; each signal once."""
    kinds = dict.fromkeys((column.kind, column.desired) for column in guesses if column.kind != "t")
    groups = {kind: [column for column in guesses if (column.kind, column.desired) == kind] for kind in kinds}
    numbers = set[int]()
    for group in groups.values():
        tokens = [*dict.fromkeys(column.joint for column in group)]
        if len(numbered := _numbers(tokens, robot)) == len(tokens):
            numbers |= {*numbered.values()}
    # joints are numbered from zero if one number is zero, none is too large, and no joint is named so
    zero = 0 in numbers and 0 not in last_numbers(robot) and max(_by_number(robot)) not in numbers
    joints = {kind: _joints_of(group, robot, zero) for kind, group in groups.items()}
    seen = set()
    for column in guesses:
        joint = "" if column.kind == "t" else joints[column.kind, column.desired].get(column.joint, "")
        key = f"{column.kind}_{joint}", column.desired
        if joint and key not in seen:
            seen.add(key)
            yield key[0], column


def _match_names(tokens: Sequence[str], joints: Sequence[str], robot: Robot) -> dict[str, str]:
    """Joints by their names in the source, as far as they are alike; `joints` are those to choose from."""
    if not tokens or not joints:
        return {}
    if matched := _by_limb(tokens, joints, robot):
        return matched
    from scipy.optimize import linear_sum_assignment  # imported here, because it is slow

    alike = np.array([[_likeness(token, joint, robot, tokens) for joint in joints] for token in tokens])
    pairs = zip(*linear_sum_assignment(-alike), strict=True)
    return {tokens[i]: joints[j] for i, j in pairs if alike[i, j] >= MIN_TOKEN_SIMILARITY}


def pair_in_order(guesses: Sequence[Guess], signals: Mapping[str, Guess], robot: Robot) -> Iterator[tuple[str, Guess]]:
    """Pair joints without a column with columns without a joint, both in their order; for the user to decide.

    Joints are in the order of their chain, which is reversed if the columns that have a joint run that way.

    signals: columns by signal name, such as q_elbow, that have a joint.
    """
    chain = _chain(robot)
    joints = {column.joint: key[len(column.kind) + 1 :] for key, column in signals.items()}
    measured = [column for column in guesses if column.kind != "t" and not column.desired]
    tokens = dict.fromkeys(column.joint for column in measured if column.kind in ("q", "q_des"))
    places = [chain.index(joints[token]) for token in tokens if token in joints]
    backwards = sum(b < a for a, b in pairwise(places)) > len(places) / 2 - 0.5 and len(places) > 1
    lacking = [joint for joint in (reversed(chain) if backwards else chain) if joint not in joints.values()]
    pairs = dict(zip((token for token in tokens if token not in joints), lacking, strict=False))
    for column in measured:
        if column.joint in pairs and (key := f"{column.kind}_{pairs[column.joint]}") not in signals:
            yield key, column


def _by_words(column: str, known: Collection[str]) -> Guess | None:
    """Guess by the words of a name that is not one of a signal."""
    joint, rest_of_name = _named_joint(column, known)
    text, unit = without_unit(rest_of_name)
    words = words_of(text)
    alone = UNITS.get(text.lower(), "") if len(text) > 1 else ""  # "secs"
    if not joint and (alone if words else unit) in OF["t"][0]:
        return Guess(column, "t", "", alone or unit, False)
    symbols = {"q", "dq", "tau"} & {*words}
    meanings = [VOCABULARY.get(word, Word()) for word in words]
    if "d" in words and symbols:
        meanings[words.index("d")] = Word(side="commanded")
    sides = {meaning.side for meaning in meanings}
    kind, counts, load = _kind([*zip(words, meanings, strict=True)])
    if "none" in sides or kind is None:
        return None
    bare = not kind and bool(unit in ("deg", "rad", "mrad") or (not unit and sides & {"measured", "commanded"}))
    kind = "q" if bare else kind
    rest = [w for w, meaning in zip(words, meanings, strict=True) if meaning.side == "joint" or not any(meaning[::2])]
    last = text.rpartition("_")[2].lower()
    if not unit and rest[1:] and rest[-1] == last and SPELLINGS.get(last) in OF.get(kind, ({},))[0]:
        unit = SPELLINGS[rest.pop()]  # "Strom_1_A"
    if kind == "t" and rest and UNITS.get(rest[-1]) in OF["t"][0]:
        unit = UNITS[rest.pop()]  # "TimeUS"
    if counts and unit in OF["t"][0]:
        kind, counts = "t", False  # "tick_ms"
    token = "" if kind == "t" and CLOCKS.issuperset(rest) else joint or "_".join(rest)
    if not kind or (kind == "t" and token):
        return None
    unit = OF_RATE.get((kind, unit), unit)
    commanded = "commanded" in sides
    if kind == "tau" and "forward" in sides:
        return Guess(column, "tau_ff", token, unit, False)
    if kind in ("tau", "current") and "absolute" in sides:
        kind = f"abs_{kind}"
    if commanded and kind in ("q", "dq"):
        return Guess(column, f"{kind}_des", token, unit, False, counts=counts, bare=bare)
    return Guess(column, kind, token, unit, False, commanded and kind != "t", counts, load, bare)


def _kind(words: Sequence[tuple[str, Word]]) -> tuple[str | None, bool, bool]:
    """Kind of signal, "" without one, None if several are meant; whether it is counted, and whether it is a load."""
    kinds = {meaning.kind for _, meaning in words if meaning.kind and not meaning.weak}
    sides = {meaning.side for _, meaning in words}
    if "enabled" in sides and kinds <= {"tau"}:
        return "on", False, False
    weak = {meaning.kind for _, meaning in words if meaning.weak}
    if kinds == {"q", "current"} and any(word == "q" for word, _ in words):
        kinds = {"current"}  # the current of the q axis
    if len(kinds) > 1:
        kinds -= {"current", "q" if "ang" in dict(words) else ""}  # "current position", "ang_vel"
    if not kinds:
        kinds = {"q"} if "q" in weak else weak
    if len(kinds) > 1:
        return None, False, False
    kind = next(iter(kinds), "")
    rate = next((side for side in sides if side.endswith("rate")), "")
    if rate:
        return RATES.get((kind, rate)), False, False
    if kind == "current" and any(word == "d" for word, _ in words):
        return None, False, False  # the current of the d axis
    return kind, kind == "q" and "q" in weak, kind == "tau" and "tau" in weak


def _named_joint(column: str, known: Collection[str]) -> tuple[str, str]:
    """The joint whose whole name a column has, "" without one, and the column without it."""
    for joint in sorted((name for name in known if not name.isdecimal()), key=len, reverse=True):
        if match := re.search(rf"(?<![^\W_]){re.escape(joint)}(?![^\W_])", column, re.IGNORECASE):
            if rest := (column[: match.start()] + " " + column[match.end() :]).strip(" _/."):
                return joint, rest
    return "", column


def _joints_of(guesses: Sequence[Guess], robot: Robot, zero: bool) -> dict[str, str]:
    """Joints by their names in the columns of one kind; `zero`: whether their numbers begin at zero."""
    numbers = dict(zip(map(str, robot.numbers), robot.joints, strict=True))
    tokens = list(dict.fromkeys(column.joint for column in guesses))
    if len(robot.joints) == len(tokens) == 1:
        return {tokens[0]: robot.joints[0]}
    if zero and len(numbered := _numbers(tokens, robot)) == len(tokens):
        by_number = _by_number(robot)
        return {token: joint for token, n in numbered.items() if (joint := by_number.get(n + 1))}
    if chain := by_place_in_arm(tokens, robot):
        return chain
    sure = {column.joint: column.joint for column in guesses if column.joint in robot.joints}
    sure |= {column.joint: numbers[column.joint] for column in guesses if column.plain and column.joint in numbers}
    rest = [token for token in tokens if token not in sure]
    lacking = [joint for joint in robot.joints if joint not in sure.values()]
    around: dict[tuple[str, str], dict[str, str]] = {}
    for token in rest:
        for joint in lacking:
            before, match, behind = token.partition(joint)
            if match and not before[-1:].isalnum() and not behind[:1].isalnum():
                around.setdefault((before, behind), {})[token] = joint
    best = max(around.values(), key=len, default={})
    alike = best if len(best) > 1 or len(lacking) == 1 else {}
    return sure | (alike or _match_names(rest, lacking, robot))


def by_place_in_arm(tokens: Collection[str], robot: Robot) -> dict[str, str]:
    """Joints of a robot by the names that LeRobot and SO arms give them, from the base on; empty for other names.

    The robot has as many joints, with at least one other name.
    """
    places = {token: SO_JOINTS[plain] for token in tokens if (plain := _plain(token)) in SO_JOINTS}
    if sorted(places.values()) != [*range(len(robot.joints))] or len(places) < max(len(tokens), MIN_ARM_JOINTS):
        return {}
    return {token: _chain(robot)[place] for token, place in places.items()} if {*tokens} - {*robot.joints} else {}


def _numbers(tokens: Sequence[str], robot: Robot) -> dict[str, int]:
    """Numbers of the names that are a number, or a word of any joint and a number."""
    plain = _own_words(tokens, robot)
    return {token: int(match[1]) for token in tokens if (match := NUMBER.fullmatch(_plain(plain[token])))}


def _chain(robot: Robot) -> list[str]:
    """Joints in the order of the kinematic chain; in that of the description without a model."""
    if robot.model is None:
        return list(robot.joints)
    order = {name: place for place, name in enumerate(robot.model.names)}
    return sorted(robot.joints, key=lambda joint: order.get(joint, len(order)))


def _by_number(robot: Robot) -> dict[int, str]:
    """Joints by the number in their names if each has its own, else by their numbers."""
    digits = last_numbers(robot)
    numbers = [int(number) for number in digits if number is not None]
    chosen = numbers if len({*numbers}) == len(digits) else robot.numbers
    return dict(zip(chosen, robot.joints, strict=True))


def last_numbers(robot: Robot) -> list[int | None]:
    """Last number in the name of each joint."""
    digits = [re.findall(r"\d+", name) for name in robot.joints]
    return [int(numbers[-1]) if numbers else None for numbers in digits]


def _by_limb(tokens: Sequence[str], joints: Sequence[str], robot: Robot) -> dict[str, str]:
    """Joints of tokens such as FR_0: the word of a limb that names of joints have, and a place in that limb."""
    limbs: dict[str, dict[int, str]] = {}
    for token in tokens:
        if not (match := re.fullmatch(r"(.*[a-z])_?0*(\d+)", token.lower())):
            return {}
        limbs.setdefault(match[1], {})[int(match[2])] = token
    matched: dict[str, str] = {}
    first = 0 if any(0 in places for places in limbs.values()) else 1
    for limb, places in limbs.items():
        inside = [joint for joint in _chain(robot) if {*limb.split("_")} <= {*words_of(joint)}]
        if len(inside) in (0, len(robot.joints)) or max(places) - first >= len(inside):
            return {}
        matched |= {token: inside[place - first] for place, token in places.items() if inside[place - first] in joints}
    return matched


def _likeness(token: str, joint: str, robot: Robot, tokens: Sequence[str]) -> float:
    """Similarity of the name of a joint in the source to that of a joint of the robot, 0 to 1."""
    words = _own_words(tokens, robot)
    source, target = _plain(words[token]), _plain(joint)
    number, digits = NUMBER.fullmatch(source), last_numbers(robot)
    if number:
        at = robot.index(joint)
        if digits[at] is not None and len({*digits}) == len(digits):
            return 0.9 if digits[at] == int(number[1]) else 0.0
        if int(number[1]) == robot.numbers[at]:
            return 0.9
    return max(_alike(source, target), _alike(_plain(token), target), _alike(_counted(words[token]), _counted(joint)))


def _counted(name: str) -> str:
    """Plain name with a number in the place of a last letter that counts: hand_a is hand1."""
    letter = re.search(r"(?<=[\W_])[a-h]$|(?<=[a-z])[A-H]$", name)
    return f"{_plain(name[:-1])}{ord(name[-1].lower()) - ord('a') + 1}" if letter else _plain(name)


def _alike(first: str, second: str) -> float:
    if first == second:
        return 1.0
    inside = 0.8 if min(len(first), len(second)) > 2 and (first in second or second in first) else 0.0
    return max(inside, SequenceMatcher(None, first, second).ratio())


def _own_words(tokens: Sequence[str], robot: Robot) -> dict[str, str]:
    """Names of joints in the source without the words that all of them, and no joint of the robot, have."""
    words = {token: token.split("_") for token in tokens}
    common = set.intersection(*map(set, words.values())) if len(tokens) > 1 else set()
    common = {word for word in common if not any(word.lower() in joint.lower() for joint in robot.joints)}
    return {token: "_".join(word for word in parts if word not in common) or token for token, parts in words.items()}


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())
