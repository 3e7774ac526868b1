"""Result of one diagnosis with concealed physics, and its targets."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signid.diagnose import Diagnosis, Finding
from signid.errors import SignidError
from signid.types import Array

Targets = Callable[[Diagnosis], Sequence["Target"]]


@dataclass(frozen=True)
class Target:
    """One figure with or without target."""

    what: str
    value: str
    asked: str = ""
    met: bool | None = None  # None: no target


@dataclass(frozen=True)
class NamedLaw:
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
    """Result of one diagnosis of a robot's recordings."""

    robot: str
    concealed: str
    verdict: str  # verdict of the diagnosis, or "refused"
    findings: tuple[NamedLaw, ...]
    targets: tuple[Target, ...]
    unexplained: Mapping[str, tuple[float, str]]  # per joint: share of its torque, variable that it depends on
    left: Mapping[str, float]  # per joint: held-out residual over the noise floor
    flags: tuple[str, ...]
    cutoff: float  # [Hz]
    seconds: float  # processor time

    @property
    def holds(self) -> bool:
        """Whether there are targets and none is missed."""
        return bool(self.targets) and all(target.met is not False for target in self.targets)


def attempt(robot: str, concealed: str, run: Callable[[], Diagnosis], targets: Targets) -> tuple[Row, Diagnosis | None]:
    """Run, time and evaluate a diagnosis; a refusal gives a row without targets."""
    start = time.process_time()
    try:
        diagnosis = run()
    except SignidError as error:
        spent = time.process_time() - start
        return Row(robot, concealed, "refused", (), (), {}, {}, (str(error),), 0.0, spent), None
    row = _row(robot, concealed, diagnosis, time.process_time() - start)
    return replace(row, targets=tuple(targets(diagnosis))), diagnosis


def within(what: str, value: float, wanted: float, share: float, unit: str = "") -> Target:
    """Target for a value within a relative tolerance."""
    text = f"{value:.4g}{unit and ' ' + unit} ({100 * (value / wanted - 1):+.1f} %)"
    return Target(what, text, f"{wanted:g} ± {100 * share:g} %", abs(value / wanted - 1) <= share)


def first_is(diagnosis: Diagnosis, effect: str, joints: Sequence[int] | None = None) -> Target:
    """Target for the effect of the first finding, optionally at given joints."""
    first = diagnosis.findings[0] if diagnosis.findings else None
    right = first is not None and first.law.effect.name == effect
    right = right and first is not None and (joints is None or set(first.law.joints) == set(joints))
    text = "nothing" if first is None else f"{first.law.effect.name}, P {first.probability:.3f}"
    return Target("first named", text, effect, right)


def found(diagnosis: Diagnosis, effect: str, joint: int | None = None) -> list[Finding]:
    """Findings of an effect, optionally at a joint."""
    return [f for f in diagnosis.findings if f.law.effect.name == effect and (joint is None or joint in f.law.joints)]


def rms(x: Array) -> float:
    """Root mean square [as x]."""
    return float(np.sqrt(np.mean(np.square(x))))


def _row(robot: str, concealed: str, diagnosis: Diagnosis, seconds: float) -> Row:
    names = diagnosis.robot.joints
    findings = tuple(
        NamedLaw(
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
        for f in diagnosis.findings
    )
    rest = {names[u.joint]: (u.share, f"{u.place.variable} {u.place.region}") for u in diagnosis.unexplained}
    left = dict(zip(names, (diagnosis.after.held_out_rms / diagnosis.after.irreducible_rms).tolist(), strict=True))
    return Row(
        robot, concealed, diagnosis.verdict, findings, (), rest, left, diagnosis.flags, diagnosis.cutoff, seconds
    )
