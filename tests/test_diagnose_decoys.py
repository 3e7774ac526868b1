"""A law that is only added to the library changes no verdict."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from diagnosed import fault, read, recorded, simulation

import signid
from signid.diagnose import Diagnosis
from signid.diagnose.data.hypotheses import Hypothesis
from signid.diagnose.evidence.prior import log_prior
from signid.diagnose.thresholds import ADDED_FREQUENCY
from signid.effects import EFFECTS
from signid.effects.base import TorqueLaw
from signid.types import Array, Coefficient, Law, View

ROOT = Path(__file__).parents[1]
SPRING = fault("spring", 2, stiffness=1.0, rest=0.2)


class SmoothFriction(TorqueLaw):
    """Coulomb friction that rises over a speed."""

    name, equation, source, typical = "smooth_friction", "level * arctan(v / 0.1)", "test", "test"
    parameters, example = {"level": Coefficient("N.m", positive=True)}, {"level": 1.0}
    dissipative, reverses = True, True

    def columns(self, x: View) -> list[Array]:
        return [2 / np.pi * np.arctan(x.v / 0.1)]


class StiffeningSpring(TorqueLaw):
    """Torque of the square of the position."""

    name, equation, source, typical = "stiffening_spring", "square * q * abs(q)", "test", "test"
    parameters, example = {"square": Coefficient("N.m")}, {"square": 1.0}

    def columns(self, x: View) -> list[Array]:
        return [x.q * np.abs(x.q)]


class SlowRotor(TorqueLaw):
    """Torque of the square root of the acceleration."""

    name, equation, source, typical = "slow_rotor", "root * sign(a) * sqrt(abs(a))", "test", "test"
    parameters, example = {"root": Coefficient("N.m")}, {"root": 1.0}

    def columns(self, x: View) -> list[Array]:
        return [np.sign(x.a) * np.sqrt(np.abs(x.a))]


def verdict(found: Diagnosis) -> tuple[str, list[tuple[str, tuple[int, ...]]]]:
    return found.verdict, [(finding.law.effect.name, finding.law.joints) for finding in found.causes]


def diagnosed(case: str) -> Diagnosis:
    if case == "robots/3r":
        return signid.diagnose(signid.load_robot("3r"), [ROOT / "robots" / "3r" / "recording.parquet"])
    stated = ("viscous_friction", "coulomb_friction", "armature") if case == "stated" else ()
    return signid.diagnose(simulation("3r", stated), read("3r", recorded("3r", SPRING)))


def test_a_law_that_is_not_listed_is_rare_a_priori() -> None:
    prior = [
        log_prior(Hypothesis((Law(effect, (0,)),)), 1, 30, 1) for effect in (StiffeningSpring(), EFFECTS["spring"])
    ]
    assert np.exp(prior[0] - prior[1]) == pytest.approx(ADDED_FREQUENCY) and ADDED_FREQUENCY < 0.3


@pytest.mark.parametrize("case", ["robots/3r", "bare", "stated"])
def test_decoys_change_no_verdict(monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    before = verdict(diagnosed(case))
    for decoy in (SmoothFriction(), StiffeningSpring(), SlowRotor()):
        module: Any = ModuleType(f"signid.effects.{decoy.name}")
        module.PLUGIN = decoy
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setattr(EFFECTS, "modules", {**EFFECTS.modules, decoy.name: decoy.name})
    assert "slow_rotor" in EFFECTS.names and verdict(diagnosed(case)) == before
