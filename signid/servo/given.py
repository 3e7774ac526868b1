"""Texts of a user about drives: known numbers, priors, bounds and equal joints."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import Any, NamedTuple, TypeVar

from ..errors import OptionError, shorten
from ..robot.joints import find_joint
from ..servos import LIMIT_KEYS, MAX_NUMBER, MIN_NUMBER, PASSIVE_LAWS, SERVO_NUMBERS, SERVO_UNITS, Servo, number_fault
from ..types import Robot

KNOWN = ("masses", "kp", "nothing")
MASSES_ERROR = 0.1  # [1] standard deviation of the described masses over them, where nothing else is said
PLUS_MINUS = r"\+-|±|\+/-"
POSITIVE = ("kp", *LIMIT_KEYS)  # numbers that cannot be zero
EXAMPLES = {"known": "kp=20", "prior": "armature=.01+-.005", "bounds": "kp=5..30"}
T = TypeVar("T")
STALLED = ("duty", "torque_speed")  # laws whose limit is the stall torque
UNSHARED = "torque_offset"  # number of a joint alone: it contains the zero error of the command
Name = tuple[str, str]  # joint, number


@dataclass(frozen=True)
class _Entry:
    """A text NAME[@PATTERN]=VALUE of an option."""

    option: str
    text: str
    number: str
    joints: tuple[str, ...]
    value: str

    def wrong(self, fault: str) -> OptionError:
        """Error of the value."""
        given = f"{self.option} is {self.text!r}; {fault}, in {SERVO_UNITS[self.number]}"
        return OptionError(f"{given}; give {EXAMPLES[self.option]}, for example")


def given_texts(
    robot: Robot,
    joints: Sequence[str],
    stated: Mapping[str, Mapping[str, float]],
    *,
    known: str | Sequence[str] | None = None,
    prior: Sequence[str] = (),
    bounds: Sequence[str] = (),
    equal: Sequence[str] = (),
) -> Assumptions:
    """Read texts of a user about drives; a later text holds for the joints that it shares with others.

    Args:
        robot: robot of the drives.
        joints: servo joints.
        stated: numbers by joint that the actuators file states.
        known: one of KNOWN, and NAME=VALUE, NAME@PATTERN=VALUE or NAME.JOINT=VALUE.
        prior: NAME=MEAN+-STD or NAME@PATTERN=MEAN+-STD, and masses=1+-STD for the error of the described masses.
        bounds: NAME=LOW..HIGH or NAME@PATTERN=LOW..HIGH.
        equal: regular expressions that match whole names of joints, at least two each.

    Raises:
        OptionError: a text of another form, an unknown number, a pattern without joints, or a contradiction.
    """
    texts = [known] if isinstance(known, str) else list(known or ())
    words, numbers = [x for x in texts if "=" not in x], [x for x in texts if "=" in x]
    groups = tuple(unions(_equal(pattern, robot, joints) for pattern in equal))
    said = _read("known", numbers, robot, joints, _number)
    given = {(joint, name): x for joint, of in stated.items() for name, x in of.items()} | said
    given = _spread(given, groups, "stated values")
    drives = [text for text in prior if not text.startswith("masses=")]
    priors = _spread(_read("prior", drives, robot, joints, _prior), groups, "priors")
    ranges = _spread(_read("bounds", bounds, robot, joints, _bounds), groups, "bounds")
    for joint, name in given:
        if (joint, name) in priors or (joint, name) in ranges:
            raise OptionError(f"{name} of {joint} is stated, and has a prior or bounds as well; give one of them")
    for key, (mean, _) in priors.items():
        if key in ranges and not ranges[key].low <= mean <= ranges[key].high:
            raise OptionError(f"the prior of {key[1]} of {key[0]} has its mean outside the bounds; move one of them")
    scale = _scale(words, given, any(name == "kp" for _, name in said))
    by_joint = {joint: {name: x for (one, name), x in given.items() if one == joint} for joint in joints}
    masses = MASSES_ERROR
    for text in (text for text in prior if text not in drives):
        one, masses = _pair(_Entry("prior", text, "", (), text.removeprefix("masses=")), PLUS_MINUS)
        if not (one == 1 and 0 < masses < 1):
            raise OptionError(f"prior is {text!r}; the described masses are 1; give masses=1+-.1 for 10 %")
    return Assumptions(groups, priors, ranges, masses if scale == "masses" else 0.0, scale, by_joint)


def _scale(words: Sequence[str], given: Mapping[Name, float], gains: bool) -> str:
    """Source of the scale of torque, by default stated gains, else masses; gains: whether the user states any."""
    if (wrong := next((word for word in words if word not in KNOWN), None)) is not None:
        raise OptionError(f"known is {wrong!r}; give one of {', '.join(KNOWN)}, or NAME=VALUE: kp=20, for example")
    if len(set(words) | ({"kp"} if gains else set())) > 1:
        raise OptionError("the scale of torque is known from one source; give masses, nothing, or kp=20 (--known)")
    stated = any(name == "kp" for _, name in given)
    word = "kp" if gains else next(iter(words), "kp" if stated else "masses")
    if word == "kp" and not stated:
        raise OptionError("known is 'kp', and no kp is stated; state it in the actuators file, or give kp=20")
    return word


def _read(
    option: str, texts: Sequence[str], robot: Robot, joints: Sequence[str], value: Callable[[_Entry], T]
) -> dict[Name, T]:
    """Values by joint and number of the texts of an option."""
    entries = [_entry(option, text, robot, joints) for text in texts]
    seen = [(entry.number, entry.joints) for entry in entries]
    if twice := next((entry.text for k, entry in enumerate(entries) if seen[k] in seen[:k]), ""):
        raise OptionError(f"{option} is {twice!r}, and these joints have that number already; give it once")
    return {(joint, entry.number): read for entry in entries for read in [value(entry)] for joint in entry.joints}


def _entry(option: str, text: str, robot: Robot, joints: Sequence[str]) -> _Entry:
    head, equals, value = text.rpartition("=")
    number, mark, which = head.partition("@") if "@" in head else head.partition(".")
    if not equals or (mark and not which):
        raise OptionError(
            f"{option} is {text!r}; write NAME{_tail(option)}, or NAME@PATTERN{_tail(option)} for the joints whose "
            f"names a regular expression matches; give {EXAMPLES[option]}, for example"
        )
    if number not in SERVO_NUMBERS:
        raise OptionError(
            f"{option} is {text!r}, and a drive has no {number!r}; choose from {', '.join(SERVO_NUMBERS)}"
        )
    own = tuple(joints)
    if mark == "@":
        own = _matched(which, joints)
    elif mark:
        own = (robot.joints[find_joint(which, robot)],)
    if not own or not set(own) <= set(joints):
        raise OptionError(f"{option} is {text!r}, and {which!r} is no servo joint; they are {shorten(joints)}")
    return _Entry(option, text, number, own, value)


def _tail(option: str) -> str:
    return "=" + EXAMPLES[option].partition("=")[2]


def _matched(pattern: str, joints: Sequence[str]) -> tuple[str, ...]:
    """Joints whose whole names a regular expression matches."""
    try:
        return tuple(joint for joint in joints if re.fullmatch(pattern, joint))
    except re.error as error:
        raise OptionError(f"{pattern!r} is no regular expression: {error}; write '.*_hip_joint', for example") from None


def _equal(pattern: str, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
    """Servo joints of one kind that a pattern matches."""
    found = _matched(pattern, joints)
    if len(found) < 2:
        which = f"only the servo joint {found[0]}" if found else "no servo joint"
        raise OptionError(f"equal is {pattern!r}, which matches {which}; match two or more of {shorten(joints)}")
    if len({bool(robot.prismatic[robot.index(joint)]) for joint in found}) > 1:
        raise OptionError(f"equal is {pattern!r}, which matches joints that turn and joints that slide; match one kind")
    return found


def _spread(given: Mapping[Name, T], groups: Sequence[Sequence[str]], what: str) -> dict[Name, T]:
    """The same with what is given for one of several equal joints at all of them."""
    out = dict(given)
    for members in groups:
        for number in (name for name in SERVO_NUMBERS if name != UNSHARED):
            values = [given[joint, number] for joint in members if (joint, number) in given]
            if any(value != values[0] for value in values):
                raise OptionError(f"{shorten(members)} are equal, and have different {what} of {number}; give one")
            out |= {(joint, number): values[0] for joint in members if values}
    return out


def _number(entry: _Entry) -> float:
    value = _float(entry.value)
    if fault := number_fault(entry.number, value, entry.number in POSITIVE):
        raise entry.wrong(fault)
    return value


def _prior(entry: _Entry) -> Prior:
    mean, std = _pair(entry, PLUS_MINUS)
    if fault := number_fault(entry.number, mean, entry.number in POSITIVE):
        raise entry.wrong(f"{fault} as the mean")
    if not MIN_NUMBER <= std <= MAX_NUMBER:
        raise entry.wrong("expected a positive standard deviation after +-")
    return Prior(mean, std)


def _bounds(entry: _Entry) -> Bounds:
    low, high = _pair(entry, r"\.\.(?=[^.]|\.\d)")
    if fault := number_fault(entry.number, low):
        raise entry.wrong(f"{fault} as the lower bound")
    if not low < high:
        raise entry.wrong("expected LOW..HIGH with LOW below HIGH")
    return Bounds(low, high)


def _pair(entry: _Entry, between: str) -> tuple[float, float]:
    parts = re.split(between, entry.value, maxsplit=1)
    return (_float(parts[0]), _float(parts[1])) if len(parts) == 2 else (nan, nan)


def _float(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return nan
    return value if isfinite(value) or value == inf else nan


def stated_servos(robot: Robot) -> dict[str, Servo]:
    """Drives by joint whose kp the actuators file states; what it leaves out is ideal: no delay, no limit.

    Numbers of PASSIVE_LAWS are left out, since they are laws of the model of the robot, stated or identified.
    """
    return {
        joint: stated_servo(robot, joint)
        for joint in robot.joints
        if float(robot.servo.get(joint, {}).get("kp", 0.0)) > 0
    }


def stated_servo(robot: Robot, joint: str) -> Servo:
    """Drive of a joint with the numbers that the actuators file states, defaults elsewhere."""
    stated = robot.servo.get(joint, {})
    own = [name for name in (*SERVO_NUMBERS, "kp_register") if name in stated and name not in PASSIVE_LAWS]
    numbers: dict[str, Any] = {name: float(stated[name]) for name in own}
    numbers |= {key: str(stated[key]) for key in ("law", "kd_on") if key in stated}
    if "stall_torque" in stated and numbers.get("law", "effort") in STALLED:
        numbers["effort_limit"] = float(stated["stall_torque"])
    return Servo(**numbers)


class Prior(NamedTuple):
    """Normal distribution of a number [SERVO_UNITS]."""

    mean: float
    std: float


class Bounds(NamedTuple):
    """Range of a number [SERVO_UNITS]."""

    low: float
    high: float


@dataclass(frozen=True)
class Assumptions:
    """Stated and assumed numbers of drives; each number, prior and range stands at every joint that it holds for."""

    equal: tuple[tuple[str, ...], ...] = ()  # joints whose numbers, but UNSHARED, are one number each
    priors: Mapping[Name, Prior] = field(default_factory=dict)
    bounds: Mapping[Name, Bounds] = field(default_factory=dict)
    masses_error: float = 0.0  # [1] standard deviation of the masses that set the scale, over them
    scale: str = "nothing"  # what sets the scale of torque, one of KNOWN
    stated: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # by joint, also by the actuators file
    laws: Mapping[str, str] = field(default_factory=dict)  # stated laws by joint, and those that a recording shows

    @property
    def fixed(self) -> dict[str, dict[str, float]]:
        """Stated numbers that a fit keeps: gains only if they set the scale."""
        gains = self.scale == "kp"
        return {j: {name: x for name, x in of.items() if gains or name != "kp"} for j, of in self.stated.items()}

    def peers(self, joint: str) -> tuple[str, ...]:
        """Joints that share the numbers of a joint; at least itself."""
        return next((members for members in self.equal if joint in members), (joint,))

    def with_peers(self, joints: Collection[str]) -> list[str]:
        """Joints with those that share their numbers, each once."""
        return list(dict.fromkeys(peer for joint in joints for peer in self.peers(joint)))


def unions(sets: Iterable[Sequence[str]]) -> list[tuple[str, ...]]:
    """Unions of the sets that overlap."""
    found: list[tuple[str, ...]] = []
    for members in sets:
        linked = [one for one in found if not set(one).isdisjoint(members)]
        joined = tuple(dict.fromkeys((*(name for one in linked for name in one), *members)))
        found = [one for one in found if one not in linked] + [joined]
    return found
