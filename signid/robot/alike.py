"""Joints of the same kind in several legs, arms or fingers, by their names; and a pattern of such names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import takewhile

SEPARATOR = re.compile(r"([_\-./ ])")
SIDES = "left right l r fl fr rl rr hl hr lf rf lh rh bl br lb rb front rear hind back".split()
FINGERS = "index middle ring pinky little".split()
SIDE = re.compile(r"^[LR](?=[A-Z][a-z])")  # LHipPitch, RHipPitch
LIMB = re.compile(r"^(finger|leg|arm|toe)(\d*)$")  # finger2, or finger and 2


def alike(joints: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Joints whose names differ in a side, a finger or the number of a limb only: left_hip and right_hip; two or more.

    Numbers of joints in a chain (joint_1, joint_2) are no kind.
    """
    kinds: dict[str, list[str]] = {}
    for joint in joints:
        kinds.setdefault(_kind(joint), []).append(joint)
    return tuple(tuple(members) for members in kinds.values() if len(members) > 1)


def name_pattern(members: Sequence[str], joints: Sequence[str]) -> str:
    """Regular expression that matches the whole names of some of the joints and of no other: `.*_hip_joint`."""
    if len(members) == 1:
        return _escaped(members[0])
    words = [SEPARATOR.split(name) for name in members]
    first = _common(words)
    last = _common([own[len(first) :][::-1] for own in words])[::-1]
    pattern = f"{_escaped(''.join(first))}.*{_escaped(''.join(last))}"
    if [joint for joint in joints if re.fullmatch(pattern, joint)] == list(members):
        return pattern
    return "|".join(map(_escaped, members))


def _escaped(text: str) -> str:
    return re.escape(text).replace(r"\-", "-")


def _common(words: Sequence[Sequence[str]]) -> list[str]:
    """Words with which all sequences begin."""
    return [column[0] for column in takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))]


def _kind(joint: str) -> str:
    """Name without side, finger and number of the limb."""
    words, limb, out = SEPARATOR.split(SIDE.sub("*", joint)), "", list[str]()
    for k, word in enumerate(words):
        low, found = word.lower(), LIMB.match(word.lower())
        numbered = limb and word.isdigit() and k + 1 < len(words)  # not the last word: l_arm_1 is a chain
        if low in SIDES or low in FINGERS or numbered:
            out.append("*")
        else:
            out.append(f"{found[1]}*" if found and found[2] and len(words) > 1 else word)
        limb = limb if SEPARATOR.match(word) else found[1] if found and not found[2] else ""
    return "".join(out)
