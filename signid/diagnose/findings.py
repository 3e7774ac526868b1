"""What is taken for true -> findings with numbers, places and rivals, and the extended simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..filters import Decimator
from ..model import Model
from ..session import Session
from ..types import Array, Law, Shape
from .extend import extend
from .found import Found
from .hypothesis import VARIABLES
from .locate import Place, locate
from .numbers import deviations, read_laws, torque_of
from .odds import Judge
from .prove import residuals
from .result import Alternative, Finding, Unexplained
from .sample import pieces
from .search import FIRST, NEXT, needed
from .separate import tell_apart
from .setting import Setting
from .slots import Slot
from .verdict import Verdict

UNSURE = 0.95  # probability below which a cause is flagged
LISTED = 4  # rivals whose separating motion is sought


class Result(NamedTuple):
    """What there is to be told."""

    model: Model
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    located: tuple[Place, ...]
    tolerance: float
    flags: tuple[str, ...]

    def parts(self) -> dict[str, Any]:
        """What a diagnosis takes over as it is."""
        return {key: getattr(self, key) for key in ("findings", "located", "tolerance")}


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
    laws = {group: read_laws(group, verdict.sizes.value[group]) for group in order}
    fit = judge.evidence.fit(found.true, found.base, found.trust)
    model = extend(
        setting.model,
        judge.evidence.data.refitted,
        fit,
        [law for group in order for law in laws[group]],
        session.task.base,
    )
    gains = _held_out_gains(session, model, [law for group in order for law in laws[group]])
    findings = list[Finding]()
    for group in order:
        slot = next(s for s in slots if s.group is group)
        stds = deviations(setting, judge, found, group, laws[group])
        for law, std in zip(laws[group], stds, strict=True):
            gain = gains[len(findings)]
            findings.append(_finding(setting, judge, found, slot, law, std, verdict, gain, model, seed))
    floor, scale = judge.evidence.data.floor, judge.evidence.data.scale
    return Result(
        model=model,
        findings=tuple(findings),
        unexplained=tuple(_unexplained(setting, session, model, verdict)),
        located=tuple(_place(setting, j, setting.table.residual[:, j]) for j in range(setting.table.joints)),
        tolerance=float(np.max(np.sqrt(verdict.threshold / judge.evidence.data.counts) * floor / scale)),
        flags=tuple(_flags(setting, findings, verdict)),
    )


def _finding(
    setting: Setting,
    judge: Judge,
    found: Found,
    slot: Slot,
    law: Law,
    std: dict[str, float],
    verdict: Verdict,
    gain: float,
    model: Model,
    seed: int,
) -> Finding:
    torque = setting.thinned([
        {j: x[:, None] for j, x in torque_of(law, piece.motion).items()} for piece in setting.pieces
    ])  # fmt: skip
    share = np.zeros(setting.table.joints)
    for j, x in torque.items():
        share[j] = np.sqrt(np.mean(x**2)) / judge.evidence.data.scale[j]
    loudest = max(torque, key=lambda j: share[j])
    joint = law.joints[0] if len(law.joints) <= 2 and law.joints[0] in torque else loudest
    return Finding(
        law=_whole(law, model),
        std=std,
        role="cause" if slot.group in verdict.causes else "secondary",
        probability=slot.probability,
        torque_share=share,
        where=_place(setting, joint, torque[joint][:, 0], VARIABLES if _passes(law) else VARIABLES[:-1]),
        statistic=float(found.log_odds[slot.group]),
        threshold=needed(judge, slot.group, float(found.trust == 0), 0, FIRST if len(found.true) == 1 else NEXT),
        held_out_gain=gain,
        alternatives=tuple(_alternatives(setting, judge, slot, law, seed)),
    )


def _whole(law: Law, model: Model) -> Law:
    """The law with all that the simulation had of plainer ones that it contains."""
    same = [other for other in model.laws if (other.effect.name, other.joints) == (law.effect.name, law.joints)]
    return same[0] if same and law.effect.contains else law


def _alternatives(setting: Setting, judge: Judge, slot: Slot, law: Law, seed: int) -> Iterator[Alternative]:
    floor = judge.evidence.data.floor
    for k, (probability, group) in enumerate(slot.rivals.values()):
        for rival in group.claim.laws[:1]:
            motion = "" if k >= LISTED else tell_apart(setting.model, law, rival, floor, seed)
            yield Alternative(rival, probability, motion)


def _place(setting: Setting, joint: int, torque: Array, variables: Sequence[str] = VARIABLES) -> Place:
    return locate(setting.table, joint, torque, bool(setting.model.robot.prismatic[joint]), variables)


def _passes(law: Law) -> bool:
    """Whether a law changes with time by itself."""
    return any(kind.unit == "s" for kind in law.effect.parameters.values() if isinstance(kind, Shape))


def _held_out_gains(session: Session, model: Model, laws: Sequence[Law]) -> list[float]:
    """Share of the held-out sum of squares, on its joints, that each law takes away."""
    if not laws:
        return []
    task, out = session.task, list[float]()
    made = [p for p in pieces(task, model, session.held_out) if len(p.motion) > len(task.band.taps)]
    rest, _ = residuals(task, model, session.held_out)
    thin = Decimator(task.band.taps, task.band.factor)
    for law in laws:
        torque = [torque_of(law, piece.motion) for piece in made]
        joints = list(torque[0])
        own = np.concatenate([thin(np.column_stack([t[j] for j in joints])) for t in torque])
        after, before = float(np.nansum(rest[:, joints] ** 2)), float(np.nansum((rest[:, joints] + own) ** 2))
        out.append(1 - after / before if before > 0 else 0.0)
    return out


def _unexplained(setting: Setting, session: Session, model: Model, verdict: Verdict) -> Iterator[Unexplained]:
    rest, torque = (np.nan_to_num(x) for x in residuals(session.task, model, session.train))
    floor, count = setting.noise.floor, len(rest)
    excess = count * (np.mean(rest**2, axis=0) / floor**2 - 1)
    for joint in np.flatnonzero(excess > verdict.threshold).tolist():
        share = float(np.sqrt(np.mean(rest[:, joint] ** 2) / max(float(np.mean(torque[:, joint] ** 2)), 1e-300)))
        yield Unexplained(joint, _place(setting, joint, rest[:, joint]), share)


def _flags(setting: Setting, findings: Sequence[Finding], verdict: Verdict) -> Iterator[str]:
    names = setting.model.robot.joints
    if verdict.name == "unknown":
        yield "something is missing that no effect of the library explains; what it depends on is said, not what it is"
    for finding in findings:
        if finding.role == "cause" and finding.probability < UNSURE and verdict.name == "named":
            rivals = ", ".join(
                f"{a.law.effect.name} of {names[a.law.joints[0]]} ({a.probability:.0%})"
                for a in finding.alternatives[:3]
            )
            yield (
                f"{finding.law.effect.name} of {names[finding.law.joints[0]]} is one of several that explain the "
                f"recordings ({finding.probability:.0%}); the others: {rivals or 'no effect of the library'}"
            )
