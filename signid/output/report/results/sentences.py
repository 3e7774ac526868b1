"""Sentences about a diagnosis, shared by the terminal and the page."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

from ....diagnose.findings.thresholds import AMBIGUOUS
from ....errors import shorten
from ..layout import figure, plural, share
from .headline import causes_words, named
from .laws import law_words, number_lines
from .signs import confidence

if TYPE_CHECKING:
    from ....diagnose import Diagnosis, Finding
    from ....diagnose.data.locate import Location
    from ....types import Robot

NOISE = 1.08  # ratio of residual to irreducible rms up to which a residual is noise
NEGLIGIBLE = 0.001  # probability below which an alternative is not shown
BETTER = 0.8  # ratio of held-out residuals, after to before, below which a refit is significant
LITTLE = 0.3  # explained share below which no variable is named
WORSE = 1.02  # ratio of errors, after to before, above which a result is worse
GONE = 0.005  # share of torque below which a joint is not counted
RIVALS = 3  # maximum number of alternatives shown on the terminal


class FindingWords(NamedTuple):
    """Row of the table of findings."""

    law: str
    numbers: tuple[str, ...]
    probability: str
    torque: str
    where: str


def verdict_words(result: Diagnosis) -> str:
    """The verdict of a diagnosis in a sentence."""
    if result.verdict == "nothing_missing":
        better = [joint for joint, gain in zip(result.robot.joints, result.gain, strict=True) if gain < BETTER]
        refit = f", but stated parameters are wrong (at {shorten(better)})" if better else ""
        within = f", within {share(result.tolerance)} of the torque" if isfinite(result.tolerance) else ""
        return f"{'no law' if better else 'nothing'} is missing{within}{refit}"
    causes = [named(result.robot, finding.law, finding.std, finding.stated) for finding in result.causes]
    left = [one.share for one in result.without_cause]
    words = causes_words(causes, result.verdict == "named", len(result.robot.joints), left)
    alone = result.verdict == "named" and len(causes) == 1 and isfinite(result.causes[0].probability)
    return words + (f" (probability {confidence(result.causes[0].probability)})" if alone else "")


def is_unreliable(flags: Sequence[str]) -> bool:
    """Whether a flag of a diagnosis says more than that other laws explain the recordings as well."""
    return any(AMBIGUOUS not in flag for flag in flags)


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
        if ratio <= NOISE:
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
    others = sum(x >= GONE for joint, x in torque.items() if joint != first)
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


def alternative_words(robot: Robot, finding: Finding, most: int | None = RIVALS) -> list[str]:
    """Alternatives of a finding with their probability and a separating motion; the others are counted.

    At most `most` probable ones are listed; None: all, even improbable ones.
    """
    near = [x.probability >= NEGLIGIBLE or x.separating_motion.startswith("no motion") for x in finding.alternatives]
    rivals = list(finding.alternatives if most is None else compress(finding.alternatives, near))[:most]
    said = list[str]()
    for rival in rivals:
        sure = confidence(rival.probability) if rival.probability >= NEGLIGIBLE else f"<{NEGLIGIBLE}"
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


def _follows(place: Location) -> str:
    if place.explained < LITTLE:
        return "no single variable explains it"
    return f"{place.variable} explains {share(place.explained)}"
