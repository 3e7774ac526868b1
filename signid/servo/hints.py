"""Hints after an identification: joints of several legs or arms whose numbers are equal, or differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.stats import chi2

from ..errors import shorten
from ..robot.alike import alike, name_pattern

EQUAL = 0.05  # probability of such differences among equal joints, over all numbers, from which --equal is proposed
DIFFERENT = 0.01  # the same, below which the number that differs is named
LEAST = "kp"  # number that at least two joints must have

Estimates = Mapping[str, tuple[float, float]]  # value and standard deviation by number [SERVO_UNITS]


def equal_hints(found: Mapping[str, Estimates], equal: Sequence[Sequence[str]] = ()) -> Iterator[str]:
    """Sentences on joints whose names differ in a side, finger or limb only.

    found: estimates by servo joint, of those numbers that recordings identify; equal: joints fitted as equal already.
    """
    for members in alike(tuple(found)):
        if any(set(members) <= set(group) for group in equal):
            continue
        name, p = _likeliest(members, found)
        if p > EQUAL and sum(LEAST in found[joint] for joint in members) > 1:
            yield (
                f"{shorten(members)}: no number differs beyond its interval; --equal "
                f"'{name_pattern(members, tuple(found))}' fits them as equal drives, with narrower intervals"
            )
        elif p < DIFFERENT:
            yield f"{shorten(members)} are alike by name and differ: {_difference(name, members, found)}"


def unequal_flags(found: Mapping[str, Estimates], equal: Sequence[Sequence[str]]) -> Iterator[str]:
    """Sentences on joints that were fitted as equal, and differ if they are not. Arguments as `equal_hints`."""
    for members in equal:
        name, p = _likeliest(members, found)
        if p < DIFFERENT:
            yield (
                f"{shorten(members)}: the recordings contradict equal drives: {_difference(name, members, found)}; "
                f"leave joints that differ out of --equal"
            )


def _likeliest(members: Sequence[str], found: Mapping[str, Estimates]) -> tuple[str, float]:
    """Number that differs most surely, and the probability of that among all numbers of equal joints; "", 1: none."""
    tests = {name: _test(name, members, found) for name in dict.fromkeys(n for j in members for n in found[j])}
    likely = {name: p for name, p in tests.items() if p is not None}
    name = min(likely, key=lambda name: likely[name], default="")
    return name, min(1.0, len(likely) * likely[name]) if name else 1.0


def _test(name: str, members: Sequence[str], found: Mapping[str, Estimates]) -> float | None:
    """Probability of such differences of a number if the joints are equal (Cochran's Q); None with fewer than two."""
    each = np.array([found[joint][name] for joint in members if name in found[joint]]).reshape(-1, 2)
    if len(each) < 2:
        return None
    value, weight = each[:, 0], each[:, 1] ** -2.0
    mean = np.average(value, weights=weight)
    return float(chi2.sf(np.sum(weight * (value - mean) ** 2), len(each) - 1))


def _difference(name: str, members: Sequence[str], found: Mapping[str, Estimates]) -> str:
    """Part of a sentence on the two joints whose values of a number are farthest apart."""
    have = [joint for joint in members if name in found[joint]]
    pairs = [(a, b) for k, a in enumerate(have) for b in have[k + 1 :]]

    def apart(pair: tuple[str, str]) -> float:
        (x, s), (y, t) = (found[joint][name] for joint in pair)
        return abs(x - y) / float(np.hypot(s, t))

    pair = max(pairs, key=apart)
    values = " and ".join(f"{x:.3g} +- {1.96 * s:.2g}" for x, s in (found[joint][name] for joint in pair))
    return f"{name.replace('_', ' ')} of {pair[0]} and {pair[1]} is {values} ({apart(pair):.1f} standard deviations)"
