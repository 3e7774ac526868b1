"""Searches of all groups -> findings, unexplained mismatch, verdict and flags."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...model import Model
from ...types import Array
from ..search.data import ServoData
from .closed_loop import ClosedLoop, Point
from .coordinates import LOGARITHMIC, Free, value
from .refine import Attempt, Setting
from .result import FoundNumber, PositionFit, ServoAlternative, ServoFinding, ServoUnexplained
from .search import PAYLOAD, THRESHOLD, GroupSearch, Step
from .unexplained import depends_on, worst_region

Found = Sequence[tuple[tuple[int, ...], GroupSearch, ClosedLoop]]
MAIN = 0.1  # [1] of the explained sum of squares, from which a law is a cause
LEFT = 2.0  # [1] rms over noise, from which a mismatch is unexplained
VISIBLE = 0.02  # [1] rms over that of the tracking error, below which a mismatch does not matter
WORSE = 0.5  # [1] factor on the probability of a law that leaves most, or predicts held-out windows worse
LOST = 0.02  # [1] growth of the held-out sum of squares by a law that is flagged
MOST_LEFT = 0.5  # [1] rms after over rms before, above which what was found cannot be sure
SHOWN = 1e-3  # probability below which an alternative is not listed
CLOSE = 0.25  # probability of an alternative from which the result is flagged
LIKELY = "commands near the natural frequency of the loop, and steps that saturate the drive"
BODY_UNITS = {"mass": "kg"}


def conclude(
    data: ServoData, found: Found, noise: Array
) -> tuple[tuple[ServoFinding, ...], tuple[ServoUnexplained, ...], str, list[str]]:
    """Findings, unexplained mismatch, verdict and flags. noise: (n,) [rad or m]."""
    findings = [finding for joints, one, unseen in found for finding in _findings(data, joints, one, unseen, noise)]
    findings.sort(key=lambda f: (f.role != "cause", -f.statistic))
    left = [x for joints, one, unseen in found for x in _unexplained(data, joints, one, unseen, noise)]
    causes = any(finding.role == "cause" for finding in findings)
    verdict = "named" if causes else "unknown" if left else "nothing_missing"
    return tuple(findings), tuple(left), verdict, [*_flags(findings), *_poorly(data, found, noise)]


def fits(model: Model, data: ServoData, found: Found, noise: Array, last: bool) -> PositionFit:
    """Mismatch of closed loops over short windows, with the given numbers or the last ones. noise: (n,) [rad or m]."""
    n = len(data.joints)
    train, unseen, r2 = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    for joints, one, loop in found:
        j, trial = list(joints), one.last if last else one.base
        train[j] = _rms(trial.squares, one.setting.loop)
        squares = _setting(one, loop).evaluate([trial.point])[0]
        unseen[j] = _rms(squares, loop)
        r2[j] = 1 - unseen[j] ** 2 / _tracking(loop) ** 2
    driven = list(data.joints)
    units = tuple("m" if model.robot.prismatic[model.robot.index(joint)] else "rad" for joint in driven)
    return PositionFit(data.joints, units, train, unseen, np.where(np.isnan(train), np.nan, noise), r2)


def _findings(
    data: ServoData, joints: Sequence[int], one: GroupSearch, unseen: ClosedLoop, noise: Array
) -> Iterator[ServoFinding]:
    setting = _setting(one, unseen)
    whole = float(np.sum((one.base.squares - one.last.squares) / one.setting.sigma**2))
    given = one.base.point
    poor = _poor(one, noise[list(joints)]) is not None
    for k, step in enumerate(one.steps):
        gained = np.sum(step.before.squares - step.after.squares, axis=0)
        before = np.sum(step.before.squares, axis=0)
        shares = np.sqrt(np.clip(gained / np.maximum(before, 1e-300), 0, 1))
        weight = float(np.sum(gained / one.setting.sigma**2)) / max(whole, 1e-300)
        old, new = setting.evaluate([step.before.point, step.after.point]).sum(axis=1)[:, step.joint]
        joint = data.joints[joints[step.joint]]
        yield ServoFinding(
            effect=step.law.effect,
            joint=joint,
            role="cause" if k == 0 or weight > MAIN else "secondary",
            probability=step.probability * (1.0 if new < old and not poor else WORSE),
            parameters=_numbers(one.last, given, step),
            meaning=step.law.meaning,
            share={data.joints[j]: float(x) for j, x in zip(joints, shares, strict=True) if x > 0.01},
            variable=step.law.variable,
            region=step.law.region,
            statistic=step.log_odds,
            threshold=THRESHOLD,
            held_out_gain=float(1 - new / old) if old > 0 else 0.0,
            alternatives=tuple(_alternatives(data, joints, step)),
        )


def _poor(one: GroupSearch, noise: Array) -> tuple[int, float] | None:
    """Worst joint of the group if most of its mismatch remains after laws were added, and the share of its rms [1]."""
    before, after = (_rms(x.squares, one.setting.loop) for x in (one.base, one.last))
    j = int(np.argmax(before / noise))
    poor = one.steps and after[j] > LEFT * noise[j] and after[j] > MOST_LEFT * before[j]
    return (j, float(after[j] / before[j])) if poor else None


def _poorly(data: ServoData, found: Found, noise: Array) -> Iterator[str]:
    """A sentence on each group whose laws leave most of the mismatch."""
    for joints, one, _ in found:
        if left := _poor(one, noise[list(joints)]):
            yield (
                f"{', '.join(step.law.effect for step in one.steps)}: {100 * left[1]:.0f} % of the mismatch of "
                f"{data.joints[joints[left[0]]]} remains, so another law is missing, too or instead"
            )


def _numbers(last: Attempt, given: Point, step: Step) -> dict[str, FoundNumber]:
    joint = -1 if step.law is PAYLOAD else step.joint
    out = {}
    for number in (*step.law.numbers, *step.law.shape):
        free = Free(joint, number)
        at, std = value(last.point, free), None
        if free in last.frees and last.covariance is not None:
            k = last.frees.index(free)
            std = float(np.sqrt(max(last.covariance[k, k], 0.0))) * (at if number in LOGARITHMIC else 1.0)
        unit = BODY_UNITS.get(number, "kg.m") if step.law is PAYLOAD else step.law.unit(number)
        old = None if step.law is PAYLOAD else float(getattr(given.servos[step.joint], number))
        out[step.law.parameter(number)] = FoundNumber(
            at, std, unit, old if old is not None and np.isfinite(old) else None
        )
    return out


def _alternatives(data: ServoData, joints: Sequence[int], step: Step) -> Iterator[ServoAlternative]:
    listed = set()
    twins = {twin.effect: twin for twin in step.law.twins}
    here = data.joints[joints[step.joint]]
    for law, j, probability in step.rivals:
        joint = data.joints[joints[j]]
        twin = twins.get(law.effect) if joint == here else None
        if probability >= SHOWN or twin:
            listed.add((law.effect, joint))
            motion = twin.separating_motion if twin else LIKELY
            yield ServoAlternative(law.effect, joint, max(probability, SHOWN), motion)
    for twin in step.law.twins:
        if (twin.effect, here) not in listed:
            share = step.probability * twin.ratio / (1 + twin.ratio)
            yield ServoAlternative(twin.effect, here, share, twin.separating_motion)


def _unexplained(
    data: ServoData, joints: Sequence[int], one: GroupSearch, unseen: ClosedLoop, noise: Array
) -> Iterator[ServoUnexplained]:
    """Joints whose mismatch stays above noise, in what was searched or in what was held out."""
    listed: set[int] = set()
    for loop, setting in ((one.setting.loop, one.setting), (unseen, _setting(one, unseen))):
        before = _rms(setting.evaluate([one.base.point])[0], loop)
        residual = setting.remaining([one.last.point])[0]
        after, tracking = np.sqrt(np.mean(residual**2, axis=(0, 1))), _tracking(loop)
        for k, j in enumerate(joints):
            if k not in listed and after[k] > LEFT * noise[j] and after[k] > VISIBLE * tracking[k]:
                listed.add(k)
                share = float(after[k] / max(before[k], 1e-12))
                variable = depends_on(loop, residual, k)
                place = worst_region(loop, residual, k, variable)
                yield ServoUnexplained(data.joints[j], variable, share, float(after[k]), *place, _tried(one, k))


def _tried(one: GroupSearch, joint: int) -> dict[str, float]:
    """Laws that were fitted at a joint of the group and not added, with the share that they explain [1]."""
    best: dict[str, float] = {}
    for effect, j, part in one.tried:
        if j == joint:
            best[effect] = max(best.get(effect, 0.0), part)
    return dict(sorted(best.items(), key=lambda item: -item[1]))


def _flags(findings: Sequence[ServoFinding]) -> Iterator[str]:
    for finding in findings:
        if finding.held_out_gain < -LOST:
            yield (
                f"{finding.effect} at {finding.joint} predicts held-out motion worse than the simulation without it; "
                f"do not rely on it"
            )
        if finding.role == "cause":
            for rival in finding.alternatives:
                if rival.probability >= CLOSE:
                    yield (
                        f"{finding.effect} and {rival.effect} of {rival.joint} fit these recordings equally well, or "
                        f"nearly; {rival.separating_motion}"
                    )


def _setting(one: GroupSearch, loop: ClosedLoop) -> Setting:
    return Setting(loop, loop.state_columns(one.last.point), one.setting.sigma, one.setting.scales)


def _rms(squares: Array, loop: ClosedLoop) -> Array:
    return np.asarray(np.sqrt(np.sum(squares, axis=0) / (loop.windows * (loop.rows + 1))))


def _tracking(loop: ClosedLoop) -> Array:
    """Rms of q_des - q, (n,) [rad or m]."""
    errors = np.vstack([grid.command[:, loop.joints] - grid.q[:, loop.joints] for grid in loop.grids])
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)) + 1e-12)
