"""Every effect obeys the contract, the simulator agrees with it, planted errors are caught, parameters recovered."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from agreement import agreement
from arm import smooth_motion
from contract import faults
from planted import PLANTED
from recover import case, misses, recover
from toys import CHAIN, toy

import signid
import signid.effects
from signid.effects import DRIVE_EFFECTS, EFFECT_NAMES, EFFECTS
from signid.effects.base import Effect
from signid.effects.law import candidate_places, law_columns
from signid.effects.naming import parse_law
from signid.errors import OptionError, RobotError
from signid.recording import read_recording
from signid.regression.session import Options, prepare
from signid.types import Coefficient, Law

SLOPE, LEFT = 0.01, 0.03
JUMPS_MOST = {"stribeck_friction": 0.12}  # first order in the step, and there is little of it but the jump


def test_every_law_is_registered() -> None:
    files = sorted(Path(str(signid.effects.__file__)).parent.glob("*.py"))
    there = {path.stem for path in files if "\nPLUGIN = " in path.read_text("utf-8")}
    apart = {*DRIVE_EFFECTS.names, "empirical", "motor_friction", "gear_friction"}
    assert set(EFFECTS.names) == there - apart and apart < there
    assert EFFECTS.names[:4] == EFFECT_NAMES and len(EFFECTS.names) >= 31
    assert all(EFFECTS[name].name == name for name in EFFECTS.names)
    assert {twin for effect in EFFECTS for twin in effect.twins} <= set(EFFECTS.names)


@pytest.mark.parametrize("effect", [*EFFECTS, EFFECTS["gear_friction"]], ids=lambda e: e.name)
def test_effect_obeys(effect: Effect) -> None:
    assert list(faults(effect)) == []


@pytest.mark.slow
@pytest.mark.parametrize("effect", list(EFFECTS), ids=lambda e: e.name)
def test_simulator_agrees(effect: Effect) -> None:
    slope, left = agreement(effect)
    assert abs(slope - 1) < SLOPE and left < JUMPS_MOST.get(effect.name, LEFT)


@pytest.mark.parametrize("effect", list(EFFECTS), ids=lambda e: e.name)
def test_columns_at_every_place(effect: Effect) -> None:
    motion = smooth_motion()
    for place in candidate_places(effect, 3):
        rows, columns = law_columns(Law(effect, place, effect.example), motion)
        assert columns.shape[:2] == (len(motion), len(rows)) and np.isfinite(columns).all()


@pytest.mark.parametrize("error", PLANTED)
def test_planted_error_is_caught(error: str) -> None:
    effect, sentence = PLANTED[error]
    assert sentence in list(faults(effect))


def test_an_equation_with_an_unknown_function_is_refused_with_those_it_may_use() -> None:
    odd = type("Odd", (type(EFFECTS["viscous_friction"]),), {"equation": "coefficient * erf(v)"})
    *_, sentence = faults(odd())
    assert sentence.startswith("its equation uses 'erf'; it may use") and "sqrt" in sentence


def test_unknown_effects_are_named() -> None:
    with pytest.raises(OptionError, match="no effect named 'stiction'; choose from viscous_friction"):
        EFFECTS["stiction"]


def test_units_at_a_prismatic_joint() -> None:
    assert Coefficient("N.m.s/rad").unit_at(True) == "N.s/m"
    assert Coefficient("kg.m2").unit_at(True) == "kg"
    units = {k: p.unit_at(True) for k, p in EFFECTS["torque_ripple"].parameters.items()}
    assert units == {"amplitude": "N", "phase": "rad", "frequency": "1/m"}


LEAST_SQUARES = (
    "viscous_friction coulomb_friction torque_offset armature asymmetric_friction quadratic_friction load_friction "
    "spring counterbalance"
).split()
REFUSED = {
    "cable_torque": "not linear in cubic, centre",
    "stribeck_friction": "shape parameters velocity",
    "torque_gain": "changes what torque is recorded",
    "torque_sign": "changes what torque is recorded",
    "torque_saturation": "changes what torque is recorded or applied",
    "payload": "acts on more than one joint",
    "time_delay": "acts on more than one joint",
}


@pytest.mark.parametrize("name", EFFECTS.names)
def test_least_squares_takes_laws_that_it_can_fit_and_refuses_the_others(name: str) -> None:
    motion = smooth_motion()
    assert motion.recorded is not None
    recording = read_recording({"t": motion.t, "q": motion.q, "tau": motion.recorded}, motion.robot)
    options = Options(effects=(name,))
    try:
        laws = prepare(motion.robot, [recording], options=options).task.laws
    except OptionError as error:
        assert name not in LEAST_SQUARES and REFUSED.get(name, f"effect '{name}'") in str(error)
    else:
        assert name not in REFUSED and len(laws) == 3


def test_a_pair_on_a_robot_with_one_joint_is_refused() -> None:
    for text in ("channel_swap:partner=joint_1", "channel_swap@joint_1:partner=joint_1"):
        with pytest.raises(OptionError, match="none is named|couples two joints"):
            parse_law(text, signid.load_robot("1r"))


def test_a_missing_partner_is_refused() -> None:
    robot = toy(*CHAIN)
    assert parse_law("channel_swap:partner=y", robot).joints == (0, 1)
    for text in ("channel_swap:partner=elbow", "channel_swap@z:partner=elbow"):
        with pytest.raises(RobotError, match="elbow"):
            parse_law(text, robot)


# gravity is a vector in the place of another one, not an addition to it: tests/test_faults_gravity.py
SECONDS, SEED = 8.0, 5


@pytest.mark.slow_cases("backlash")
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
