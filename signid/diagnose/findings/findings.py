"""What is taken for true -> findings with numbers, places and rivals, and the extended simulation."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...effects.naming import law_name
from ...errors import shorten
from ...regression.session import Session
from ...types import Array, Law, Shape
from ..data.column_groups import Group
from ..data.dataset import Setting
from ..data.hypotheses import VARIABLES
from ..data.locate import Place, locate
from ..data.motions import torque_rows
from ..evidence.posterior_odds import Judge
from ..evidence.selection import Found
from ..extend.holdout import Shown
from ..result import Alternative, Finding, Unexplained
from ..search.stepwise import FIRST, NEXT, needed
from .alternatives import DOUBT, Slot, with_held_out
from .covariance import covariance_after
from .held_out_selection import Extended, hand_out
from .intervals import deviations
from .separating_motion import tell_apart
from .stated import resized, stated_numbers, whole_law
from .verdict import Verdict

UNSURE = 0.95  # probability below which a cause is flagged
LISTED = 4  # rivals of a finding whose separating motion is sought
SEPARATED = 2 * LISTED  # rivals of all findings together: each search simulates several motions
REFUSED = 0.0  # log odds that a law has at most if the extended simulation is better without it
VAGUE = 0.5  # standard deviations of a coefficient: nearer to zero, and a law may as well not be there
PLAUSIBLE = 0.05  # probability of a rival above which a separating motion is sought


class Result(NamedTuple):
    """What there is to be told."""

    verdict: str  # nothing_missing, named or unknown
    shown: Shown  # of the extended simulation
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    located: tuple[Place, ...]
    tolerance: float
    flags: tuple[str, ...]


class _Case(NamedTuple):
    """One hypothesis that is taken for true, and what is told of it from."""

    setting: Setting
    judge: Judge
    found: Found
    slot: Slot
    role: str
    extended: Extended
    seed: int


def find(
    setting: Setting, session: Session, judge: Judge, found: Found, slots: Sequence[Slot], verdict: Verdict, seed: int
) -> Result:
    """Everything that is told of what was taken for true.

    Args:
        setting: motions and rows.
        session: gives what is held out.
        judge: library and evidence.
        found: what is taken for true.
        slots: how sure each is.
        verdict: roles.
        seed: of motions that tell laws apart.
    """
    order = [*verdict.causes, *verdict.secondary]
    extended = hand_out(session, setting.model, judge, found, order)
    laws, shown = extended.laws, extended.shown
    stds = deviations(setting, judge, found, laws)
    vague = {group for group, own in laws.items() if all(map(_is_vague, own, stds[group]))}
    slots = [_judged(slot, extended, session.judges_itself, vague) for slot in slots]
    if order:
        covariance = covariance_after(shown.model, judge.evidence, found, extended)
        shown = shown._replace(model=replace(shown.model, covariance=covariance))
    gains = extended.gain
    weak = {slot.group for slot in slots if slot.probability < DOUBT}
    refused = [] if session.judges_itself else [g for g in order if not extended.holds(g) and extended.support[g] <= 0]
    weak.update(group for group in refused if verdict.is_quiet(judge.evidence.data.rows(group)))
    verdict = verdict.without(weak).raised(slots, gains).confirmed(extended.kept)
    cases = [
        _Case(setting, judge, found, slot, "cause" if group in verdict.causes else "secondary", extended, seed)
        for group in (*verdict.causes, *verdict.secondary)
        for slot in slots
        if slot.group is group
    ]
    findings = list(_findings(cases, stds, gains))
    if verdict.name == "unknown" and not verdict.causes:
        findings = [*resized(setting, session, judge, found, extended), *findings]
    floor, scale = judge.evidence.data.floor, judge.evidence.data.scale
    return Result(
        verdict=verdict.name,
        shown=shown,
        findings=tuple(findings),
        unexplained=tuple(_unexplained(setting, shown, verdict)),
        located=tuple(_place(setting, j, setting.table.residual[:, j]) for j in range(setting.table.joints)),
        tolerance=float(np.max(np.sqrt(verdict.threshold / judge.evidence.data.counts) * floor / scale)),
        flags=tuple(_flags(setting, findings, verdict, session.judges_itself)),
    )


def _judged(slot: Slot, extended: Extended, itself: bool, vague: Collection[Group] = ()) -> Slot:
    """How sure a hypothesis is after the held-out rows, if there are any.

    One that they speak against, or whose numbers are vague, is even at most.
    """
    refused = not extended.holds(slot.group) and not itself
    limited = replace(slot, most=min(slot.most, REFUSED)) if refused or slot.group in vague else slot
    return with_held_out(limited, extended.support[slot.group])


def _is_vague(law: Law, std: Mapping[str, float]) -> bool:
    """Whether every coefficient of a law is near zero in the extended simulation, for its standard deviation."""
    keys = law.effect.linear()
    return bool(keys) and all(abs(law.parameters[key]) < VAGUE * std.get(key, 0.0) for key in keys)


def _findings(
    cases: Sequence[_Case], stds: Mapping[Group, Sequence[dict[str, float]]], gains: Mapping[Group, float]
) -> Iterator[Finding]:
    """The findings of all laws, with separating motions as far as time allows."""
    left = SEPARATED
    for case in cases:
        group = case.slot.group
        for law, std in zip(case.extended.laws[group], stds[group], strict=True):
            rivals = tuple(_alternatives(case, law, left))
            left -= sum(bool(rival.separating_motion) for rival in rivals)
            yield _finding(case, law, std, gains[group], rivals)


def _finding(case: _Case, law: Law, std: dict[str, float], gain: float, rivals: tuple[Alternative, ...]) -> Finding:
    setting, judge, found, slot = case[:4]
    in_model = case.extended.holds(slot.group)
    whole = whole_law(law, setting.model, case.extended.shown.model if in_model else None)
    torque = torque_rows(setting.thin, setting.pieces, law)
    share = np.zeros(setting.table.joints)
    for j, x in torque.items():
        share[j] = np.sqrt(np.mean(x**2)) / judge.evidence.data.scale[j]
    loudest = max(torque, key=lambda j: share[j])
    joint = law.joints[0] if len(law.joints) <= 2 and law.joints[0] in torque else loudest
    return Finding(
        law=whole,
        std=std,
        role=case.role,
        probability=slot.probability,
        torque_share=share,
        where=_place(setting, joint, torque[joint], VARIABLES if _passes(law) else VARIABLES[:-1]),
        statistic=float(found.log_odds[slot.group]),
        threshold=needed(judge, slot.group, float(found.trust == 0), 0, FIRST if len(found.true) == 1 else NEXT),
        held_out_gain=gain,
        alternatives=rivals,
        stated=stated_numbers(setting.model, whole),
        in_model=in_model,
    )


def _alternatives(case: _Case, law: Law, most: int) -> Iterator[Alternative]:
    """The rivals of a law, the likeliest first; at most so many plausible ones with a separating motion."""
    model, floor, most = case.setting.model, case.judge.evidence.data.floor, min(most, LISTED)
    for k, (probability, group) in enumerate(case.slot.rivals.values()):
        for rival in group.claim.laws[:1]:
            sought = k < most and probability > PLAUSIBLE
            motion = tell_apart(model, law, rival, floor, case.seed) if sought else ""
            yield Alternative(rival, probability, motion)


def _place(setting: Setting, joint: int, torque: Array, variables: Sequence[str] = VARIABLES) -> Place:
    return locate(setting.table, joint, torque, bool(setting.model.robot.prismatic[joint]), variables)


def _passes(law: Law) -> bool:
    """Whether a law changes with time by itself."""
    return any(kind.unit == "s" for kind in law.effect.parameters.values() if isinstance(kind, Shape))


def _unexplained(setting: Setting, shown: Shown, verdict: Verdict) -> Iterator[Unexplained]:
    rest, torque = np.nan_to_num(shown.learned.rest), np.nan_to_num(shown.learned.torque)
    excess = np.sum((rest / shown.learned.unforeseen(setting.noise, 1)) ** 2 - 1, axis=0)
    for joint in np.flatnonzero(excess > verdict.threshold).tolist():
        share = float(np.sqrt(np.mean(rest[:, joint] ** 2) / max(float(np.mean(torque[:, joint] ** 2)), 1e-300)))
        yield Unexplained(joint, _place(setting, joint, rest[:, joint]), share)


def _flags(setting: Setting, findings: Sequence[Finding], verdict: Verdict, itself: bool) -> Iterator[str]:
    robot = setting.model.robot
    if verdict.name == "unknown":
        named = any(finding.role == "cause" for finding in findings)
        lead = "the causes named leave more than they explain: " if named else ""
        yield (
            f"{lead}something is missing that no effect of the library explains; "
            "what it depends on is said, not what it is"
        )
    if out := list(dict.fromkeys(law_name(finding.law, robot) for finding in findings if not finding.in_model)):
        explain, they = ("explains", "it was found in") if len(out) == 1 else ("explain", "they were found in")
        are = "it is" if len(out) == 1 else "they are"
        why = "but not by enough for so few rows" if itself else "but not what was held out"
        yield f"{shorten(out)} {explain} the recordings {they}, {why}: {are} not in the extended simulation"
    for finding in findings:
        unsure = finding.probability < UNSURE and finding.in_model  # of others it is said above
        if finding.role == "cause" and unsure and verdict.name == "named":
            rivals = ", ".join(f"{law_name(a.law, robot)} ({a.probability:.0%})" for a in finding.alternatives[:3])
            yield (
                f"{law_name(finding.law, robot)} is one of several that explain the recordings "
                f"({finding.probability:.0%}); the others: {rivals or 'no effect of the library'}"
            )
