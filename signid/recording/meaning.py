"""Meaning of a column by its name: kind of signal, joint, unit; a guess for the user to check."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from .mapping import DRIVE, split
from .units import SPELLINGS, bracketed

WORDS: Mapping[str, tuple[str, ...]] = {
    "q": ("q", "pos", "position", "positions", "angle", "angles", "theta", "qpos", "jpos", "winkel", "istposition"),
    "dq": ("dq", "qd", "qdot", "vel", "velocity", "velocities", "speed", "omega", "qvel", "jvel", "geschwindigkeit"),
    "ddq": ("ddq", "qdd", "qddot", "acc", "accel", "acceleration", "accelerations", "qacc"),
    "tau": ("tau", "torque", "torques", "trq", "eff", "effort", "efforts", "moment", "drehmoment", "qfrc", "jtrq"),
    "pwm": ("pwm", "duty", "dutycycle"),
    "volt": ("volt", "volts", "voltage", "voltages", "spannung"),
    "temp": ("temp", "temperature", "temperatures", "temperatur"),
    "current": ("current", "currents", "cur", "curr", "amps", "strom"),
    "t": ("t", "time", "timestamp", "timestamps", "stamp", "clock", "zeit", "tout"),
}
COUNTS = ("enc", "encoder", "ticks", "tick", "count", "counts")  # positions, beside which other words win
ENABLED = ("on", "enable", "enabled")  # whether a drive holds; beside words of other kinds
FORWARD = ("ff", "feedforward", "feedfwd")  # torque that is fed forward
LOADS = ("load", "force", "last", "kraft")  # torques, beside which other words win
DESIRED = (
    *("des", "desired", "cmd", "command", "commanded", "target", "ref", "reference", "goal"),
    *("set", "setpoint", "action", "soll"),
)
ACTUAL = ("act", "actual", "measured", "meas", "present", "feedback", "fb", "ist")
MEASURED = (*ACTUAL, "value", "val", "raw", "state", "states", "observation")
ABSOLUTE = ("abs", "absolute", "magnitude", "unsigned")
FROM_BASE = ("rad", "rad/s", "s", "N.m", "A", "m", "N")  # units of recordings
ENDING = re.compile(
    r"[\s_./([-]+(" + "|".join(map(re.escape, sorted(SPELLINGS, key=len, reverse=True))) + r")[\])]*$", re.IGNORECASE
)
WITHIN = re.compile(r"(?<![a-z])(deg[_/]s|rad[_/]s|deg|rpm|ms|us|ns|mm|mnm)(?![a-z])", re.IGNORECASE)
LONGEST = 200  # characters of a name that has a meaning
PREFIX = re.compile(r"(joint|motor|axis|servo|arm|q)(?=[a-z])")
SETPOINT = re.compile(r"set[_ ]?point", re.IGNORECASE)


class Guess(NamedTuple):
    """Possible meaning of a column."""

    column: str
    kind: str  # q, dq, ddq, tau, current, abs_tau, abs_current, q_des, dq_des, tau_ff, on, pwm, volt, temp, t
    joint: str  # name in the source, "" for t
    unit: str  # "" if the name has none
    plain: bool  # whether the column is named like a signal: kind, underscore, joint
    desired: bool = False  # a commanded acceleration, torque, current or duty, which no recording uses
    counts: bool = False  # whether the name says that these are counts of an encoder
    load: bool = False  # a load, whose unit differs between makers
    bare: bool = False  # a position by words such as cmd and actual alone, or by its unit


def guess(column: str, known: Collection[str] = ()) -> Guess | None:
    """Guess the meaning of a column by the words of its name; None without a kind of signal or without a joint.

    `known` are names and numbers of joints: a column such as q_elbow is then one of the joint elbow. Names of more than
    200 characters have no meaning.
    """
    if len(column) > LONGEST:
        return None
    if column == "t":
        return Guess(column, "t", "", "", True)
    name, unit = bracketed(column)
    if unit and split(name) and (plain := guess(name, known)) and plain.plain:
        return plain._replace(column=column, unit=unit)
    found = _by_words(column)
    if pairs := split(column):
        for kind, token in pairs:
            if token in known:
                return Guess(column, kind, token, "", True)
        pairs = [pair for pair in pairs if pair[0] not in DRIVE]
    if pairs:
        words = _words(pairs[0][1])
        other = found is not None and (found.desired or found.kind != pairs[0][0])
        if not other or not ({*words} & {*DESIRED, *ABSOLUTE, "d"} or pairs[0][0] == "current"):
            return Guess(column, *pairs[0], "", True)
    last = column.rpartition(".")[2]
    if found is None and last != column and (inner := guess(last)) and inner.kind == "t":  # header.stamp
        return inner._replace(column=column, plain=False)
    return found


def without_bare(guesses: Sequence[Guess]) -> list[Guess]:
    """Guesses without those of positions that are not named so, where others of their kind are."""
    named = {one.kind for one in guesses if not one.bare}
    return [one for one in guesses if not (one.bare and one.kind in named)]


def _by_words(column: str) -> Guess | None:
    """Guess by the words of a name that is not one of a signal."""
    text, unit = _unit(SETPOINT.sub("setpoint", column))
    lower = _words(text)
    symbols = {"q", "dq", "tau"} & {*lower}
    desired = any(word in DESIRED or (word == "d" and symbols) for word in lower) or "sollposition" in lower
    lower = ["position" if word == "sollposition" else word for word in lower]
    drop = (*DESIRED, *MEASURED, *ABSOLUTE, *(["d"] if desired and symbols else []))
    rest = [word for word in lower if word not in drop]
    kinds = [kind for kind, words in WORDS.items() if any(word in words for word in rest)]
    named: list[str] = [word for kind in kinds for word in WORDS[kind]]
    kinds = [kind for kind in kinds if kind != "current"] if len(kinds) > 1 else kinds  # "current position"
    if "torque" in rest and any(word in ENABLED for word in rest):
        return _named(column, "on", rest, ("torque", *ENABLED))
    counts, load = (any(word in words for word in rest) for words in (COUNTS, LOADS))
    if not kinds and (counts or load):
        kinds = ["q"] if counts else ["tau"]
    bare = not kinds and (unit in ("deg", "rad") or any(word in (*DESIRED, *ACTUAL) for word in lower))
    if bare and unit in ("", "deg", "rad", "mrad"):
        kinds = ["q"]
    if len(kinds) != 1:
        return None
    [kind] = kinds
    forward = kind == "tau" and any(word in FORWARD for word in rest)
    token = "_".join(word for word in rest if word not in (*named, *COUNTS, *LOADS, *(FORWARD if forward else ())))
    if bool(token) == (kind == "t"):
        return None
    if kind in ("tau", "current") and any(word in ABSOLUTE for word in lower):
        kind = f"abs_{kind}"
    unit = {"dq": {"deg": "deg/s", "rad": "rad/s"}, "ddq": {"deg": "deg/s2"}}.get(kind, {}).get(unit, unit)
    if forward:
        return Guess(column, "tau_ff", token, unit, False)
    if desired and kind in ("q", "dq"):
        return Guess(column, f"{kind}_des", token, unit, False, counts=counts and kind == "q", bare=bare)
    return Guess(column, kind, token, unit, False, desired, kind == "q" and counts, load and kind == "tau", bare)


def _named(column: str, kind: str, words: Collection[str], without: Collection[str]) -> Guess | None:
    """Guess of a kind without a unit, whose other words are those of its joint; None without a joint."""
    token = "_".join(word for word in words if word not in without)
    return Guess(column, kind, token, "", False) if token else None


def _words(text: str) -> list[str]:
    """Words of a name in lower case: "jointPos_1" has joint, pos and 1."""
    found = (word.lower() for word in re.findall(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+(?![a-z])|\d+", text))
    known = {*DESIRED, *MEASURED, *(word for words in WORDS.values() for word in words)}
    return [part for word in found for part in _parts(word, known)]


def _parts(word: str, known: Collection[str]) -> list[str]:
    """A word, in two parts if it is one such as jointpos."""
    begun = None if word in known else PREFIX.match(word)
    return [begun[1], word[begun.end() :]] if begun and word[begun.end() :] in known else [word]


def _unit(column: str) -> tuple[str, str]:
    """A name without its unit, and the unit, "" if there is none."""
    name, unit = bracketed(column)
    if unit:
        return name, unit
    if ended := ENDING.search(column):
        return column[: ended.start()], SPELLINGS[ended[1].lower()]
    if within := WITHIN.search(column):
        return f"{column[: within.start()]} {column[within.end() :]}", SPELLINGS[within[1].lower()]
    return column, ""
