"""What was concealed from one diagnosis, what it said, and whether that meets the targets."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signid.diagnose import Diagnosis, Finding
from signid.errors import SignidError

Array = NDArray[np.float64]
Judge = Callable[[Diagnosis], Sequence["Target"]]


@dataclass(frozen=True)
class Target:
    """One number that is asked for, or one that is told only."""

    what: str
    value: str
    asked: str = ""
    met: bool | None = None  # None: nothing is asked


@dataclass(frozen=True)
class Said:
    """One finding."""

    effect: str
    joints: tuple[str, ...]
    role: str
    probability: float
    log_odds: float
    held_out_gain: float
    parameters: Mapping[str, tuple[float, float]]  # value and standard deviation
    alternatives: Mapping[str, float]

    @property
    def place(self) -> str:
        """Effect and joints in short."""
        return f"{self.effect} {', '.join(self.joints) if len(self.joints) <= 2 else 'all joints'}"

    @property
    def numbers(self) -> str:
        """Parameters in short."""
        return ", ".join(f"{key} {x:.4g} ± {s:.2g}" for key, (x, s) in self.parameters.items())


@dataclass(frozen=True)
class Row:
    """One diagnosis of one robot's recordings."""

    robot: str
    concealed: str
    verdict: str  # as the diagnosis gives it, or "refused"
    findings: tuple[Said, ...]
    targets: tuple[Target, ...]
    unexplained: Mapping[str, tuple[float, str]]  # per joint: share of its torque, what it depends on
    left: Mapping[str, float]  # per joint: held-out residual over the noise floor
    flags: tuple[str, ...]
    cutoff: float  # [Hz]
    seconds: float  # of CPU

    @property
    def holds(self) -> bool:
        """Whether something is asked and no target is missed."""
        return bool(self.targets) and all(target.met is not False for target in self.targets)


def attempt(robot: str, concealed: str, run: Callable[[], Diagnosis], judge: Judge) -> tuple[Row, Diagnosis | None]:
    """A diagnosis, timed and judged; what it refuses is a row without targets.

    Args:
        robot: name.
        concealed: what was left out of the simulation, in words.
        run: makes the diagnosis.
        judge: targets.
    """
    start = time.process_time()
    try:
        told = run()
    except SignidError as error:
        spent = time.process_time() - start
        return Row(robot, concealed, "refused", (), (), {}, {}, (str(error),), 0.0, spent), None
    row = _row(robot, concealed, told, time.process_time() - start)
    return replace(row, targets=tuple(judge(told))), told


def within(what: str, value: float, wanted: float, share: float, unit: str = "") -> Target:
    """A number that has to be near another."""
    told = f"{value:.4g}{unit and ' ' + unit} ({100 * (value / wanted - 1):+.1f} %)"
    return Target(what, told, f"{wanted:g} ± {100 * share:g} %", abs(value / wanted - 1) <= share)


def first_is(told: Diagnosis, effect: str, joints: Sequence[int] | None = None) -> Target:
    """The first finding has to be an effect, and at some joints where they matter."""
    first = told.findings[0] if told.findings else None
    right = first is not None and first.law.effect.name == effect
    right = right and first is not None and (joints is None or set(first.law.joints) == set(joints))
    said = "nothing" if first is None else f"{first.law.effect.name}, P {first.probability:.3f}"
    return Target("first named", said, effect, right)


def found(told: Diagnosis, effect: str, joint: int | None = None) -> list[Finding]:
    """Findings of an effect, of a joint where one is given."""
    return [f for f in told.findings if f.law.effect.name == effect and (joint is None or joint in f.law.joints)]


def rms(x: Array) -> float:
    """Root mean square [as x]."""
    return float(np.sqrt(np.mean(np.square(x))))


def _row(robot: str, concealed: str, told: Diagnosis, seconds: float) -> Row:
    names = told.robot.joints
    findings = tuple(
        Said(
            f.law.effect.name,
            tuple(names[j] for j in f.law.joints),
            f.role,
            f.probability,
            f.statistic,
            f.held_out_gain,
            {key: (x, f.std.get(key, float("nan"))) for key, x in f.law.parameters.items()},
            {
                f"{a.law.effect.name} {', '.join(names[j] for j in a.law.joints[:2])}": a.probability
                for a in f.alternatives
            },
        )
        for f in told.findings
    )
    rest = {names[u.joint]: (u.share, f"{u.place.variable} {u.place.region}") for u in told.unexplained}
    left = dict(zip(names, (told.after.held_out_rms / told.after.irreducible_rms).tolist(), strict=True))
    return Row(robot, concealed, told.verdict, findings, (), rest, left, told.flags, told.cutoff, seconds)
