"""The selected laws -> findings with numbers, places and rivals, and the extended simulation."""

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
from ..data.dataset import Dataset
from ..data.hypotheses import VARIABLES
from ..data.locate import Location, locate
from ..data.motions import torque_rows
from ..evidence.selection import Selection
from ..extend.holdout import Shown
from ..result import Alternative, Finding, Unexplained
from ..search.stepwise import FIRST, NEXT, needed
from .alternatives import DOUBT
from .contender import Contender
from .covariance import covariance_after
from .held_out_selection import Extended, hand_out
from .intervals import deviations
from .separating_motion import tell_apart
from .stated import resized, stated_numbers, whole_law
from .verdict import Verdict

UNSURE = 0.95  # probability below which a cause is flagged
LISTED = 4  # rivals of a finding whose separating motion is sought
SEPARATED = 2 * LISTED  # rivals of all findings together: each search simulates several motions
VAGUE = 0.5  # standard deviations of a coefficient: nearer to zero, and a law may as well not be there
PLAUSIBLE = 0.05  # probability of a rival above which a separating motion is sought


class Result(NamedTuple):
    """What there is to be told."""

    verdict: str  # nothing_missing, named or unknown
    shown: Shown  # of the extended simulation
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    located: tuple[Location, ...]
    tolerance: float
    flags: tuple[str, ...]


class _Case(NamedTuple):
    """One hypothesis that is selected, and what is told of it from."""

    dataset: Dataset
    found: Selection
    contender: Contender
    role: str
    extended: Extended
    seed: int


def find(
    dataset: Dataset, session: Session, found: Selection, contenders: Sequence[Contender], verdict: Verdict, seed: int
) -> Result:
    """Everything that is told of what was taken for true.

    Args:
        dataset: motions and rows.
        session: gives what is held out.
        found: the selected laws.
        contenders: how sure each is.
        verdict: roles.
        seed: of motions that tell laws apart.
    """
    order = [*verdict.causes, *verdict.secondary]
    extended = hand_out(session, dataset.model, found, order)
    laws, shown = extended.laws, extended.shown
    stds = deviations(dataset, found, laws)
    vague = {group for group, own in laws.items() if all(map(_is_vague, own, stds[group]))}
    contenders = [_judged(contender, extended, session.judges_itself, vague) for contender in contenders]
    if order:
        covariance = covariance_after(shown.model, found.evidence, found, extended)
        shown = shown._replace(model=replace(shown.model, covariance=covariance))
    gains = extended.gain
    weak = {contender.group for contender in contenders if contender.probability < DOUBT}
    refused = [] if session.judges_itself else [g for g in order if not extended.holds(g) and extended.support[g] <= 0]
    weak.update(group for group in refused if verdict.is_quiet(found.data.rows(group)))
    verdict = verdict.without(weak).with_promoted(contenders, gains).with_demoted(extended.kept)
    cases = [
        _Case(dataset, found, contender, "cause" if group in verdict.causes else "secondary", extended, seed)
        for group in (*verdict.causes, *verdict.secondary)
        for contender in contenders
        if contender.group is group
    ]
    findings = list(_findings(cases, stds, gains))
    if verdict.name == "unknown" and not verdict.causes:
        findings = [*resized(dataset, session, found, extended), *findings]
    floor, scale = found.data.floor, found.data.scale
    return Result(
        verdict=verdict.name,
        shown=shown,
        findings=tuple(findings),
        unexplained=tuple(_unexplained(dataset, shown, verdict)),
        located=tuple(_place(dataset, j, dataset.table.residual[:, j]) for j in range(dataset.table.joints)),
        tolerance=float(np.max(np.sqrt(verdict.threshold / found.data.counts) * floor / scale)),
        flags=tuple(_flags(dataset, findings, verdict, session.judges_itself)),
    )


def _judged(contender: Contender, extended: Extended, itself: bool, vague: Collection[Group] = ()) -> Contender:
    """With what the held-out rows say; a law that they refuse, or whose numbers are vague, is even at most."""
    refused = (not extended.holds(contender.group) and not itself) or contender.group in vague
    return replace(contender, held_out=extended.support[contender.group], refused=refused)


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
        group = case.contender.group
        for law, std in zip(case.extended.laws[group], stds[group], strict=True):
            rivals = tuple(_alternatives(case, law, left))
            left -= sum(bool(rival.separating_motion) for rival in rivals)
            yield _finding(case, law, std, gains[group], rivals)


def _finding(case: _Case, law: Law, std: dict[str, float], gain: float, rivals: tuple[Alternative, ...]) -> Finding:
    dataset, found, contender = case.dataset, case.found, case.contender
    in_model = case.extended.holds(contender.group)
    usual = FIRST if len(found.selected) == 1 else NEXT
    whole = whole_law(law, dataset.model, case.extended.shown.model if in_model else None)
    torque = torque_rows(dataset.thin, dataset.pieces, law)
    share = np.zeros(dataset.table.joints)
    for j, x in torque.items():
        share[j] = np.sqrt(np.mean(x**2)) / found.data.scale[j]
    loudest = max(torque, key=lambda j: share[j])
    joint = law.joints[0] if len(law.joints) <= 2 and law.joints[0] in torque else loudest
    return Finding(
        law=whole,
        std=std,
        role=case.role,
        probability=contender.probability,
        torque_share=share,
        where=_place(dataset, joint, torque[joint], VARIABLES if _passes(law) else VARIABLES[:-1]),
        statistic=float(found.log_odds[contender.group]),
        threshold=needed(found.posterior, contender.group, float(found.prior_scale == 0), 0, usual),
        held_out_gain=gain,
        alternatives=rivals,
        stated=stated_numbers(dataset.model, whole),
        in_model=in_model,
    )


def _alternatives(case: _Case, law: Law, most: int) -> Iterator[Alternative]:
    """The rivals of a law, the likeliest first; at most so many plausible ones with a separating motion."""
    model, floor, most = case.dataset.model, case.found.data.floor, min(most, LISTED)
    for k, (probability, group) in enumerate(case.contender.rivals.values()):
        for rival in group.claim.laws[:1]:
            sought = k < most and probability > PLAUSIBLE
            motion = tell_apart(model, law, rival, floor, case.seed) if sought else ""
            yield Alternative(rival, probability, motion)


def _place(dataset: Dataset, joint: int, torque: Array, variables: Sequence[str] = VARIABLES) -> Location:
    return locate(dataset.table, joint, torque, bool(dataset.model.robot.prismatic[joint]), variables)


def _passes(law: Law) -> bool:
    """Whether a law changes with time by itself."""
    return any(kind.unit == "s" for kind in law.effect.parameters.values() if isinstance(kind, Shape))


def _unexplained(dataset: Dataset, shown: Shown, verdict: Verdict) -> Iterator[Unexplained]:
    rest, torque = np.nan_to_num(shown.learned.rest), np.nan_to_num(shown.learned.torque)
    excess = np.sum((rest / shown.learned.irreducible_std(dataset.noise, 1)) ** 2 - 1, axis=0)
    for joint in np.flatnonzero(excess > verdict.threshold).tolist():
        share = float(np.sqrt(np.mean(rest[:, joint] ** 2) / max(float(np.mean(torque[:, joint] ** 2)), 1e-300)))
        yield Unexplained(joint, _place(dataset, joint, rest[:, joint]), share)


def _flags(dataset: Dataset, findings: Sequence[Finding], verdict: Verdict, itself: bool) -> Iterator[str]:
    robot = dataset.model.robot
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
