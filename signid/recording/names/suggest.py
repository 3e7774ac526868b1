"""Suggest a column map for columns whose names do not match; for review, never applied."""

from __future__ import annotations

from collections.abc import Sequence

from ...errors import shorten
from ...types import Robot
from .mapping import key_of, quoted, split
from .match import Guess, common_pattern, guess_columns, known_joints, match_signals

FROM_BASE = ("rad", "rad/s", "s", "N.m", "A", "m", "N")  # units of recordings
INLINE = 110  # maximum length of a map within a message [characters]
OFFER = "; a column map (--columns)"
MEANT = "; did you mean "
TABLE = "[joints]"


def propose(columns: Sequence[str], robot: Robot) -> tuple[str, ...]:
    """Lines of a column map that may match the columns to the robot; none if all match or no name is similar."""
    guesses = [one for one in guess_columns(columns, robot) if not (one.desired or one.bare)]
    numbers = dict(zip(robot.joints, map(str, robot.numbers), strict=True))
    signals = [(key, key[len(one.kind) + 1 :], one) for key, one in match_signals(guesses, robot)]
    strange = [each for each in signals if not (each[2].plain and each[2].joint in (each[1], numbers[each[1]]))]
    joints = {one.joint: joint for _, joint, one in strange if one.kind == "q"}
    lines = []
    if joints and all(one.plain and joints.get(one.joint) == joint for _, joint, one in strange):
        pattern = common_pattern(list(joints), robot.joints)
        if pattern and pattern[1] == joints and any(pattern[0]):
            lines.append(f"joints = {quoted('*'.join(pattern[0]))}")
        else:
            lines += [TABLE, *(f"{key_of(joint)} = {quoted(token)}" for token, joint in joints.items())]
    else:
        lines += [_line(key, one) for key, _, one in strange]
    if "t" not in columns and (time := next((one for one in guesses if one.kind == "t"), None)):
        lines.insert(0, _line("t", time))
    return tuple(lines)


def suggest(columns: Sequence[str], robot: Robot) -> str:
    """End of a message about columns that do not match; "" without a suggestion."""
    known = known_joints(robot)
    guesses = [one for one in guess_columns(columns, robot) if not (one.desired or one.bare)]
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


def _line(key: str, one: Guess) -> str:
    column, unit = quoted(one.column), "" if one.unit in FROM_BASE else one.unit
    return f"{key_of(key)} = " + (f"{{ column = {column}, unit = {quoted(unit)} }}" if unit else column)
