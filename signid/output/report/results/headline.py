"""Findings in words with their main number: headlines of reports, replays, terminals and fleets."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from math import ceil, floor, hypot, isfinite, log10
from typing import NamedTuple

from ....effects.naming import law_place
from ....types import TWO_SIDED, Coefficient, Effect, Law, Robot, Shape
from ..layout import UNKNOWN, figure, plural, share
from .laws import changed_link, law_units

FEW = 3  # maximum number of causes in a headline
DIGITS = 4  # maximum number of significant digits in a headline
LONG = 40  # length of joined names beyond which joints are only counted [characters]
BRIEF = 0.1  # times below are given in milliseconds [s]
FIELD = re.compile(r"\{(\w+)\}")


class Value(NamedTuple):
    """A parameter of a finding."""

    value: float
    std: float | None  # None: unknown
    unit: str


class Named(NamedTuple):
    """A law at its joints with its parameters, as an object or a result file states it."""

    effect: Effect
    joint: str | None  # None: the whole robot
    partner: str | None
    numbers: Mapping[str, Value]
    stated: Mapping[str, float] = {}  # values in the simulation [unit of the parameter]
    link: str | None = None  # the link whose inertia the law changes


def named(robot: Robot, law: Law, std: Mapping[str, float | None], stated: Mapping[str, float] | None = None) -> Named:
    """A law of a robot, with standard deviations and stated values of its parameters [unit of the parameter]."""
    joint, values = law_place(law, robot)
    partner, units = values.get("partner"), law_units(robot, law)
    numbers = {key: Value(float(x), std.get(key), units[key]) for key, x in values.items() if key != "partner"}
    return Named(
        law.effect, joint, None if partner is None else str(partner), numbers, stated or {}, changed_link(robot, law)
    )


def quantity(value: float, std: float | None, unit: str) -> str:
    """A value with its 95 % interval, rounded up to one digit, and its unit; at most four significant digits.

    >>> quantity(2.7731, 0.0093, "kg"), quantity(1.19723, 0.0024, "N.m"), quantity(0.8, None, "N.m")
    ('2.77 ± 0.02 kg', '1.197 ± 0.005 N.m', '0.800 N.m')
    >>> quantity(0.005, 1e-4, "s"), quantity(0.031, 0.001, "1"), quantity(1.0, float("inf"), "m")
    ('5.0 ± 0.2 ms', '3.1 ± 0.2 %', 'not identifiable')
    """
    if not isfinite(value) or (std is not None and not isfinite(std)):
        return UNKNOWN
    half = TWO_SIDED * (std or 0.0)
    scale, unit = (1e3, "ms") if unit == "s" and abs(value) < BRIEF else (1e2, "%") if unit == "1" else (1.0, unit)
    return f"{_rounded(scale * value, scale * half)} {unit}".rstrip()


def _rounded(value: float, half: float) -> str:
    largest = max(abs(value), half)
    if half <= 0 or not 1e-4 <= largest < 1e6:
        return figure(value) + (f" ± {figure(half, 1)}" if half > 0 else "")
    last = max(floor(log10(half)), floor(log10(largest)) - DIGITS + 1)
    last += ceil(half / 10.0**last - 1e-6) >= 10
    places, unit = max(0, -last), 10.0**last
    return f"{round(value / unit) * unit:z.{places}f} ± {ceil(half / unit - 1e-6) * unit:.{places}f}"


def finding_headline(finding: Named) -> str:
    """A finding in words, with its main number; the card of its effect may hold a template."""
    words = _template(finding)
    return FIELD.sub(lambda field: _filled(finding, field[1]), words)


def compared(finding: Named) -> str:
    """A finding whose only parameter the simulation states, beside what was recorded; "" if there is none or several.

    Example: "Coulomb friction of joint_2: 0.30 in the simulation, 1.20 ± 0.01 N.m recorded".
    """
    if len(finding.numbers) != 1 or not finding.stated:
        return ""
    (key, number), where = next(iter(finding.numbers.items())), subject(finding)
    before, after = quantity(finding.stated[key], None, number.unit), quantity(*number)
    shown = after if after == UNKNOWN else f"{after} recorded"
    return f"{where}: {before} in the simulation, {shown}"


def subject(finding: Named) -> str:
    """Name of a law and its joints, without number."""
    words = _template(finding).partition(": ")[0]
    return FIELD.sub(lambda field: _filled(finding, field[1]), words)


def main_number(finding: Named) -> tuple[str, Value] | None:
    """The first coefficient that is not consistent with zero, or else the first parameter."""
    effect = finding.effect
    known = {key: x for key, x in finding.numbers.items() if key in effect.parameters and key not in effect.optional}
    linear = {key: x for key, x in known.items() if isinstance(effect.parameters[key], Coefficient)} or known
    sure = [key for key, x in linear.items() if x.std is not None and abs(x.value) >= TWO_SIDED * x.std]
    key = next(iter(sure or linear), None)
    return None if key is None else (key, linear[key])


def _template(finding: Named) -> str:
    """Words with fields: of the effect's card, or else its name, joints and main number."""
    effect = finding.effect
    words = effect.headline
    if not words:
        at = "" if effect.scope == "tip" else " of {joint}" + (" and {partner}" if finding.partner else "")
        words = effect.name.replace("_", " ") + at + (" (link {link})" if finding.link else "")
        if (found := main_number(finding)) is not None:
            several = sum(isinstance(kind, Coefficient) for kind in effect.parameters.values()) > 1
            words += f": {found[0].replace('_', ' ') + ' ' if several else ''}{{{found[0]}}}"
    return words if finding.joint else words.replace(" of {joint}", "")


def _filled(finding: Named, field: str) -> str:
    """Text of a field: joint, partner, link, a parameter, or the size of a vector of three parameters."""
    if field in ("joint", "partner", "link"):
        return str(getattr(finding, field))
    if field in finding.numbers:
        number, kind = finding.numbers[field], finding.effect.parameters.get(field)
        instant = isinstance(kind, Shape) and kind.unit == "s" and not kind.grid
        return quantity(*number._replace(std=None) if instant else number)
    parts = [finding.numbers[key] for key in (f"{field}_{axis}" for axis in "xyz") if key in finding.numbers]
    size = hypot(*(part.value for part in parts))
    errors = [part.value * (part.std or 0.0) for part in parts]
    return quantity(size, hypot(*errors) / size if size else None, parts[0].unit) if parts else UNKNOWN


def grouped(findings: Sequence[Named], joints: int) -> Iterator[tuple[str, int]]:
    """Yield findings in words, each with the number of findings in it; many of one effect are one, with their range."""
    if len(findings) <= FEW:
        yield from ((finding_headline(finding), 1) for finding in findings)
        return
    groups: dict[str, list[Named]] = {}
    for finding in findings:
        alike = ": " in _template(finding) and finding.joint is not None and finding.partner is None
        groups.setdefault(finding.effect.name if alike else finding_headline(finding), []).append(finding)
    for some in groups.values():
        yield (finding_headline(some[0]) if len(some) == 1 else _together(some, joints)), len(some)


def _together(findings: Sequence[Named], joints: int) -> str:
    """Findings of one effect at several joints, with the range of their main number."""
    places = list(dict.fromkeys(str(finding.joint) for finding in findings))
    where = ", ".join(places)
    where = where if len(places) <= FEW and len(where) <= LONG else f"{len(places)} joints"
    where = "all joints" if len(places) == joints else where
    words = _template(findings[0]).partition(": ")[0].replace("{joint}", where)
    found = [number for finding in findings if (number := main_number(finding)) is not None]
    units = list(dict.fromkeys(value.unit for _, value in found))
    values = [value.value for _, value in found if isfinite(value.value)]
    if len({key for key, _ in found}) != 1 or len(units) != 1 or not values:
        return words
    least, most = (quantity(value, None, units[0]) for value in (min(values), max(values)))
    both = "" if least == most else f"{least.rpartition(' ')[0]} to "
    return f"{words}: {both}{most}"


def listed(words: Sequence[tuple[str, int]], total: int) -> str:
    """The first three groups of findings, and the number of all others."""
    shown = words[:FEW]
    more = total - sum(count for _, count in shown)
    return "; ".join([*(text for text, _ in shown), *([f"and {more} more"] if more > 0 else [])])


def causes_words(causes: Sequence[Named], explained: bool, joints: int, left: Sequence[float] = ()) -> str:
    """Missing effects, then wrong parameters of a simulation: three at most, and the number of all others.

    Args:
        causes: the largest first.
        explained: whether they explain most of the torque; if not, that is said.
        joints: number of joints of the robot.
        left: unexplained shares [1] of the torque of joints on which the causes hardly act.
    """
    if causes and left:
        return f"{causes_words(causes, True, joints)}; and {_left_words(left)}"
    unexplained = "the simulation lacks physics that no law explains"
    if not explained and not causes:
        return unexplained
    if not explained:
        leave, explain = ("leave", "they explain") if len(causes) > 1 else ("leaves", "it explains")
        words = [(_bracketed(text), count) for text, count in grouped(causes, joints)]
        return f"{listed(words, len(causes))} {leave} more torque unexplained than {explain}; {unexplained}"
    missing, wrong = ([cause for cause in causes if bool(cause.stated) == stated] for stated in (False, True))
    lacking, beside = list(grouped(missing, joints)), list(_wrong(wrong, joints))
    lead = "the simulation lacks " if missing else ""
    return lead + listed([*lacking, *beside], len(causes))


def _left_words(left: Sequence[float]) -> str:
    """Number of joints that stay unexplained, and the range of their shares."""
    least, most = share(min(left)), share(max(left))
    stay, their = ("stays", "its") if len(left) == 1 else ("stay", "their")
    between = least if least == most else f"{least.removesuffix(' %')} to {most}"
    return f"{plural(len(left), 'joint')} {stay} unexplained, {between} of {their} torque"


def _wrong(findings: Sequence[Named], joints: int) -> Iterator[tuple[str, int]]:
    """Yield wrong parameters beside what was recorded if they are few, the others by their laws."""
    pairs = {k: words for k, finding in enumerate(findings) if (words := compared(finding))}
    pairs = pairs if len(pairs) <= FEW else {}
    yield from ((words, 1) for words in pairs.values())
    if others := [finding for k, finding in enumerate(findings) if k not in pairs]:
        words = listed(list(grouped(others, joints)), len(others))
        yield f"parameters of the simulation are wrong: {words}", len(others)


def _bracketed(words: str) -> str:
    head, colon, number = words.partition(": ")
    return f"{head} ({number})" if colon else words


def sentence_case(words: str) -> str:
    """The words with a capital first letter."""
    return words[:1].upper() + words[1:]
