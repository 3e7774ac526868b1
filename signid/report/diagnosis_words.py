"""A diagnosis in words: what the terminal and the page both say."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from ..errors import shorten
from ..laws import spoken
from ..types import TWO_SIDED
from .diagnosis import finding_numbers
from .layout import plural
from .numbers import figure, share, with_interval
from .signs import confidence

if TYPE_CHECKING:
    from ..diagnose import Alternative, Diagnosis, Finding, Unexplained
    from ..diagnose.locate import Place
    from ..types import Law, Robot

NOISE = 1.08  # of the noise floor: so much residual is noise
NEGLIGIBLE = 0.001  # probability
BETTER = 0.8  # held-out residual over what it was: less is no chance
LITTLE = 0.3  # share that a variable explains: less is as good as nothing
WORSE = 1.02  # times the error before: less is no worse
GONE = 0.005  # of torque: less is not shown as a share


class FindingWords(NamedTuple):
    """A line of the table of findings."""

    law: str
    numbers: tuple[str, ...]
    probability: str
    torque: str
    where: str


def verdict_words(result: Diagnosis) -> str:
    """The verdict in a sentence."""
    causes = _together(result.robot, [finding.law for finding in result.causes])
    if result.verdict == "nothing_missing":
        better = [joint for joint, gain in zip(result.robot.joints, result.gain, strict=True) if gain < BETTER]
        refit = f", but numbers that it states are wrong (at {shorten(better)})" if better else ""
        return f"{'no law' if better else 'nothing'} is missing, within {share(result.tolerance)} of torque{refit}"
    if result.verdict == "named":
        alone = len(result.causes) == 1
        sure = f" (probability {confidence(result.causes[0].probability)})" if alone else ""
        return f"the simulation lacks {causes}{sure}"
    lead = f"; nearest to it: {causes}" if causes else ""
    return f"the simulation lacks something that no law explains{lead}"


def role_words(result: Diagnosis) -> dict[str, str]:
    """What stands above the findings of each role."""
    causes = "Nearest to what is missing" if result.verdict == "unknown" else "Missing"
    return {"cause": causes, "secondary": "Small corrections beside it"}


def place_words(result: Diagnosis) -> list[str]:
    """Where the residual of each joint is, before anything was added; joints that show only noise share a sentence."""
    fit, said, quiet = result.before, list[str](), list[str]()
    for place in result.located:
        joint = result.robot.joints[place.joint]
        if fit.train_rms[place.joint] <= NOISE * fit.noise_floor[place.joint]:
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
        spoken(finding.law, robot),
        (*_numbers(robot, finding), *filter(None, [finding.law.effect.meaning(finding.law.parameters)])),
        confidence(finding.probability),
        share(torque[first]) + (f" of {first}" if others else ""),
        finding.where.region + ("" if where == first else f" of {where}"),
    )


def alternative_words(robot: Robot, finding: Finding) -> list[str]:
    """Laws that explain a finding as well, or nearly, and what would tell; those that are out of question counted."""
    said, out = list[str](), 0
    for rival in finding.alternatives:
        if rival.probability < NEGLIGIBLE and not _is_twin(rival):
            out += 1
            continue
        told = confidence(rival.probability) if rival.probability >= NEGLIGIBLE else f"<{NEGLIGIBLE}"
        motion = f": {rival.separating_motion}" if rival.separating_motion else ""
        said.append(f"or {spoken(rival.law, robot)}, probability {told}{motion}")
    return [*said, *([f"{out} more with a probability below {NEGLIGIBLE}"] if said and out else [])]


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
    """What became of the bodies of the simulation, if anything."""
    if result.trust <= 0:
        return []
    return [
        f"The inertials of the simulation were refitted: off by about {figure(result.trust, 2)} times what is usual."
    ]


def _follows(place: Place) -> str:
    if place.explained < LITTLE:
        return "no single variable explains it"
    return f"{place.variable} explains {share(place.explained)}"


def _is_twin(rival: Alternative) -> bool:
    return rival.separating_motion.startswith("no motion")


def number_cells(robot: Robot, finding: Finding) -> list[tuple[str, str, str, str]]:
    """Each number: key, value, half width of its 95 % interval, unit; those that could be zero are only counted."""
    numbers = finding_numbers(robot, finding)
    optional = {key: number for key, number in numbers.items() if key in finding.law.effect.optional}
    hidden = [key for key, x in optional.items() if x["std"] is not None and abs(x["value"]) < TWO_SIDED * x["std"]]
    told = [(key, *_cells(**number)) for key, number in numbers.items() if key not in (*hidden, "partner")]
    return [*told, *([(f"{plural(len(hidden), 'more number')}: could be zero", "", "", "")] if hidden else [])]


def _cells(value: float, std: float | None, unit: str) -> tuple[str, str, str]:
    told, half = (figure(value), "-") if std is None else with_interval(value, std)
    known = std is None or half != "-"
    return told, "" if half == "-" else half, unit if known and unit != "1" else ""


def _numbers(robot: Robot, finding: Finding) -> tuple[str, ...]:
    """The same, a line each."""
    cells = ((key, value, half and f"± {half}", unit) for key, value, half, unit in number_cells(robot, finding))
    return tuple(" ".join(filter(None, line)) for line in cells)


def _together(robot: Robot, laws: Sequence[Law]) -> str:
    """Laws by effect, each effect once with its joints, effects of the same joints together."""
    joints, effects = dict[str, list[str]](), dict[str, list[str]]()
    for law in laws:
        effect, _, where = spoken(law, robot).partition(" of ")
        known = joints.setdefault(effect, [])
        known += [where] if where not in known else []
    for effect, places in joints.items():
        everywhere = len(places) == len(robot.joints) > 1
        effects.setdefault("all joints" if everywhere else ", ".join(places), []).append(effect)
    return "; ".join(", ".join(names) + (f" of {where}" if where else "") for where, names in effects.items())
