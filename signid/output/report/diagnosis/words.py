"""A diagnosis in words: what the terminal and the page both say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from ....errors import shorten
from ..numbers import figure, share
from ..results.signs import confidence
from .numbers import law_words, number_lines, stated_words

if TYPE_CHECKING:
    from ....diagnose import Alternative, Diagnosis, Finding, Unexplained
    from ....diagnose.data.locate import Location
    from ....types import Robot

NOISE = 1.08  # of the noise floor: so much residual is noise
NEGLIGIBLE = 0.001  # probability
BETTER = 0.8  # held-out residual over what it was: less is no chance
LITTLE = 0.3  # share that a variable explains: less is as good as nothing
WORSE = 1.02  # times the error before: less is no worse
GONE = 0.005  # of torque: less is not shown as a share
RIVALS = 3  # alternatives of a finding that the terminal shows
COMPARED = 3  # wrong numbers that the verdict shows; of more it shows the names of the laws


class FindingWords(NamedTuple):
    """A line of the table of findings."""

    law: str
    numbers: tuple[str, ...]
    probability: str
    torque: str
    where: str


def verdict_words(result: Diagnosis) -> str:
    """The verdict in a sentence."""
    if result.verdict == "nothing_missing":
        better = [joint for joint, gain in zip(result.robot.joints, result.gain, strict=True) if gain < BETTER]
        refit = f", but numbers that it states are wrong (at {shorten(better)})" if better else ""
        return f"{'no law' if better else 'nothing'} is missing, within {share(result.tolerance)} of torque{refit}"
    if result.verdict == "named":
        alone = len(result.causes) == 1
        sure = f" (probability {confidence(result.causes[0].probability)})" if alone else ""
        return "; ".join(_cause_words(result)) + sure
    unexplained = "the simulation lacks something that no law explains"
    if not result.causes:
        return unexplained
    leave = "leaves more than it explains" if len(result.causes) == 1 else "leave more than they explain"
    return f"{_together(result.robot, result.causes)} {leave}; {unexplained}"


def _cause_words(result: Diagnosis) -> Iterator[str]:
    """Laws that are missing, then those whose numbers are wrong: the numbers of few, the names of many."""
    missing, wrong = ([f for f in result.causes if bool(f.stated) == stated] for stated in (False, True))
    if missing:
        yield f"the simulation lacks {_together(result.robot, missing)}"
    compared = {k: words for k, finding in enumerate(wrong) if (words := stated_words(result.robot, finding))}
    compared = compared if len(compared) <= COMPARED else {}
    yield from compared.values()
    if others := [finding for k, finding in enumerate(wrong) if k not in compared]:
        yield f"numbers of the simulation are wrong: {_together(result.robot, others)}"


def role_words(result: Diagnosis) -> dict[str, str]:
    """What stands above the findings of each role."""
    stated = [bool(finding.stated) for finding in result.causes]
    causes = "Wrong in the simulation" if all(stated) else "Missing or wrong" if any(stated) else "Missing"
    if result.verdict == "unknown":
        causes = "Causes that leave more than they explain"
    return {"cause": causes, "secondary": "Small corrections beside it"}


def place_words(result: Diagnosis) -> list[str]:
    """Where the residual of each joint is, before anything was added; joints that show only noise share a sentence."""
    fit, said, quiet = result.before, list[str](), list[str]()
    for place in result.located:
        joint = result.robot.joints[place.joint]
        if fit.train_rms[place.joint] <= NOISE * fit.irreducible_rms[place.joint]:
            quiet.append(joint)
            continue
        said.append(f"{joint} {place.region}: {share(place.share)} of its unexplained torque; {_follows(place)}")
    return [*said, *([f"{shorten(quiet)}: nothing but noise"] if quiet else [])]


def finding_words(robot: Robot, finding: Finding) -> FindingWords:
    """What was found, in the cells of a table."""
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
    """A small correction in a line."""
    words = finding_words(robot, finding)
    lead = f"{words.law}, probability {words.probability}, {words.torque}"
    return f"{lead}: {'; '.join(words.numbers)}" if words.numbers else lead


def alternative_words(robot: Robot, finding: Finding, most: int | None = RIVALS) -> list[str]:
    """Laws that explain a finding as well, or nearly, and what would separate them; the others counted.

    Args:
        robot: gives the names.
        finding: with its alternatives.
        most: of them; None for all, however improbable.
    """
    rivals = [rival for rival in finding.alternatives if most is None or _is_near(rival)][:most]
    said = list[str]()
    for rival in rivals:
        sure = confidence(rival.probability) if rival.probability >= NEGLIGIBLE else f"<{NEGLIGIBLE}"
        motion = f": {rival.separating_motion}" if rival.separating_motion else ""
        said.append(f"or {law_words(robot, rival.law)}, probability {sure}{motion}")
    more = len(finding.alternatives) - len(rivals)
    return [*said, *([f"and {more} more in diagnosis.json"] if said and more else [])]


def unexplained_words(result: Diagnosis) -> list[str]:
    """What is left of each joint that no law explains."""
    return [
        f"{result.robot.joints[left.joint]}: {share(left.share)} of its torque, {share(left.place.share)} of that "
        f"{left.place.region}; {_follows(left.place)}{_modelled(left)}"
        for left in result.unexplained
    ]


def _modelled(left: Unexplained) -> str:
    """Whether the extended simulation has it all the same."""
    if not left.modelled:
        return ""
    return (
        f"; the extended simulation has it as empirical torque, which takes away {share(left.held_out_gain)} held out"
    )


def trust_words(result: Diagnosis) -> list[str]:
    """How far the bodies of a simulation without covariance seem to be off, if at all."""
    if result.prior_scale <= 0 or result.informed:
        return []
    return [
        f"The inertials of the simulation seem to be off, by about {figure(result.prior_scale, 2)} times what is usual."
    ]


def _follows(place: Location) -> str:
    if place.explained < LITTLE:
        return "no single variable explains it"
    return f"{place.variable} explains {share(place.explained)}"


def _is_near(rival: Alternative) -> bool:
    """Whether a rival is probable enough to be shown, or is the same to any motion."""
    return rival.probability >= NEGLIGIBLE or rival.separating_motion.startswith("no motion")


def _together(robot: Robot, findings: Sequence[Finding]) -> str:
    """Laws by effect, each effect once with its joints, effects of the same joints together."""
    joints, effects = dict[str, list[str]](), dict[str, list[str]]()
    for finding in findings:
        effect, _, where = law_words(robot, finding.law).partition(" of ")
        known = joints.setdefault(effect, [])
        known += [where] if where not in known else []
    for effect, places in joints.items():
        everywhere = len(places) == len(robot.joints) > 1
        effects.setdefault("all joints" if everywhere else ", ".join(places), []).append(effect)
    return "; ".join(", ".join(names) + (f" of {where}" if where else "") for where, names in effects.items())
