"""Parameters of every law are identified from a simulated recording with noise and friction."""

from __future__ import annotations

import pytest
from recover import case, misses, recover

from signid.effects import EFFECTS
from signid.effects.base import Effect

# gravity is a vector in the place of another one, not an addition to it: tests/test_faults_gravity.py
SECONDS, SEED = 8.0, 5


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.name != "gravity"], ids=lambda e: e.name)
def test_parameters_are_recovered(effect: Effect) -> None:
    planted = case(effect, SEED, SECONDS)
    far = misses(planted, recover(planted))
    assert far
    assert {key: share for key, share in far.items() if share > 1} == {}


@pytest.mark.parametrize(
    ("name", "key", "allowed"), [("joint_elasticity", "stiffness", 0.02), ("time_delay", "delay", 0.03)]
)
def test_reversals_of_friction_bias_neither_elasticity_nor_delay(name: str, key: str, allowed: float) -> None:
    effect = EFFECTS[name]
    found = recover(case(effect, SEED + 1, SECONDS)).parameters[key]
    assert abs(found / effect.example[key] - 1) < allowed
