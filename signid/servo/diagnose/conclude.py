"""Searches of all groups -> findings, unexplained mismatch, verdict and flags.

A mismatch without a law is named by the variable whose bins explain most of it, and by its worst third.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...frozen import Frozen, Result
from ...model import Model
from ...servos import JOINT_LAWS, LOOP_UNITS
from ...types import Array, Input, Robot
from ..identify.result import ServoRollOut, ServoTrace
from ..search.data import ServoData
from .closed_loop import ClosedLoop
from .search import LEAST_GAIN, PAYLOAD, THRESHOLD, GroupSearch, Setting, Step

Found = Sequence[tuple[tuple[int, ...], GroupSearch, ClosedLoop]]
MAIN = 0.1  # [1] of the explained sum of squares, from which a law is a cause
UNEXPLAINED_RATIO = 2.0  # [1] rms over noise, from which a mismatch is unexplained
VISIBLE = 0.02  # [1] rms over that of the tracking error, below which a mismatch does not matter
POOR_LAW_FACTOR = 0.5  # [1] factor on the probability of a law that leaves most, or predicts held-out windows worse
MAX_HELD_OUT_GROWTH = 0.02  # [1] growth of the held-out sum of squares by a law that is flagged
MOST_LEFT = 0.5  # [1] rms after over rms before, above which what was found cannot be sure
MIN_LISTED_PROBABILITY = 1e-3  # probability below which an alternative is not listed
RIVAL_PROBABILITY = 0.25  # probability of an alternative from which the result is flagged
LIKELY = "commands near the natural frequency of the loop, and steps that saturate the drive"
BODY_UNITS = {"mass": "kg"}
BINS = 9
THIRDS = ("lowest", "middle", "highest")


def conclude(
    data: ServoData, found: Found, noise: Array
) -> tuple[tuple[ServoFinding, ...], tuple[ServoUnexplained, ...], str, list[str]]:
    """Findings, unexplained mismatch, verdict and flags. noise: (n,) [rad or m]."""
    findings = [finding for joints, one, unseen in found for finding in _findings(data, joints, one, unseen, noise)]
    findings.sort(key=lambda f: (f.role != "cause", -f.statistic))
    left = [x for joints, one, unseen in found for x in _unexplained(data, joints, one, unseen, noise)]
    causes = any(finding.role == "cause" for finding in findings)
    verdict = "named" if causes else "unknown" if left else "nothing_missing"
    poor = [
        f"{', '.join(step.law.effect for step in one.steps)}: {100 * rest[1]:.0f} % of the mismatch of "
        f"{data.joints[joints[rest[0]]]} remains, so another law is missing, too or instead"
        for joints, one, _ in found
        if (rest := _poor(one, noise[list(joints)]))
    ]
    return tuple(findings), tuple(left), verdict, [*_flags(findings), *poor]


def fits(model: Model, data: ServoData, found: Found, noise: Array, last: bool) -> PositionFit:
    """Mismatch of closed loops over short windows, with the given numbers or the last ones. noise: (n,) [rad or m]."""
    n = len(data.joints)
    train, unseen, r2 = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    for joints, one, loop in found:
        j, trial = list(joints), one.last if last else one.base
        train[j] = _rms(trial.squares, one.setting.loop)
        squares = _setting(one, loop).evaluate([trial.where])[0]
        unseen[j] = _rms(squares, loop)
        r2[j] = 1 - unseen[j] ** 2 / _tracking(loop) ** 2
    driven = list(data.joints)
    units = tuple("m" if model.robot.prismatic[model.robot.index(joint)] else "rad" for joint in driven)
    return PositionFit(data.joints, units, train, unseen, np.where(np.isnan(train), np.nan, noise), r2)


def unproven(one: GroupSearch, unseen: ClosedLoop) -> list[str]:
    """Laws of the joint that were added and hardly improve held-out windows: the next best would be a wrong cause."""
    setting = _setting(one, unseen)
    each = [setting.evaluate([step.before.where, step.after.where]).sum(axis=1)[:, step.joint] for step in one.steps]
    return [
        step.law.effect
        for step, (old, new) in zip(one.steps, each, strict=True)
        if step.law.effect in JOINT_LAWS and not new < (1 - LEAST_GAIN) * old
    ]


def _findings(
    data: ServoData, joints: Sequence[int], one: GroupSearch, unseen: ClosedLoop, noise: Array
) -> Iterator[ServoFinding]:
    setting = _setting(one, unseen)
    whole = float(np.sum((one.base.squares - one.last.squares) / one.setting.sigma**2))
    poor = _poor(one, noise[list(joints)]) is not None
    for k, step in enumerate(one.steps):
        gained = np.sum(step.before.squares - step.after.squares, axis=0)
        before = np.sum(step.before.squares, axis=0)
        shares = np.sqrt(np.clip(gained / np.maximum(before, 1e-300), 0, 1))
        weight = float(np.sum(gained / one.setting.sigma**2)) / max(whole, 1e-300)
        old, new = setting.evaluate([step.before.where, step.after.where]).sum(axis=1)[:, step.joint]
        joint = data.joints[joints[step.joint]]
        yield ServoFinding(
            effect=step.law.effect,
            joint=joint,
            role="cause" if k == 0 or weight > MAIN else "secondary",
            probability=step.probability * (1.0 if new < old and not poor else POOR_LAW_FACTOR),
            parameters=_numbers(one, step),
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
    poor = one.steps and after[j] > UNEXPLAINED_RATIO * noise[j] and after[j] > MOST_LEFT * before[j]
    return (j, float(after[j] / before[j])) if poor else None


def _numbers(one: GroupSearch, step: Step) -> dict[str, FoundNumber]:
    joint, out = -1 if step.law is PAYLOAD else step.joint, {}
    values, std = one.last.where.values, np.sqrt(np.diag(one.covariance))
    for number in step.law.numbers:
        k = one.last.where.slots.index(one.setting.slot(joint, number))
        unit = BODY_UNITS.get(number, "kg.m") if step.law is PAYLOAD else LOOP_UNITS[number]
        old = np.inf if step.law is PAYLOAD else float(getattr(one.base.where.servos[step.joint], number))
        out[step.law.parameter(number)] = FoundNumber(
            float(values[k]), float(std[k]) if np.isfinite(std[k]) else None, unit, old if np.isfinite(old) else None
        )
    for number in step.law.shape:
        value = float(getattr(one.last.where.servos[joint], number))
        out[step.law.parameter(number)] = FoundNumber(value, None, LOOP_UNITS[number], None)
    return out


def _alternatives(data: ServoData, joints: Sequence[int], step: Step) -> Iterator[ServoAlternative]:
    listed = set()
    twins = {twin.effect: twin for twin in step.law.twins}
    here = data.joints[joints[step.joint]]
    for law, j, probability in step.rivals:
        joint = data.joints[joints[j]]
        twin = twins.get(law.effect) if joint == here else None
        if probability >= MIN_LISTED_PROBABILITY or twin:
            listed.add((law.effect, joint))
            motion = twin.separating_motion if twin else LIKELY
            yield ServoAlternative(law.effect, joint, max(probability, MIN_LISTED_PROBABILITY), motion)
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
        before = _rms(setting.evaluate([one.base.where])[0], loop)
        residual = setting.remaining([one.last.where])[0]
        after, tracking = np.sqrt(np.mean(residual**2, axis=(0, 1))), _tracking(loop)
        for k, j in enumerate(joints):
            if k not in listed and after[k] > UNEXPLAINED_RATIO * noise[j] and after[k] > VISIBLE * tracking[k]:
                listed.add(k)
                share = float(after[k] / max(before[k], 1e-12))
                variable = depends_on(loop, residual, k)
                place = worst_region(loop, residual, k, variable)
                tried = [(effect, part) for effect, joint, part in one.tried if joint == k]
                best = {law: max(0.0, *(part for effect, part in tried if effect == law)) for law, _ in tried}
                best = dict(sorted(best.items(), key=lambda item: -item[1]))
                yield ServoUnexplained(data.joints[j], variable, share, float(after[k]), *place, best)


def _flags(findings: Sequence[ServoFinding]) -> Iterator[str]:
    for finding in findings:
        if finding.held_out_gain < -MAX_HELD_OUT_GROWTH:
            yield (
                f"{finding.effect} at {finding.joint} predicts held-out motion worse than the simulation without it; "
                f"do not rely on it"
            )
        if finding.role == "cause":
            for rival in finding.alternatives:
                if rival.probability >= RIVAL_PROBABILITY:
                    yield (
                        f"{finding.effect} and {rival.effect} of {rival.joint} fit these recordings equally well, or "
                        f"nearly; {rival.separating_motion}"
                    )


def _setting(one: GroupSearch, loop: ClosedLoop) -> Setting:
    return Setting(loop, loop.state_columns(one.last.where), one.setting.sigma)


def _rms(squares: Array, loop: ClosedLoop) -> Array:
    return np.asarray(np.sqrt(np.sum(squares, axis=0) / (loop.windows * (loop.rows + 1))))


def _tracking(loop: ClosedLoop) -> Array:
    """Rms of q_des - q, (n,) [rad or m]."""
    errors = np.vstack([grid.command[:, loop.joints] - grid.q[:, loop.joints] for grid in loop.grids])
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)) + 1e-12)


def depends_on(loop: ClosedLoop, residual: Array, joint: int) -> str:
    """Name of the variable; residual: (W, T, n) [rad or m]."""
    y = residual[:, :, joint].ravel()
    variables = _variables(loop, joint)
    return max(variables, key=lambda name: _explained(variables[name], y))


def worst_region(loop: ClosedLoop, residual: Array, joint: int, variable: str) -> tuple[str, float]:
    """Third of the values of a variable with the largest mismatch, and the rms there [rad or m].

    Sizes count, except of position and time; of several recordings, the worst one stands for time.
    residual: (W, T, n) [rad or m].
    """
    x = _variables(loop, joint)[variable]
    names = [f"{third} third of {variable}" for third in THIRDS]
    if variable not in ("position", "time"):
        x, names = np.abs(x), [f"{third} third of |{variable}|" for third in THIRDS]
    place = np.searchsorted(np.quantile(x, [1 / 3, 2 / 3]), x)
    paths = [loop.grids[g].path for g, _ in loop.places]
    if variable == "time" and len(set(paths)) > 1:
        files = list(dict.fromkeys(paths))
        place = np.repeat([files.index(path) for path in paths], residual.shape[1])
        names = [f"recording {path}" for path in files]
    square = residual[:, :, joint].ravel() ** 2
    rms = [float(np.sqrt(np.mean(square[place == k]))) if np.any(place == k) else 0.0 for k in range(len(names))]
    worst = int(np.argmax(rms))
    return names[worst], rms[worst]


def _variables(loop: ClosedLoop, joint: int) -> dict[str, Array]:
    """Values (W T,) of the variables at the rows of all windows."""
    span = loop.starts[:, None] + np.arange(loop.rows + 1)
    return {
        "position": loop.motion.q[span, joint].ravel(),
        "velocity": loop.motion.v[span, joint].ravel(),
        "acceleration": loop.motion.a[span, joint].ravel(),
        "torque": loop.torque[span, joint].ravel(),
        "time": np.linspace(0, 1, span.size),
    }


def _explained(x: Array, y: Array) -> float:
    edges = np.quantile(x, np.linspace(0, 1, BINS + 1)[1:-1])
    place = np.searchsorted(edges, x)
    total = np.bincount(place, minlength=BINS).astype(float)
    mean = np.bincount(place, weights=y, minlength=BINS) / np.maximum(total, 1)
    return float(np.sum(total * mean**2))


class FoundNumber(NamedTuple):
    """A number of a law; `stated` is the value in the given simulation, None where it had none."""

    value: float
    std: float | None
    unit: str
    stated: float | None = None


@dataclass(frozen=True)
class ServoAlternative:
    """Law that explains a finding as well, or nearly."""

    effect: str
    joint: str
    probability: float
    separating_motion: str


@dataclass(frozen=True)
class ServoFinding:
    """A law that the simulation of loop and robot lacks, or states wrongly."""

    effect: str
    joint: str
    role: str  # "cause" or "secondary"
    probability: float
    parameters: Mapping[str, FoundNumber]
    meaning: str
    share: Mapping[str, float]  # by joint: rms of the mismatch that it explains over rms of the mismatch [1]
    variable: str  # velocity, position, acceleration, torque or time
    region: str
    statistic: float  # log posterior odds against its absence
    threshold: float  # log odds that a law needs
    held_out_gain: float  # reduction of the held-out sum of squares of its joint [1]
    alternatives: tuple[ServoAlternative, ...]


@dataclass(frozen=True)
class ServoUnexplained:
    """Mismatch of a joint that exceeds noise and that no law explains."""

    joint: str
    variable: str  # what it depends on most
    share: float  # its rms over the rms of the mismatch of the given simulation [1]
    rms: float  # [rad or m]
    region: str  # third of the variable, or recording, with the largest mismatch
    region_rms: float  # [rad or m] rms of the mismatch there
    tried: Mapping[str, float]  # laws that were fitted and not added: share of the mean square that each explains [1]


@dataclass(frozen=True, eq=False)
class ServoRepeats(Frozen):
    """Differences of measured positions between repeats of one command, n joints with drives."""

    joints: tuple[str, ...]
    pairs: int  # pairs of stretches with equal commands that were compared
    seconds: float  # of all comparisons together [s]
    rms: Array  # (n,) [rad or m] rms difference of two repeats over sqrt(2): no model of the commands is better
    mismatch_rms: Array  # (n,) [rad or m] of the extended simulation on the same rows, from the commands alone
    share: Array  # (n,) of the mean square mismatch that no model explains [1]


@dataclass(frozen=True, eq=False)
class PositionFit(Frozen):
    """Mismatch of short closed loops from measured states, n joints."""

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # "rad" or "m"
    train_rms: Array  # (n,) [rad or m]
    held_out_rms: Array  # (n,) [rad or m]
    noise_floor: Array  # (n,) [rad or m] of the measured positions
    held_out_r2: Array  # (n,) share of the variance of q_des - q that the simulation explains [1]


@dataclass(frozen=True, eq=False)
class ServoDiagnosis(Result):
    """Differences between a simulation of drives and recordings, in rad, and the laws that explain them."""

    robot: Robot
    verdict: str  # "nothing_missing", "named" or "unknown"
    findings: tuple[ServoFinding, ...]
    unexplained: tuple[ServoUnexplained, ...]
    before: PositionFit
    after: PositionFit
    rollout_before: ServoRollOut
    rollout_after: ServoRollOut
    repeats: ServoRepeats | None  # None if no command is repeated
    traces: tuple[ServoTrace, ...]  # of held-out recordings; `nominal` is the given simulation
    model: Model  # the extended simulation
    inputs: tuple[Input, ...]
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    seed: int

    @property
    def causes(self) -> tuple[ServoFinding, ...]:
        """Findings that are causes."""
        return tuple(finding for finding in self.findings if finding.role == "cause")
