"""Two interacting faults, recorded in MuJoCo: both are named with their parameters."""

from __future__ import annotations

from importlib import import_module

import pytest
from diagnosed import Planted, fault, look, named, read, recorded, simulation

import signid
from signid.diagnose.result import Diagnosis
from signid.diagnose.search.iterate import DISAGREEMENT_FLAG

LOAD = fault("payload", 3, mass=0.4, first_moment_x=0.02, first_moment_y=0.0, first_moment_z=0.01)
OTHERS = (
    fault("base_tilt", x=0.04, y=-0.03),
    fault("load_friction", 2, coefficient=0.12),
    fault("torque_gain", 2, error=0.15),
    fault("encoder_offset", 2, offset=0.05),
    fault("joint_elasticity", 2, stiffness=150.0),
    fault("backlash", 2, gap=0.03),
)
TOGETHER = import_module("signid.diagnose.search.iterate")


def off(found: Diagnosis, planted: Planted) -> float:
    """Largest relative error of a law's parameters."""
    (law,) = [one.law for one in found.findings if one.law.effect.name == planted[0]]
    return max(abs(law.parameters[key] / float(x) - 1) for key, x in planted[2])


@pytest.mark.slow_cases(but="base_tilt")
@pytest.mark.parametrize("other", OTHERS, ids=[other[0] for other in OTHERS])
def test_a_payload_does_not_bias_the_parameters_of_affected_laws(other: Planted) -> None:
    found = look("3r", LOAD, other)
    joint = (0, 1, 2) if other[0] == "base_tilt" else (1,)
    assert set(named(found)) == {("payload", (2,)), (other[0], joint)} and DISAGREEMENT_FLAG not in found.flags
    assert off(found, other) < 0.05
    (payload,) = [one for one in found.findings if one.law.effect.name == "payload"]
    for key, truth in LOAD[2]:
        assert abs(payload.law.parameters[key] - float(truth)) < 3 * payload.std[key]


@pytest.mark.slow
def test_inertial_errors_within_tolerance_are_relinearised_too() -> None:
    wrong = fault("link_inertia", 2, mass=0.4, first_moment_x=0.1, first_moment_y=0.0, first_moment_z=0.0)
    found = look("3r", wrong, OTHERS[0])
    assert found.prior_scale > 0 and named(found) == [("base_tilt", (0, 1, 2))] and off(found, OTHERS[0]) < 0.06


@pytest.mark.slow
def test_a_search_that_does_not_converge_is_flagged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TOGETHER, "_names", lambda _: object())
    monkeypatch.setattr(TOGETHER.tuned, "RELINEARISATION_ROUNDS", 1)
    found = signid.diagnose(simulation("3r"), read("3r", recorded("3r", LOAD, OTHERS[1])))
    assert DISAGREEMENT_FLAG in found.flags and off(found, OTHERS[1]) > 0.2


@pytest.mark.slow
def test_a_time_limit_in_a_later_round_keeps_earlier_findings(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, about, asked = TOGETHER._search, TOGETHER.relinearise, list[bool]()
    later = list[bool]()

    def interrupted(*given: object, **more: object) -> object:
        """The first round of searches ends; in the next round the time limit passes before a finding."""
        asked.append(bool(later))
        monkeypatch.setattr(TOGETHER, "time_is_up", lambda _: asked[-1])
        monkeypatch.setattr(import_module("signid.diagnose.search.stepwise"), "time_is_up", lambda _: asked[-1])
        return whole(*given, **more)

    monkeypatch.setattr(TOGETHER, "_search", interrupted)
    monkeypatch.setattr(TOGETHER, "relinearise", lambda *given: later.append(True) or about(*given))
    found = signid.diagnose(simulation("3r"), read("3r", recorded("3r", LOAD, OTHERS[1])))
    assert asked[0] is False and asked[-1] is True and sum(asked) == 1 and DISAGREEMENT_FLAG not in found.flags
    assert set(named(found)) == {("payload", (2,)), ("load_friction", (1,))} and off(found, OTHERS[1]) > 0.2
