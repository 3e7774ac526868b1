"""Findings and diagnoses in words with their main number: reports, replays, terminals and fleets."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import compress
from math import ceil, floor, hypot, isfinite, log10
from typing import TYPE_CHECKING, NamedTuple

from ....effects.naming import law_place
from ....errors import shorten
from ....types import TWO_SIDED, Coefficient, Effect, Law, Robot, Shape
from ..layout import UNKNOWN_TEXT, confidence, figure, plural, share
from ..quantities import Quantity, changed_link, law_numbers, law_words, number_lines, spaced

if TYPE_CHECKING:
    from ....diagnose import Diagnosis, Finding
    from ....diagnose.data.locate import Location

MIN_LARGE_SHARE = 0.2  # share of a joint's torque from which a correction is not small [1]
MAX_HEADLINE_CAUSES = 3  # maximum number of causes in a headline
MAX_HEADLINE_DIGITS = 4  # maximum number of significant digits in a headline
MAX_JOINED_LENGTH = 40  # length of joined names beyond which joints are only counted [characters]
MAX_IN_MS = 0.1  # times below are given in milliseconds [s]
TEMPLATE_FIELD = re.compile(r"\{(\w+)\}")
MAX_NOISE_RATIO = 1.08  # ratio of residual to irreducible rms up to which a residual is noise
MIN_SHOWN = 0.001  # probability below which an alternative is not shown
MIN_NAMED_EXPLAINED = 0.3  # explained share below which no variable is named
WORSE_ERROR_RATIO = 1.02  # ratio of errors, after to before, above which a result is worse
MIN_COUNTED_SHARE = 0.005  # share of torque below which a joint is not counted
POWER_TITLE = "What these recordings would have shown with a probability of .9"
PRINTED_EFFECTS = ("payload", "coulomb_friction", "spring")  # effects whose smallest size is said on the terminal
MAX_PRINTED_ALTERNATIVES = 3  # maximum number of alternatives shown on the terminal


class Named(NamedTuple):
    """A law at its joints with its parameters, as an object or a result file states it."""

    effect: Effect
    joint: str | None  # None: the whole robot
    partner: str | None
    numbers: Mapping[str, Quantity]
    stated: Mapping[str, float] = {}  # values in the simulation [unit of the parameter]
    link: str | None = None  # the link whose inertia the law changes


def named(robot: Robot, law: Law, std: Mapping[str, float | None], stated: Mapping[str, float] | None = None) -> Named:
    """A law of a robot, with standard deviations and stated values of its parameters [unit of the parameter]."""
    joint, values = law_place(law, robot)
    partner, numbers = values.get("partner"), {x.name: x for x in law_numbers(robot, law, std)}
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
        return UNKNOWN_TEXT
    half = TWO_SIDED * (std or 0.0)
    scale, unit = (1e3, "ms") if unit == "s" and abs(value) < MAX_IN_MS else (1e2, "%") if unit == "1" else (1.0, unit)
    return f"{_rounded(scale * value, scale * half)} {unit}".rstrip()


def _rounded(value: float, half: float) -> str:
    largest = max(abs(value), half)
    if half <= 0 or not 1e-4 <= largest < 1e6:
        return figure(value) + (f" ± {figure(half, 1)}" if half > 0 else "")
    last = max(floor(log10(half)), floor(log10(largest)) - MAX_HEADLINE_DIGITS + 1)
    last += ceil(half / 10.0**last - 1e-6) >= 10
    places, unit = max(0, -last), 10.0**last
    return f"{round(value / unit) * unit:z.{places}f} ± {ceil(half / unit - 1e-6) * unit:.{places}f}"


def finding_headline(finding: Named) -> str:
    """A finding in words, with its main number; the card of its effect may hold a template."""
    words = _template(finding)
    return TEMPLATE_FIELD.sub(lambda field: _filled(finding, field[1]), words)


def compared(finding: Named) -> str:
    """A finding whose only parameter the simulation states, beside what was recorded; "" if there is none or several.

    Example: "Coulomb friction of joint_2: 0.30 in the simulation, 1.20 ± 0.01 N.m recorded".
    """
    if len(finding.numbers) != 1 or not finding.stated:
        return ""
    (key, number), where = next(iter(finding.numbers.items())), subject(finding)
    before, after = quantity(finding.stated[key], None, number.unit), quantity(number.value, number.std, number.unit)
    shown = after if after == UNKNOWN_TEXT else f"{after} recorded"
    return f"{where}: {before} in the simulation, {shown}"


def subject(finding: Named) -> str:
    """Name of a law and its joints, without number."""
    words = _template(finding).partition(": ")[0]
    return TEMPLATE_FIELD.sub(lambda field: _filled(finding, field[1]), words)


def main_number(finding: Named) -> Quantity | None:
    """The first coefficient that is not consistent with zero, or else the first parameter."""
    effect = finding.effect
    known = {key: x for key, x in finding.numbers.items() if key in effect.parameters and key not in effect.optional}
    linear = {key: x for key, x in known.items() if isinstance(effect.parameters[key], Coefficient)} or known
    sure = [key for key, x in linear.items() if x.std is not None and abs(x.value) >= TWO_SIDED * x.std]
    return next((linear[key] for key in sure or linear), None)


def _template(finding: Named) -> str:
    """Words with fields: of the effect's card, or else its name, joints and main number."""
    effect = finding.effect
    words = effect.headline
    if not words:
        at = "" if effect.scope == "tip" else " of {joint}" + (" and {partner}" if finding.partner else "")
        words = effect.name.replace("_", " ") + at + (" (link {link})" if finding.link else "")
        if (number := main_number(finding)) is not None:
            several = sum(isinstance(kind, Coefficient) for kind in effect.parameters.values()) > 1
            words += f": {spaced(number.name) + ' ' if several else ''}{{{number.name}}}"
    return words if finding.joint else words.replace(" of {joint}", "")


def _filled(finding: Named, field: str) -> str:
    """Text of a field: joint, partner, link, a parameter, or the size of a vector of three parameters."""
    if field in ("joint", "partner", "link"):
        return str(getattr(finding, field))
    if field in finding.numbers:
        number, kind = finding.numbers[field], finding.effect.parameters.get(field)
        instant = isinstance(kind, Shape) and kind.unit == "s" and not kind.grid
        return quantity(number.value, None if instant else number.std, number.unit)
    parts = [finding.numbers[key] for key in (f"{field}_{axis}" for axis in "xyz") if key in finding.numbers]
    size = hypot(*(part.value for part in parts))
    errors = [part.value * (part.std or 0.0) for part in parts]
    return quantity(size, hypot(*errors) / size if size else None, parts[0].unit) if parts else UNKNOWN_TEXT


def grouped(findings: Sequence[Named], joints: int) -> Iterator[tuple[str, int]]:
    """Yield findings in words, each with the number of findings in it; many of one effect are one, with their range."""
    if len(findings) <= MAX_HEADLINE_CAUSES:
        yield from ((finding_headline(finding), 1) for finding in findings)
        return
    groups: dict[str, list[Named]] = {}
    for finding in findings:
        joined = ": " in _template(finding) and finding.joint is not None and finding.partner is None
        groups.setdefault(finding.effect.name if joined else finding_headline(finding), []).append(finding)
    for alike in groups.values():
        yield (finding_headline(alike[0]) if len(alike) == 1 else _together(alike, joints)), len(alike)


def _together(findings: Sequence[Named], joints: int) -> str:
    """Findings of one effect at several joints, with the range of their main number."""
    places = list(dict.fromkeys(str(finding.joint) for finding in findings))
    where = ", ".join(places)
    where = where if len(places) <= MAX_HEADLINE_CAUSES and len(where) <= MAX_JOINED_LENGTH else f"{len(places)} joints"
    where = "all joints" if len(places) == joints else where
    words = _template(findings[0]).partition(": ")[0].replace("{joint}", where).replace(" (link {link})", "")
    numbers = [number for finding in findings if (number := main_number(finding)) is not None]
    units = list(dict.fromkeys(number.unit for number in numbers))
    values = [number.value for number in numbers if isfinite(number.value)]
    if len({number.name for number in numbers}) != 1 or len(units) != 1 or not values:
        return words
    least, most = (quantity(value, None, units[0]) for value in (min(values), max(values)))
    both = "" if least == most else f"{least.rpartition(' ')[0]} to "
    return f"{words}: {both}{most}"


def listed(words: Sequence[tuple[str, int]], total: int) -> str:
    """The first three groups of findings, and the number of all others."""
    shown = words[:MAX_HEADLINE_CAUSES]
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
        least, most = share(min(left)), share(max(left))
        stay, their = ("stays", "its") if len(left) == 1 else ("stay", "their")
        between = least if least == most else f"{least.removesuffix(' %')} to {most}"
        rest = f"{plural(len(left), 'joint')} {stay} unexplained, {between} of {their} torque"
        return f"{causes_words(causes, True, joints)}; and {rest}"
    unexplained = "the simulation lacks physics that no law explains"
    if not explained and not causes:
        return unexplained
    if not explained:
        leave, explain = ("leave", "they explain") if len(causes) > 1 else ("leaves", "it explains")
        parts = ((text.partition(": "), count) for text, count in grouped(causes, joints))
        words = [(f"{head} ({number})" if colon else head, count) for (head, colon, number), count in parts]
        return f"{listed(words, len(causes))} {leave} more torque unexplained than {explain}; {unexplained}"
    missing, wrong = ([cause for cause in causes if bool(cause.stated) == stated] for stated in (False, True))
    pairs = {k: text for k, finding in enumerate(wrong) if (text := compared(finding))}
    pairs = pairs if len(pairs) <= MAX_HEADLINE_CAUSES else {}
    lacking, beside = list(grouped(missing, joints)), [(text, 1) for text in pairs.values()]
    if others := [finding for k, finding in enumerate(wrong) if k not in pairs]:
        text = listed(list(grouped(others, joints)), len(others))
        beside.append((f"parameters of the simulation are wrong: {text}", len(others)))
    lead = "the simulation lacks " if missing else ""
    return lead + listed([*lacking, *beside], len(causes))


def sentence_case(words: str) -> str:
    """The words with a capital first letter."""
    return words[:1].upper() + words[1:]


class FindingWords(NamedTuple):
    """Row of the table of findings."""

    law: str
    numbers: tuple[str, ...]
    probability: str
    torque: str
    where: str


def verdict_words(result: Diagnosis) -> str:
    """The verdict of a diagnosis in a sentence."""
    if result.verdict == "undecided":
        return "the recordings are too short, or move too little, to show whether something is missing"
    if result.verdict == "nothing_missing":
        within = f", within {share(result.tolerance)} of the torque" if isfinite(result.tolerance) else ""
        return f"nothing is missing{within}"
    causes = [named(result.robot, finding.law, finding.std, finding.stated) for finding in result.causes]
    left = [residual.share for residual in result.without_cause]
    words = causes_words(causes, result.verdict == "named", len(result.robot.joints), left)
    alone = result.verdict == "named" and len(causes) == 1 and isfinite(result.causes[0].probability)
    return words + (f" (probability {confidence(result.causes[0].probability)})" if alone else "")


def is_unreliable(flags: Sequence[str]) -> bool:
    """Whether a flag of a diagnosis says more than that other laws explain the recordings as well."""
    from ....diagnose.thresholds import AMBIGUOUS_WORDS

    return any(AMBIGUOUS_WORDS not in flag for flag in flags)


def by_size(result: Diagnosis) -> tuple[list[Finding], list[Finding]]:
    """Causes and corrections of much torque, and small corrections, each in the order of the torque they explain."""
    beyond = [finding for finding in result.findings if not finding.ordinary or not finding.in_model]
    small = [x for x in beyond if x.role == "secondary" and x.torque_share.max() < MIN_LARGE_SHARE]
    return [x for x in beyond if x not in small], small


def ordinary_words(result: Diagnosis) -> list[str]:
    """Friction, rotors and offsets of which the description states nothing: a sentence for each kind."""
    joints = len(result.robot.joints)
    kinds = [
        [named(result.robot, x.law, x.std, x.stated) for x in result.findings if x.ordinary and x.law.effect is effect]
        for effect in dict.fromkeys(x.law.effect for x in result.findings if x.ordinary)
    ]
    return [finding_headline(kind[0]) if len(kind) == 1 else _together(kind, joints) for kind in kinds]


def role_words(result: Diagnosis) -> dict[str, str]:
    """Headings of the findings of each role."""
    stated = [bool(finding.stated) for finding in result.causes]
    causes = "Wrong in the simulation" if all(stated) else "Missing or wrong" if any(stated) else "Missing"
    if result.verdict == "unknown" and not result.without_cause:
        causes = "Causes that explain less than they leave unexplained"
    return {"cause": causes, "secondary": "Small corrections"}


def place_words(result: Diagnosis, most: int | None = None) -> list[str]:
    """Location of each joint's residual before the extension; joints with noise only share a sentence.

    At most `most` joints are listed, those with the largest residual over its irreducible part; the others are counted.
    """
    fit, quiet = result.before, list[str]()
    said: list[tuple[float, str]] = []
    for place in result.located:
        joint, ratio = result.robot.joints[place.joint], fit.train_rms[place.joint] / fit.irreducible_rms[place.joint]
        if ratio <= MAX_NOISE_RATIO:
            quiet.append(joint)
            continue
        words = f"{joint} {place.region}: {share(place.share)} of its residual torque; {_follows(place)}"
        said.append((float(ratio), words))
    least = sorted((ratio for ratio, _ in said), reverse=True)[most - 1] if most and len(said) > most else 0.0
    shown = [words for ratio, words in said if not ratio < least]
    more = [f"and {plural(len(said) - len(shown), 'more joint')} in diagnosis.json"] if len(shown) < len(said) else []
    return [*shown, *more, *([f"{shorten(quiet)}: noise only"] if quiet else [])]


def finding_words(robot: Robot, finding: Finding) -> FindingWords:
    """A finding, in the cells of a table."""
    torque = dict(zip(robot.joints, finding.torque_share.tolist(), strict=True))
    first = max(torque, key=lambda joint: torque[joint])
    where = robot.joints[finding.where.joint]
    others = sum(x >= MIN_COUNTED_SHARE for joint, x in torque.items() if joint != first)
    return FindingWords(
        law_words(robot, finding.law),
        number_lines(robot, finding),
        confidence(finding.probability),
        share(torque[first]) + (f" of {first}" if others else ""),
        finding.where.region + ("" if where == first else f" of {where}"),
    )


def secondary_words(robot: Robot, finding: Finding) -> str:
    """A small correction in one line."""
    words = finding_words(robot, finding)
    lead = f"{words.law}, probability {words.probability}, {words.torque}"
    return f"{lead}: {'; '.join(words.numbers)}" if words.numbers else lead


def alternative_words(robot: Robot, finding: Finding, max_rivals: int | None = MAX_PRINTED_ALTERNATIVES) -> list[str]:
    """Alternatives of a finding with their probability and a separating motion; the others are counted.

    At most `max_rivals` probable ones are listed; None: all, even improbable ones.
    """
    near = [x.probability >= MIN_SHOWN or x.separating_motion.startswith("no motion") for x in finding.alternatives]
    rivals = list(finding.alternatives if max_rivals is None else compress(finding.alternatives, near))[:max_rivals]
    said = list[str]()
    for rival in rivals:
        sure = confidence(rival.probability) if rival.probability >= MIN_SHOWN else f"<{MIN_SHOWN}"
        motion = f": {rival.separating_motion}" if rival.separating_motion else ""
        said.append(f"or {law_words(robot, rival.law)}, probability {sure}{motion}")
    more = len(finding.alternatives) - len(rivals)
    return [*said, *([f"and {more} more in diagnosis.json"] if said and more else [])]


def unexplained_words(result: Diagnosis) -> list[str]:
    """Residual of each joint that no law explains, and whether the extended simulation models it empirically."""
    said = list[str]()
    for left in result.unexplained:
        removed = f"which removes {share(left.held_out_gain)} of the held-out residual"
        modelled = f"; the extended simulation models it as empirical torque, {removed}" if left.modelled else ""
        part = f"{left.place.region}: {share(left.place.share)} of it; {_follows(left.place)}"
        said.append(f"{result.robot.joints[left.joint]}: {share(left.share)} of its torque; {part}{modelled}")
    return said


def trust_words(result: Diagnosis) -> list[str]:
    """Estimated error of the inertials of a simulation without covariance."""
    if result.prior_scale <= 0 or result.informed:
        return []
    scale = figure(result.prior_scale, 2)
    return [f"The inertials of the simulation deviate by about {scale} times the usual tolerance."]


def power_words(result: Diagnosis) -> list[str]:
    """The smallest sizes of usual laws that would have been named, and the laws of which no plausible size would."""
    seen, unseen = list[str](), list[str]()
    for effect, unit in dict.fromkeys((x.effect, x.unit) for x in result.detectable):
        sizes = [x for x in result.detectable if (x.effect, x.unit) == (effect, unit)]
        law, least = effect.replace("_", " "), [x.smallest for x in sizes if x.smallest is not None]
        hidden = [x.joint for x in sizes if x.smallest is None and x.joint is not None]
        if len(least) < len(sizes):
            unseen.append(f"{law} of {shorten(hidden)}" if hidden else law)
        elif effect in PRINTED_EFFECTS:
            law += " of any joint" if len(sizes) > 1 else ""
            seen.append(f"{law} above {quantity(max(least), None, unit)}")
    said = [shorten(seen) if seen else "", f"at no plausible size {shorten(unseen)}" if unseen else ""]
    return [f"{POWER_TITLE}: {'; '.join(filter(None, said))}."] if seen or unseen else []


def smallest_sizes(result: Diagnosis) -> list[str]:
    """A line for each effect, with the smallest size that would have been named at each joint."""
    said = dict[str, list[str]]()
    for x in result.detectable:
        size = "not" if x.smallest is None else quantity(x.smallest, None, x.unit)
        said.setdefault(f"{x.effect}, {x.parameter}".replace("_", " "), []).append(f"{x.joint or ''} {size}".strip())
    return [f"{law}: {', '.join(sizes)}" for law, sizes in said.items()]


def _follows(place: Location) -> str:
    if place.explained < MIN_NAMED_EXPLAINED:
        return "no single variable explains it"
    return f"{place.variable} explains {share(place.explained)}"
