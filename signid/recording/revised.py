"""Column maps with other signs and zeros of the positions of some joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from .mapping import Change, ColumnMap, ParsedColumns, change_of, read_map, split
from .names import heading_lines, key_of, quoted
from .units import bracketed

SHIFTED = ("q", "q_des")  # kinds of columns that a zero shifts
SIGNED = (*SHIFTED, "dq", "dq_des", "ddq", "tau", "tau_ff", "current", "pwm")  # kinds whose sign is that of the joint


@dataclass(frozen=True)
class Turned:
    """Position of the description = sign * recorded position + zero."""

    sign: int  # 1 or -1
    zero: float  # [rad]


def revised_map(
    given: ColumnMap | None,
    joints: Sequence[str],
    columns: Mapping[str, Sequence[str]],
    turned: Mapping[str, Turned],
) -> str:
    """Text of a column map with other signs and zeros of revolute joints; the entries of a map given remain.

    Args:
        given: the map that the recording was read with.
        joints: of the recording.
        columns: of the recording, by kind, one for each joint, "" where a joint has none.
        turned: sign and zero by joint.

    Raises:
        RecordingError: unreadable or invalid column map, or a unit that does not fit.
    """
    parsed = read_map(given)
    entries = {key: _entry(key, column, parsed.own.get(key, "")) for key, column in parsed.named.items()}
    for kind in SIGNED:
        for joint, column in zip(joints, columns.get(kind, ()), strict=False):
            if column and joint in turned and (kind in SHIFTED or turned[joint].sign < 0):
                key = next(
                    (k for k, name in parsed.named.items() if name in (column, bracketed(column)[0])), f"{kind}_{joint}"
                )
                entries[key] = _entry(key, column, _changed(parsed, key, column, turned[joint]))
    return "\n".join([*heading_lines(parsed.heading), *entries.values(), *_tables(parsed)]) + "\n"


def _changed(parsed: ParsedColumns, key: str, column: str, turned: Turned) -> Change:
    own, kind = parsed.own.get(key, ""), split(key)[0][0]
    unit = parsed.units.get(kind, "") or bracketed(column)[1]
    if not isinstance(own, Change):
        own = change_of(own or unit, kind, False, f"column map: {key}") if own or unit else Change()
    shift = turned.zero if kind in SHIFTED else 0.0
    return Change(turned.sign * own.scale, own.over, turned.sign * own.offset + shift)


def _entry(key: str, column: str, own: str | Change) -> str:
    if isinstance(own, Change):
        numbers = f"scale = {own.scale / own.over:.12g}, offset = {own.offset:.6g}"
        return f"{key_of(key)} = {{ column = {quoted(column)}, {numbers} }}"
    unit = f", unit = {quoted(own)}" if own else ""
    return f"{key_of(key)} = {{ column = {quoted(column)}{unit} }}" if unit else f"{key_of(key)} = {quoted(column)}"


def _tables(parsed: ParsedColumns) -> Iterator[str]:
    """The pattern or table of joints, and the units, as in the map that was read."""
    if parsed.pattern:
        yield f"joints = {quoted('*'.join(parsed.pattern))}"
    if parsed.joints:
        yield "\n[joints]"
        yield from (f"{key_of(joint)} = {quoted(token)}" for token, joint in parsed.joints.items())
    if parsed.units:
        yield "\n[units]"
        yield from (f"{kind} = {quoted(unit)}" for kind, unit in parsed.units.items())
