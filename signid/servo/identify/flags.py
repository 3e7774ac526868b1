"""Sentences on what not to rely on in a servo identification."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...errors import decimals, shorten
from ..given import Assumptions, Name
from ..search.data import ServoData
from .fits import STATED
from .identifiable import ONE_NUMBER, RATIOS_KNOWN, UNREACHED, VAGUELY, shortest_period
from .result import ServoJoint, ServoNumber, ServoRollOut

NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]*\w)")  # that stands alone in a sentence
UNSURE = 0.95  # probability of a law below which it is said
DISAGREES = 3.0  # standard deviations between recordings and prior from which it is said
INFORMS = 0.98  # standard deviation over that of the prior below which recordings say something of a number
MAX_LAG_SHARE = 0.25  # lag over the shortest period of the commands from which it is said


def joint_flags(joints: Sequence[ServoJoint]) -> Iterator[str]:
    """Numbers that are not identifiable, each sentence once with the joints that it is about."""
    return (line for line in by_sentence(joints) if ONE_NUMBER not in line)


def joint_notes(joints: Sequence[ServoJoint]) -> Iterator[str]:
    """Numbers that position drives never give apart."""
    return (line for line in by_sentence(joints) if ONE_NUMBER in line)


def by_sentence(joints: Sequence[ServoJoint]) -> Iterator[str]:
    """Sentences on numbers that are not identifiable, one for each reason, with their joints and ranges of figures."""
    every = [one.joint for one in joints]
    if vague := _lost_numbers(joints, VAGUELY):
        listed = [f"{key.replace('_', ' ')} of {_named(list(of), every)}{_bounds(of)}" for key, of in vague.items()]
        yield f"{VAGUELY}: {'; '.join(listed)}"
    if limits := _lost_numbers(joints, UNREACHED).get("effort_limit", {}):
        known = [number for number in limits.values() if number.above is not None]
        size = _range([decimals(number.above or 0.0, 2) for number in known]) + f" {known[0].unit}" if known else ""
        where = " where their scale is known" if len(known) < len(limits) else ""
        above = f"{size}{where}" if size else "all torques of the recordings"
        yield f"{_named(list(limits), every)}: {UNREACHED} {above}"
    shared: dict[tuple[str, ...], list[tuple[str, str]]] = {}
    for joint in joints:
        for sentence in joint.not_identifiable:
            plain = sentence.removeprefix(f"{joint.joint}: ").partition(RATIOS_KNOWN)[0]  # a table has them
            if VAGUELY not in plain and UNREACHED not in plain:
                shared.setdefault(tuple(NUMBER.split(plain)), []).append((joint.joint, plain))
    for words, said in shared.items():
        numbers = zip(*(NUMBER.findall(plain) for _, plain in said), strict=True)
        ranges = [*map(_range, numbers), ""]
        text = "".join(word + number for word, number in zip(words, ranges, strict=True))
        yield f"{_named(list(dict.fromkeys(name for name, _ in said)), every)}: {text}"


def _lost_numbers(joints: Sequence[ServoJoint], why: str) -> dict[str, dict[str, ServoNumber]]:
    """Numbers that are not identifiable for a reason, by their name and joint."""
    found: dict[str, dict[str, ServoNumber]] = {}
    for joint in joints:
        for name, number in joint.numbers.items():
            if number.value is None and why in number.sentence:
                found.setdefault(name, {})[joint.joint] = number
    return found


def _bounds(numbers: Mapping[str, ServoNumber]) -> str:
    """Upper bounds in brackets, if there are any."""
    known = [number for number in numbers.values() if number.below is not None]
    if not known:
        return ""
    sizes = _range([decimals(number.below or 0.0, 2) for number in known])
    return f" (below {f'{sizes} {known[0].unit}'.removesuffix(' 1')})"


def _named(names: Sequence[str], every: Sequence[str]) -> str:
    """Some of all joints, by exception if there are few others."""
    others = [name for name in every if name not in names]
    if len(names) <= max(2, 2 * len(others)):
        return shorten(names)
    return f"all joints but {shorten(others)}" if others else "all joints"


def _range(numbers: Sequence[str]) -> str:
    """One number, or the least and the largest of several."""
    least, most = (f(numbers, key=float) for f in (min, max))
    return least if float(least) == float(most) else f"{least} to {most}"


def law_flags(joints: Sequence[ServoJoint], limited: Sequence[str]) -> Iterator[str]:
    """Joints that saturate, whose law is not sure."""
    for joint in joints:
        if joint.joint in limited and joint.law_probability is not None and joint.law_probability < UNSURE:
            listed = ", ".join(f"{law} {p:.2f}" for law, p in sorted(joint.laws.items(), key=lambda x: -x[1]))
            yield (
                f"{joint.joint}: the law of the drive is not sure (probability: {listed}); record motion that "
                f"saturates the drive more often, or state the law"
            )


def lag_flags(joints: Sequence[ServoJoint], data: ServoData) -> Iterator[str]:
    """Joints whose lag is a large part of the shortest period of their commands."""
    for joint in joints:
        lag = joint.numbers["lag"].value if "lag" in joint.numbers else None
        period = shortest_period(data.train, joint.joint)
        if lag is not None and lag > MAX_LAG_SHARE * period:
            yield (
                f"{joint.joint}: the lag of {decimals(1e3 * lag)} ms is more than a quarter of the shortest period of "
                f"the commands ({decimals(period, 2)} s); the joint does not follow such motion"
            )


def rollout_flags(rolled: ServoRollOut) -> Iterator[str]:
    """Roll-outs that are worse than the nominal ones, diverge, or are not of held-out data."""
    if not rolled.held_out:
        yield "nothing is held out: the errors of the roll-outs are those of the data that were learned from"
    diverged = [joint for joint, rms in zip(rolled.joints, rolled.whole_rms, strict=True) if np.isinf(rms)]
    if diverged:
        yield f"the simulation of {shorten(diverged)} diverges over whole recordings; give more or faster motion"
    if rolled.nominal != STATED:
        worse = np.flatnonzero(rolled.whole_rms > rolled.nominal_whole_rms)
        if len(worse):
            listed = shorten([rolled.joints[j] for j in worse])
            yield f"{listed}: the model predicts held-out recordings no better than q = q_des; do not use it there"


def worse_than_stated(rolled: ServoRollOut) -> bool:
    """Whether the stated numbers predict held-out whole recordings better."""
    if rolled.nominal != STATED:
        return False
    driven = np.isfinite(rolled.nominal_whole_rms)
    own, usual = rolled.whole_rms[driven], rolled.nominal_whole_rms[driven]
    return bool(len(own) and np.mean(own**2) > np.mean(usual**2))


def worse_flag(rolled: ServoRollOut) -> str:
    """Sentence where the stated numbers are handed out."""
    own, usual = (np.sqrt(np.nanmean(x**2)) for x in (rolled.whole_rms, rolled.nominal_whole_rms))
    return (
        f"the numbers found predict held-out recordings worse than the stated ones (rms {decimals(own)} against "
        f"{decimals(usual)}), so the model has the stated ones; give more recordings"
    )


def duty_notes(errors: Mapping[str, float]) -> Iterator[str]:
    """Joints whose recorded PWM shows the law and the error of full duty [rad or m]."""
    for joint, error in errors.items():
        yield f"{joint}: the recorded PWM is proportional to the error, full at {decimals(error)}: the law is duty"


def law_notes(joints: Sequence[ServoJoint], given: Mapping[str, str], limited: Sequence[str]) -> Iterator[str]:
    """Joints where the law does not matter."""
    same = [joint.joint for joint in joints if joint.joint not in given and joint.joint not in limited]
    if same:
        listed = _named(same, [joint.joint for joint in joints])
        yield f"{listed}: nothing saturates, so the laws effort and duty are the same here; effort is written"


def prior_notes(joints: Sequence[ServoJoint]) -> Iterator[str]:
    """Numbers of which the recordings alone say otherwise than their priors, and numbers at their bounds."""
    said: dict[str, list[str]] = {}
    for joint in joints:
        for name, number in joint.numbers.items():
            sentence = _against_prior(number) or _at_bound(number)
            if sentence:
                said.setdefault(f"{name.replace('_', ' ')} {sentence}", []).append(joint.joint)
    return (f"{shorten(names)}: {sentence}" for sentence, names in said.items())


def _against_prior(number: ServoNumber) -> str:
    """Sentence on a prior that is far from what the recordings alone give; "" if it is not."""
    if number.prior is None or number.value is None or number.std is None:
        return ""
    (mean, wide), value, std = number.prior, number.value, number.std
    if not std < INFORMS * wide:
        return ""
    own = 1 / std**2 - 1 / wide**2
    alone, error = (value / std**2 - mean / wide**2) / own, own**-0.5
    z = abs(alone - mean) / np.hypot(error, wide)
    if z <= DISAGREES:
        return ""
    unit = number.unit
    return (
        f"is {alone:.3g} +- {1.96 * error:.2g} {unit} by the recordings alone, and {mean:.3g} +- {1.96 * wide:.2g} "
        f"{unit} by its prior ({z:.1f} standard deviations apart); check the prior, the masses and the law"
    )


def _at_bound(number: ServoNumber) -> str:
    if not number.at_bound or number.bounds is None or number.value is None:
        return ""
    side = "upper" if number.value > (number.bounds.low + min(number.bounds.high, 1e300)) / 2 else "lower"
    return (
        f"is at its {side} bound of {number.value:.4g} {number.unit}, so it has no interval, and those of the other "
        f"numbers hold only for that value"
    )


def assumption_notes(assumptions: Assumptions, free: Sequence[Name]) -> Iterator[str]:
    """Joints that were fitted as equal, and priors and bounds of numbers that the fitted drives do not have free."""
    for members in assumptions.equal:
        yield f"{shorten(members)}: fitted as equal drives, each number but the torque offset to all of them"
    for what, given in (("prior", assumptions.priors), ("bounds", assumptions.bounds)):
        unused: dict[str, list[str]] = {}
        for joint, number in given:
            if (joint, number) not in free:
                unused.setdefault(number, []).append(joint)
        for number, names in unused.items():
            yield f"{shorten(names)}: {what} of {number} not used: the law that was chosen has no such free number"
